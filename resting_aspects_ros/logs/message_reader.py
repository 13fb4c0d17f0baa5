"""Read a log, whole or broken off: messages as the bytes that were on the wire."""

from collections.abc import Collection, Iterator
from pathlib import Path

from mcap.records import Channel, Message

from resting_aspects_ros.core.errors import LogError, NoLogError, shown
from resting_aspects_ros.core.input_file import is_file, is_folder, named
from resting_aspects_ros.logs.mcap_format import MAGIC
from resting_aspects_ros.logs.message_definitions import load_schema
from resting_aspects_ros.logs.record_reader import EXPECTED, LogFile

_SUFFIX = '.mcap'
_BEGINS = MAGIC[:5]


def is_log(path: Path) -> bool:
    """Whether it is meant to be a log: a folder, or an MCAP file by its name or first bytes."""
    if is_folder(path) or path.suffix == _SUFFIX:
        return True
    if not is_file(path):
        return False  # nothing, or a pipe, of which what is read is gone
    try:
        with path.open('rb') as file:
            return file.read(len(_BEGINS)) == _BEGINS
    except OSError:
        return False


def messages(path: Path, type_name: str) -> Iterator[bytes]:
    """Read all messages of a type, in CDR, in their order.

    The index at the end of a file is not needed: of a log that was broken off, or is still being
    written, what is whole in it counts.

    path : Path
        The folder of a run, or its MCAP file.
    type_name : str
        `resting_aspects_interfaces/msg/AspectDistribution`.

    Raises LogError if it is no log, cannot be read, is damaged, or was written with another
    definition of the type than the installed one.
    """
    with LogFile(one_file(path)) as file:
        for _, message in typed_messages(file, [type_name]):
            yield message.data


def typed_messages(file: LogFile, types: Collection[str]) -> Iterator[tuple[str, Message]]:
    """Read all messages of some types in a file, each with its type; raises as messages."""
    checked: set[int] = set()
    for record in file.records():
        if not isinstance(record, Message):
            continue
        type_name = file.type_of(record.channel_id)
        if type_name in types:
            if record.channel_id not in checked:
                channel = file.channels[record.channel_id]
                check_definition(file.path, type_name, written_hash(channel))
                checked.add(record.channel_id)
            yield type_name, record


def one_file(path: Path) -> Path:
    """Return the MCAP file of a log; NoLogError for a folder with none, LogError with several."""
    if not is_folder(path):
        return path
    found = list(filter(is_file, path.glob(f'*{_SUFFIX}')))
    if len(found) > 1:
        raise LogError(
            f'invalid {named("log", path)}: expected one {_SUFFIX} file, found {len(found)}'
        )
    if not found:
        message = f'{named("folder", path)} is not a log: it has no {_SUFFIX} file'
        if logs := len({file.parent for file in path.glob(f'*/*{_SUFFIX}')}):
            message += f', but {logs} of its subfolders have one'
        raise NoLogError(f'{message}; {EXPECTED}')
    return found[0]


def is_being_written(path: Path) -> bool:
    """Whether a process is writing a log now; LogError if it cannot be read."""
    with LogFile(one_file(path)) as file:
        return file.being_written


def unfinished(path: Path) -> str:
    """Return what it means that a log has no end, in a line for a person; empty if it has one.

    Raises LogError if it cannot be read.
    """
    with LogFile(one_file(path)) as file:
        return state_text(path, being_written=file.being_written, finished=file.finished)


def state_text(path: Path, *, being_written: bool, finished: bool) -> str:
    """Return the warning for a log that is used in this state; empty if it is closed."""
    if being_written:
        return f'{named("log", path)} is being written: the messages in it so far are used'
    if finished:
        return ''
    return (
        f'{named("log", path)} was not closed: the messages in it are used '
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
            f'{named("log", path)} was recorded by another version of resting_aspects_ros, whose '
            f'{type_name} has the type hash {shown(type_hash)}: expected that of the installed '
            f'version, {installed!r}'
        )


def written_hash(channel: Channel) -> str | None:
    """Return the hash of the definition with which a channel was written, if the log says it."""
    return channel.metadata.get('topic_type_hash') or None
