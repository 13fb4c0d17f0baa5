"""Read a log, whole or broken off: messages as the bytes that were on the wire."""

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import EndOfFile
from mcap.records import Channel, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader

from resting_aspects_ros.core.errors import LogError, NoLogError
from resting_aspects_ros.logs.file_lock import is_locked
from resting_aspects_ros.logs.schemas import load_schema

_SUFFIX = '.mcap'
_MAGIC = b'\x89MCAP'
# A whole file both begins and ends with it.
_END = b'\x89MCAP0\r\n'
_ALLOWED = 'allowed is the folder of a run, or an .mcap file'
# Where a file is cut within a number mcap raises the second, within a letter the third.
_CUT = (EndOfFile, struct.error, UnicodeDecodeError)


def is_log(path: Path) -> bool:
    """Whether it is meant to be a log: a folder, or an MCAP file by its name or first bytes."""
    if path.is_dir() or path.suffix == _SUFFIX:
        return True
    if not path.is_file():
        return False  # nothing, or a pipe, of which what is read is gone
    try:
        with path.open('rb') as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def last_message(path: Path, type_name: str) -> bytes | None:
    """The message of a type that was logged last.

    The index at the end of a file is not needed: of a log that was broken off, or is still being
    written, what is whole in it counts.

    Parameters
    ----------
    path : Path
        A folder with MCAP files, such as that of a run, or one such file.
    type_name : str
        `resting_aspects_interfaces/msg/AspectDistribution`.

    Returns
    -------
    bytes or None
        The message in CDR; None if there is none.

    Raises
    ------
    LogError
        If it is no log, cannot be read, is damaged before its end, or was written with another
        definition of the type than the installed one.
    """
    last: Message | None = None
    for file in log_files(path):
        for message in _messages(file, type_name):
            if last is None or message.log_time >= last.log_time:
                last = message
    return None if last is None else last.data


def messages(path: Path, type_name: str) -> Iterator[bytes]:
    """All messages of a type, in CDR, in the order in which they were logged; as last_message."""
    for file in log_files(path):
        for message in _messages(file, type_name):
            yield message.data


def one_file(path: Path) -> Path:
    """The MCAP file of a log that has one; raises LogError if there is none, or more."""
    files = log_files(path)
    if len(files) > 1:
        raise LogError(f'folder {str(path)!r} has {len(files)} {_SUFFIX} files, allowed is one')
    return files[0]


def log_files(path: Path) -> list[Path]:
    """The MCAP files of a log, by name.

    Raises NoLogError for a folder without any, for a file that is none, and for what is neither: a
    pipe would be waited for without end.
    """
    if not path.is_dir():
        _check_file(path)
        return [path]
    found = sorted(file for file in path.glob(f'*{_SUFFIX}') if file.is_file())
    if not found:
        words = f'folder {str(path)!r} is no log: no {_SUFFIX} file is in it'
        if logs := len({file.parent for file in path.glob(f'*/*{_SUFFIX}')}):
            words += f', but in {logs} folders in it'
        raise NoLogError(f'{words}, {_ALLOWED}')
    for file in found:
        _check_file(file)
    return found


def _check_file(path: Path) -> None:
    """Raises NoLogError for what is not, or is not the beginning of, an MCAP file."""
    if path.exists() and not path.is_file():
        raise NoLogError(f'log {str(path)!r} is neither a file nor a folder')
    try:
        with path.open('rb') as file:
            begins = file.read(len(_END))
    except OSError as error:
        words = f'log {str(path)!r} cannot be read: {error.strerror}'
        raise NoLogError(f'{words}, {_ALLOWED}') from None
    if not _END.startswith(begins):
        words = f'log {str(path)!r} is damaged, or no MCAP file: it begins with {begins!r}'
        raise NoLogError(f'{words}, {_ALLOWED}')


def records(path: Path) -> Iterator[McapRecord]:
    """All records of an MCAP file in their order, up to where the file is cut.

    Raises LogError if it cannot be read, or is damaged before its end.
    """
    try:
        with _opened(path) as file:
            try:
                yield from StreamReader(file, validate_crcs=True).records
            except _CUT as error:
                if _is_finished(file):
                    raise ValueError('a record does not end within the file') from error
    except LogError:
        raise
    except Exception as error:
        # Whatever the parser or the decompressor makes of it.
        raise LogError(f'log {str(path)!r} is damaged, or no MCAP file: {error}') from error


def _locked(path: Path) -> bool:
    with _opened(path) as file:
        return is_locked(file)


def _has_end(path: Path) -> bool:
    with _opened(path) as file:
        return _is_finished(file)


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open('rb') as file:
            yield file
    except OSError as error:
        raise LogError(f'log {str(path)!r} cannot be read: {error.strerror}') from None


def _is_finished(file: BinaryIO) -> bool:
    """Whether it ends as a whole file does: then what seems to be cut within it is damaged."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - len(_END)))
    return size > len(_END) and file.read() == _END


def is_being_written(path: Path) -> bool:
    """Whether a process is writing a file of a log now; LogError if it cannot be read."""
    return any(_locked(file) for file in log_files(path))


def unfinished(path: Path) -> str:
    """What it means that a log has no end, in a line for a person; empty if it has one.

    Raises LogError if it cannot be read.
    """
    if is_being_written(path):
        return f'log {str(path)!r} is being written: what it holds by now is used'
    if all(_has_end(file) for file in log_files(path)):
        return ''
    return (
        f'log {str(path)!r} was broken off: what it holds is used '
        '("resting_aspects recover" closes it)'
    )


def check_definition(path: Path, type_name: str, type_hash: str | None) -> None:
    """Raise LogError if a type is not installed, or the log was written with another definition.

    CDR does not say what is in it: read with another definition it would be nonsense.

    type_hash : str
        That of the log's definition; None if it does not say.
    """
    installed = load_schema(type_name).type_hash
    if type_hash not in (None, installed):
        raise LogError(
            f'log {str(path)!r} has {type_name} of type hash {type_hash!r}, allowed is that of '
            f'the installed definition: {installed!r}'
        )


def written_hash(channel: Channel) -> str | None:
    """The hash of the definition with which a channel was written, if the log says it."""
    return channel.metadata.get('topic_type_hash') or None


def _messages(path: Path, type_name: str) -> Iterator[Message]:
    """Messages of a type in the order of the file."""
    schemas: dict[int, str] = {}
    channels: set[int] = set()
    for record in records(path):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel) and schemas.get(record.schema_id) == type_name:
            check_definition(path, type_name, written_hash(record))
            channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id in channels:
            yield record
