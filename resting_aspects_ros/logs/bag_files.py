"""The files of a log: one MCAP file, or those that the metadata.yaml of a split bag lists."""

import shutil
import tempfile
from pathlib import Path
from typing import BinaryIO

import zstandard

from resting_aspects_ros.errors import LogError, NoLogError, one_line
from resting_aspects_ros.input_files import is_file, is_folder, named
from resting_aspects_ros.logs.bag_metadata import FILE_NAME, read_information

EXPECTED = 'expected the folder of a run, or an .mcap file'
_SUFFIX = '.mcap'
# Of files that rosbag2 (--compression-mode file) or the command zstd has compressed.
_COMPRESSED = ('.mcap.zstd', '.mcap.zst')


def is_compressed(path: Path) -> bool:
    """Return whether a path is that of a compressed MCAP file, by its suffix."""
    return path.name.endswith(_COMPRESSED)


def is_mcap(path: Path) -> bool:
    """Return whether a path is that of an MCAP file, compressed or not, by its suffix."""
    return path.suffix == _SUFFIX or is_compressed(path)


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
    found = sorted(file for file in folder.iterdir() if is_mcap(file) and is_file(file))
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
        if logs := len({file.parent for file in folder.glob(f'*/*{_SUFFIX}')}):
            message += f', but {logs} of its subfolders have one'
        raise NoLogError(f'{message}; {EXPECTED}')
    return found


def open_unpacked(path: Path) -> BinaryIO:
    """Open an MCAP file for reading; of a compressed file, a temporary copy that is unpacked.

    Raises OSError if it cannot be read, LogError if it cannot be unpacked.
    """
    if not is_compressed(path):
        return path.open('rb')
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
    try:
        with path.open('rb') as packed:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            shutil.copyfileobj(reader, copy, 1 << 20)
        copy.seek(0)
    except BaseException as error:
        copy.close()
        if isinstance(error, zstandard.ZstdError):
            found = unpacking_failure(error)
            raise LogError(f'{named("log", path)} is damaged: found {found}') from None
        raise
    return copy


def unpacking_failure(error: Exception) -> str:
    """Return a text for an error of a decompressor, without the name of its class."""
    return f'compressed data that cannot be unpacked ({str(error).rpartition(": ")[2]})'


def _listed(folder: Path) -> list[Path]:
    """Return the files that metadata.yaml lists; none if it cannot be read."""
    information = read_information(folder)
    if not isinstance(information, dict):
        return []
    if str(information.get('compression_mode')).lower() == 'message':
        raise LogError(
            f'invalid {named("log", folder)}, whose messages are compressed one by one: expected '
            'a bag that was recorded with --compression-mode file, or without compression'
        )
    paths = information.get('relative_file_paths')
    # Old versions of rosbag2 write the folder before the name.
    return [folder / Path(str(each)).name for each in paths] if isinstance(paths, list) else []
