"""The folder of a log: its MCAP files and metadata.yaml of rosbag2, version 9 (Jazzy).

A log of the suite has one file; the metadata.yaml of a split bag lists several.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
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
# Maximum number of digits of a number of drops; Python does not read any number.
_MAX_DIGITS = 20
# Maximum size of metadata.yaml. A topic needs about 700 bytes.
_MAX_BYTES = 1 << 20


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

    Raises NoLogError for a folder without an MCAP file, LogError if it has several without a list,
    or if a file of a split bag is missing.
    """
    folder = path.parent if path.name == FILE_NAME else path
    if not is_folder(folder):
        return [path]
    found = sorted(file for file in folder.iterdir() if _is_mcap(file) and is_file(file))
    if not found:
        message = f'{named("folder", path)} is not a log: it has no {_SUFFIX} file'
        raise NoLogError(f'{message}; {EXPECTED}')
    listed = _listed(folder)
    if len(found) == 1 and len(listed) <= 1:
        return found
    missing = [file.name for file in listed if file not in found]
    if missing or not listed:
        raise LogError(
            f'invalid {named("log", path)}: expected one {_SUFFIX} file, or all that its '
            f'{FILE_NAME} lists; missing: {one_line(", ".join(missing or [FILE_NAME]))}'
        )
    return listed


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
        is_number = drops.isdecimal() and len(drops) <= _MAX_DIGITS
        if whole not in ('true', 'false') or not is_number:
            return None
        return cls(int(drops), whole == 'true')


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write metadata.yaml atomically; raises OSError if it cannot be written."""
    temporary = folder / f'{FILE_NAME}.tmp'
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(yaml_text({_INFORMATION: information}))
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
