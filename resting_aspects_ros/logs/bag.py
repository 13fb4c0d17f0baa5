"""The folder of a log: its MCAP files and metadata.yaml of rosbag2, version 9 (Jazzy).

A log of the suite has one file; the metadata.yaml of a split bag lists several.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import zstandard

from resting_aspects_ros.errors import LogError, NoLogError, one_line
from resting_aspects_ros.input_files import is_file, is_folder, named, read_yaml, yaml_text

EXPECTED = 'expected the folder of a run, or an .mcap file'
FILE_NAME = 'metadata.yaml'
# Name of the metadata record that contains the outcome of a log.
OUTCOME = 'outcome'
MAGIC = b'\x89MCAP0\r\n'

_SUFFIX = '.mcap'
# Of files that rosbag2 (--compression-mode file) or the command zstd has compressed.
_COMPRESSED = ('.mcap.zstd', '.mcap.zst')
_INFORMATION = 'rosbag2_bagfile_information'
# Maximum size of metadata.yaml. A topic needs about 700 bytes.
_MAX_BYTES = 1 << 20
# Starting time that rosbag2 writes for an empty bag.
_NO_START = 2**63 - 1


# -- files ----------------------------------------------------------------------------------------


def is_compressed(path: Path) -> bool:
    """Return whether an MCAP file is compressed, by its suffix."""
    return path.name.endswith(_COMPRESSED)


def is_log(path: Path) -> bool:
    """Return whether a path is meant to be a log: a folder, or an MCAP file by its suffix."""
    return is_folder(path) or _is_mcap(path) or path.name == FILE_NAME


def log_files(path: Path) -> list[Path]:
    """Return the files of a log: several only for a split bag, in the order of its metadata.yaml.

    path : Path
        A folder, its metadata.yaml, or an MCAP file.

    Raises NoLogError for a folder without an MCAP file, LogError if it has several that are not
    those of a split bag, or if a file of a split bag is missing.
    """
    folder = path.parent if path.name == FILE_NAME else path
    if not is_folder(folder):
        return [path]
    found = sorted(file for file in folder.iterdir() if _is_mcap(file) and is_file(file))
    listed = _listed(folder)
    missing = [file.name for file in listed if file not in found]
    if listed and not missing:
        return listed
    if len(listed) > 1:
        raise LogError(
            f'invalid {named("log", path)}: expected all files that its {FILE_NAME} lists; '
            f'missing: {one_line(", ".join(missing))}'
        )
    if len(found) > 1:
        raise LogError(
            f'invalid {named("log", path)}: expected one {_SUFFIX} file, or a {FILE_NAME} that '
            f'lists the files, found {len(found)} files'
        )
    if not found:
        message = f'{named("folder", path)} is not a log: it has no {_SUFFIX} file'
        raise NoLogError(f'{message}; {EXPECTED}')
    return found


def open_file(path: Path) -> BinaryIO:
    """Open an MCAP file for reading; of a compressed file, a temporary copy that is unpacked.

    Raises NoLogError if it cannot be opened, LogError if it cannot be unpacked.
    """
    try:
        if path.exists() and not path.is_file():
            raise NoLogError(f'{named("log", path)} is neither a file nor a folder')
        return _unpacked(path) if is_compressed(path) else path.open('rb')
    except OSError as error:
        message = f'{named("log", path)} cannot be read: {error.strerror}; {EXPECTED}'
        raise NoLogError(message) from None
    except zstandard.ZstdError as error:
        found = unpacking_failure(error)
        raise LogError(f'{named("log", path)} is damaged: found {found}') from None


def unpacking_failure(error: Exception) -> str:
    """Return a text for an error of a decompressor, without the name of its class."""
    return f'compressed data that cannot be unpacked ({str(error).rpartition(": ")[2]})'


def _is_mcap(path: Path) -> bool:
    return path.suffix == _SUFFIX or is_compressed(path)


def _unpacked(path: Path) -> BinaryIO:
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
    try:
        with path.open('rb') as packed:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            shutil.copyfileobj(reader, copy, 1 << 20)
    except BaseException:
        copy.close()
        raise
    return copy


def _listed(folder: Path) -> list[Path]:
    """Return the files that metadata.yaml lists; none if it cannot be read."""
    information = read_information(folder)
    if str(information.get('compression_mode')).lower() == 'message':
        raise LogError(
            f'invalid {named("log", folder)}, whose messages are compressed one by one: expected '
            'a bag that was recorded with --compression-mode file, or without compression'
        )
    paths = information.get('relative_file_paths')
    # Old versions of rosbag2 write the folder before the name.
    return [folder / Path(str(each)).name for each in paths] if isinstance(paths, list) else []


# -- metadata.yaml --------------------------------------------------------------------------------


@dataclass(frozen=True)
class LogOutcome:
    """Number of drops in a log, and whether it is whole: has the part and all drops of its run."""

    drops: int
    whole: bool

    def record(self) -> dict[str, str]:
        """Return the values of the metadata record."""
        return {'whole': str(self.whole).lower(), 'drops': str(self.drops)}

    @classmethod
    def of(cls, values: Mapping[str, str]) -> LogOutcome | None:
        """Return the outcome in the values of its metadata record; None if they have none."""
        drops, whole = values.get('drops', ''), values.get('whole')
        if whole not in ('true', 'false') or not drops.isdecimal():
            return None
        return cls(int(drops), whole == 'true')


@dataclass
class BagMetadata:
    """The content of metadata.yaml for a bag of one file, updated while the file is written.

    topics : dict
        The entries of `topics_with_message_count` by name, in the order of their first messages.
    start, end : int
        Log time of the first and of the last message, ns since 1970; None without messages.
    custom : dict
        The custom data of rosbag2: text by name.
    """

    file_name: str
    topics: dict[str, dict[str, Any]] = field(default_factory=dict)
    start: int | None = None
    end: int | None = None
    custom: dict[str, str] = field(default_factory=dict)

    def add_topic(
        self, name: str, type_name: str, qos: list[dict[str, Any]], type_hash: str
    ) -> dict[str, Any]:
        """Add a topic without messages; returns its `topic_metadata`.

        qos : list
            The `offered_qos_profiles`, see `qos_profiles`.
        """
        metadata = {
            'name': name,
            'type': type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': qos,
            'type_description_hash': type_hash,
        }
        self.topics[name] = {'topic_metadata': metadata, 'message_count': 0}
        return metadata

    def count(self, topic_name: str, log_time: int) -> None:
        """Count a message of a known topic; log times must not decrease."""
        self.topics[topic_name]['message_count'] += 1
        self.start = log_time if self.start is None else self.start
        self.end = log_time

    def add_record(self, name: str, values: Mapping[str, str]) -> None:
        """Copy a metadata record of the file to the custom data, with keys `name.key`."""
        self.custom.update({f'{name}.{key}': value for key, value in values.items()})

    def information(self) -> dict[str, Any]:
        """Return the keys and values under `rosbag2_bagfile_information`."""
        start = _NO_START if self.start is None else self.start
        end = start if self.end is None else self.end
        extent = {
            'duration': {'nanoseconds': end - start},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(each['message_count'] for each in self.topics.values()),
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **extent,
            'topics_with_message_count': list(self.topics.values()),
            # Compression of whole files or messages by rosbag2, which is not used. The chunks in
            # the file state their own compression.
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.file_name],
            'files': [{'path': self.file_name, **extent}],
            'custom_data': dict(self.custom),
            'ros_distro': 'jazzy',
        }


def write_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Write metadata.yaml atomically; raises OSError if it cannot be written."""
    temporary = folder / f'{FILE_NAME}.tmp'
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


def read_information(folder: Path) -> dict[str, Any]:
    """Return `rosbag2_bagfile_information` of metadata.yaml; empty if it cannot be read."""
    try:
        document = read_yaml(folder / FILE_NAME, 'metadata', _MAX_BYTES, LogError)
    except LogError:
        return {}
    information = document.get(_INFORMATION) if isinstance(document, dict) else None
    return information if isinstance(information, dict) else {}


def recorded_outcome(folder: Path) -> LogOutcome | None:
    """Return the outcome in the metadata.yaml of a folder; None if it has none."""
    custom = read_information(folder).get('custom_data')
    if not isinstance(custom, dict):
        return None
    start = f'{OUTCOME}.'
    return LogOutcome.of({str(k).removeprefix(start): str(value) for k, value in custom.items()})
