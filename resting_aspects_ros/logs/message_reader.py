"""Reading of logs, closed or not; messages are returned as serialized bytes."""

from collections.abc import Collection, Iterator
from pathlib import Path

from mcap.records import Channel, Message

from resting_aspects_ros.errors import LogError, shown
from resting_aspects_ros.input_files import is_file, is_folder, named
from resting_aspects_ros.logs.bag_files import is_mcap
from resting_aspects_ros.logs.bag_metadata import FILE_NAME
from resting_aspects_ros.logs.mcap_format import MAGIC
from resting_aspects_ros.logs.message_definitions import load_schema
from resting_aspects_ros.logs.record_reader import LogFile
from resting_aspects_ros.logs.split_log import SplitLog, open_log

_MAGIC_START = MAGIC[:5]


def is_log(path: Path) -> bool:
    """Return whether a path looks like a log: a folder, or MCAP by its suffix or first bytes."""
    if is_folder(path) or is_mcap(path) or path.name == FILE_NAME:
        return True
    if not is_file(path):
        return False  # it does not exist, or is a pipe, whose data can be read only once
    try:
        with path.open('rb') as file:
            return file.read(len(_MAGIC_START)) == _MAGIC_START
    except OSError:
        return False


def messages(path: Path, type_name: str) -> Iterator[bytes]:
    """Yield all messages of a type as CDR, in file order; of a split bag, in time order.

    The index at the end of the file is not needed. From a log that was not closed, or is being
    written, all complete messages are read.

    path : Path
        A folder, its metadata.yaml, or an MCAP file.
    type_name : str
        `resting_aspects_interfaces/msg/AspectDistribution`.

    Raises LogError if it is not a log, cannot be read, is damaged, or was written with a
    definition of the type that differs from the installed one.
    """
    with open_log(path) as file:
        for _, message in typed_messages(file, [type_name]):
            yield message.data


def typed_messages(
    file: LogFile | SplitLog, types: Collection[str]
) -> Iterator[tuple[str, Message]]:
    """Yield all messages of the given types in a file, each with its type; see `messages`."""
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


def not_closed_warning(path: Path) -> str:
    """Return a warning if a log is not closed, otherwise an empty text.

    Raises LogError if it cannot be read.
    """
    with open_log(path) as file:
        return state_warning(path, being_written=file.being_written, finished=file.finished)


def state_warning(path: Path, *, being_written: bool, finished: bool) -> str:
    """Return the warning for a log in the given state; empty if it is closed."""
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

    CDR does not describe its content, so data read with another definition would be meaningless.

    type_hash : str
        Hash of the definition in the log; None if it is not recorded.
    """
    installed = load_schema(type_name).type_hash
    if type_hash not in (None, installed):
        raise LogError(
            f'{named("log", path)} was recorded by another version of resting_aspects_ros, whose '
            f'{type_name} has the type hash {shown(type_hash)}: expected that of the installed '
            f'version, {installed!r}'
        )


def written_hash(channel: Channel) -> str | None:
    """Return the hash of the definition with which a channel was written; None if unknown."""
    return channel.metadata.get('topic_type_hash') or None
