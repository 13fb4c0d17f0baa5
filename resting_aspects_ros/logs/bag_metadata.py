"""metadata.yaml of rosbag2, version 9 (Jazzy), which makes a folder with an MCAP file a bag."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import read_yaml
from resting_aspects_ros.logs.topic_metadata import yaml_text

_VERSION = 9
_ROS_DISTRO = 'jazzy'
FILE_NAME = 'metadata.yaml'
_INFORMATION = 'rosbag2_bagfile_information'
# Maximum size of metadata.yaml. A topic needs about 700 bytes.
_MAX_BYTES = 1 << 20

# Starting time that rosbag2 writes for an empty bag.
_NO_START = 2**63 - 1


# Name of the metadata record that contains the outcome of a log.
OUTCOME = 'outcome'


@dataclass(frozen=True)
class LogOutcome:
    """Number of drops in a log, and whether it is whole: has the part and all drops of its run."""

    drops: int
    whole: bool

    def record(self) -> dict[str, str]:
        """Return the values of the metadata record."""
        return {'whole': str(self.whole).lower(), 'drops': str(self.drops)}

    @classmethod
    def of(cls, records: Mapping[str, Mapping[str, str]]) -> LogOutcome | None:
        """Return the outcome in the metadata records of a log; None if they have none."""
        values = records.get(OUTCOME, {})
        drops = values.get('drops', '')
        if 'whole' not in values or not drops.isdecimal():
            return None
        return cls(int(drops), values['whole'] == 'true')


@dataclass
class TopicCount:
    """A recorded topic, with the attributes of its channel and the number of its messages.

    qos : list
        The `offered_qos_profiles`, see `qos_profiles`.
    """

    name: str
    type: str
    qos: list[dict[str, Any]]
    type_hash: str
    messages: int = 0


@dataclass
class BagMetadata:
    """The content of metadata.yaml for a bag of one file, updated while the file is written.

    topics : dict
        Topics by name, in the order of their first messages.
    start, end : int
        Log time of the first and of the last message, ns since 1970; None without messages.
    custom : dict
        The custom data of rosbag2: text by name.
    """

    file_name: str
    topics: dict[str, TopicCount] = field(default_factory=dict)
    start: int | None = None
    end: int | None = None
    custom: dict[str, str] = field(default_factory=dict)

    def count(self, topic_name: str, log_time: int) -> None:
        """Count a message of a known topic; log times must not decrease."""
        self.topics[topic_name].messages += 1
        self.start = log_time if self.start is None else self.start
        self.end = log_time

    def add_record(self, name: str, values: dict[str, str]) -> None:
        """Copy a metadata record of the file to the custom data, with keys `name.key`."""
        self.custom.update({f'{name}.{key}': value for key, value in values.items()})

    def information(self) -> dict[str, Any]:
        """Return the keys and values under `rosbag2_bagfile_information`."""
        messages = sum(each.messages for each in self.topics.values())
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            **self._span(),
            'message_count': messages,
            'topics_with_message_count': [
                _topic_information(each) for each in self.topics.values()
            ],
            # Compression of whole files or messages by rosbag2, which is not used. The chunks in
            # the file state their own compression.
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file_name],
            'files': [{'path': self.file_name, **self._span(), 'message_count': messages}],
            'custom_data': dict(self.custom),
            'ros_distro': _ROS_DISTRO,
        }

    def _span(self) -> dict[str, Any]:
        start = _NO_START if self.start is None else self.start
        end = start if self.end is None else self.end
        return {
            'duration': {'nanoseconds': end - start},
            'starting_time': {'nanoseconds_since_epoch': start},
        }


def write_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Write metadata.yaml atomically; raises OSError if it cannot be written."""
    temporary = folder / 'metadata.yaml.tmp'
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(yaml_text({_INFORMATION: metadata.information()}))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(folder / FILE_NAME)
    except OSError:
        with suppress(OSError):
            temporary.unlink()
        raise
    _sync_folder(folder)
    _sync_folder(folder.parent)


def read_information(folder: Path) -> object:
    """Return `rosbag2_bagfile_information` of metadata.yaml; None if it cannot be read."""
    try:
        document = read_yaml(folder / FILE_NAME, 'metadata', _MAX_BYTES, LogError)
    except LogError:
        return None
    return document.get(_INFORMATION) if isinstance(document, dict) else None


def recorded_outcome(folder: Path) -> LogOutcome | None:
    """Return the outcome in the metadata.yaml of a folder; None if it has none."""
    information = read_information(folder)
    custom = information.get('custom_data') if isinstance(information, dict) else None
    if not isinstance(custom, dict):
        return None
    start = f'{OUTCOME}.'
    values = {str(key).removeprefix(start): str(value) for key, value in custom.items()}
    return LogOutcome.of({OUTCOME: values})


def _sync_folder(folder: Path) -> None:
    """Write the entries of a folder to disk, so that they survive a power failure."""
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
