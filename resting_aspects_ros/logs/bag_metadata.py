"""metadata.yaml, which makes a folder with an MCAP file a bag of rosbag2, version 9 (Jazzy)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.logs.topic_metadata import yaml_text

_VERSION = 9
_ROS_DISTRO = 'jazzy'
_FILE_NAME = 'metadata.yaml'
_INFORMATION = 'rosbag2_bagfile_information'
# A topic needs about 700 bytes of it.
_MAX_BYTES = 1 << 20

# rosbag2's word for the starting time of a bag in which nothing is.
_NEVER = 2**63 - 1


# The record of free text that tells how a log ended.
OUTCOME = 'outcome'


@dataclass(frozen=True)
class Outcome:
    """Drops in a log, and whether it is whole: all drops of its run, and the part."""

    drops: int
    whole: bool

    def record(self) -> dict[str, str]:
        """The values of the record."""
        return {'whole': str(self.whole).lower(), 'drops': str(self.drops)}

    @classmethod
    def of(cls, notes: Mapping[str, Mapping[str, str]]) -> Outcome | None:
        """What the records of a log say; None if they do not."""
        values = notes.get(OUTCOME, {})
        drops = values.get('drops', '')
        if 'whole' not in values or not drops.isdecimal():
            return None
        return cls(int(drops), values['whole'] == 'true')


@dataclass
class TopicCount:
    """A recorded topic, as its channel in the file has it, and how many messages are in there.

    qos : list
        Its `offered_qos_profiles`, see `qos_profiles`.
    """

    name: str
    type: str
    qos: list[dict[str, Any]]
    type_hash: str
    messages: int = 0


@dataclass
class BagMetadata:
    """What metadata.yaml says of a bag of one file, kept up to date while the file is written.

    topics : dict
        By name, in the order in which they came.
    start, end : int
        Log time of the first and of the last message, ns since 1970; None if there is none.
    custom : dict
        What rosbag2 calls custom data: free text by name.
    """

    file_name: str
    topics: dict[str, TopicCount] = field(default_factory=dict)
    start: int | None = None
    end: int | None = None
    custom: dict[str, str] = field(default_factory=dict)

    def count(self, topic_name: str, log_time: int) -> None:
        """Count a message of a topic that is known; log times must not run backwards."""
        self.topics[topic_name].messages += 1
        self.start = log_time if self.start is None else self.start
        self.end = log_time

    def note(self, name: str, values: dict[str, str]) -> None:
        """Repeat a record of free text of the file, as `name.key`."""
        self.custom.update({f'{name}.{key}': value for key, value in values.items()})

    def information(self) -> dict[str, Any]:
        """Give the keys and values under `rosbag2_bagfile_information`."""
        messages = sum(each.messages for each in self.topics.values())
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            **self._span(),
            'message_count': messages,
            'topics_with_message_count': [
                _topic_information(each) for each in self.topics.values()
            ],
            # Of whole files or messages, by rosbag2. The chunks of the file say it themselves.
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file_name],
            'files': [{'path': self.file_name, **self._span(), 'message_count': messages}],
            'custom_data': dict(self.custom),
            'ros_distro': _ROS_DISTRO,
        }

    def _span(self) -> dict[str, Any]:
        start = _NEVER if self.start is None else self.start
        end = start if self.end is None else self.end
        return {
            'duration': {'nanoseconds': end - start},
            'starting_time': {'nanoseconds_since_epoch': start},
        }


def write_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Write metadata.yaml whole or not at all; OSError if it cannot be written."""
    temporary = folder / 'metadata.yaml.tmp'
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(yaml_text({_INFORMATION: metadata.information()}))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(folder / _FILE_NAME)
    except OSError:
        with suppress(OSError):
            temporary.unlink()
        raise
    _sync_folder(folder)
    _sync_folder(folder.parent)


def read_information(folder: Path) -> object:
    """What metadata.yaml has under `rosbag2_bagfile_information`; None if it cannot be read."""
    try:
        document = read_yaml(folder / _FILE_NAME, 'metadata', _MAX_BYTES, LogError)
    except LogError:
        return None
    return document.get(_INFORMATION) if isinstance(document, dict) else None


def recorded_outcome(folder: Path) -> Outcome | None:
    """What metadata.yaml says of the log in a folder; None if it does not."""
    information = read_information(folder)
    custom = information.get('custom_data') if isinstance(information, dict) else None
    if not isinstance(custom, dict):
        return None
    start = f'{OUTCOME}.'
    values = {str(key).removeprefix(start): str(value) for key, value in custom.items()}
    return Outcome.of({OUTCOME: values})


def _sync_folder(folder: Path) -> None:
    """Make the names in a folder survive a loss of power."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _topic_information(count: TopicCount) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': count.name,
            'type': count.type,
            'serialization_format': 'cdr',
            'offered_qos_profiles': count.qos,
            'type_description_hash': count.type_hash,
        },
        'message_count': count.messages,
    }
