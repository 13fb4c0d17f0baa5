"""Reading of logs, closed or not: messages by type, and for playback."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.errors import LogError, one_line
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.bag import OUTCOME, LogOutcome, log_files
from resting_aspects_ros.logs.mcap_file import LoggedMessage, McapFile
from resting_aspects_ros.logs.topics import Qos, check_definition, recorded_qos


@contextmanager
def open_log(path: Path) -> Iterator[Log]:
    """Open a log for reading, as a context manager.

    path : Path
        A folder, its metadata.yaml, or an MCAP file.

    Raises NoLogError if a file cannot be opened or is not an MCAP file, LogError as `log_files`.
    """
    with ExitStack() as stack:
        yield Log(path, [McapFile(file, stack) for file in log_files(path)])


class Log:
    """A log of one or several open files.

    path : Path
        The MCAP file; of a split bag, the path that was given.
    closed : bool
        Whether each file has the end of a closed file.
    being_written : bool
        Whether a process is writing a file.
    """

    def __init__(self, path: Path, files: list[McapFile]) -> None:
        self._files = files
        self._name = named('log', path)
        self.path = path if len(files) > 1 else files[0].path
        self.closed = all(file.closed for file in files)
        self.being_written = any(file.being_written for file in files)

    @property
    def message_count(self) -> int:
        """Number of messages that were read."""
        return sum(file.message_count for file in self._files)

    @property
    def outcome(self) -> LogOutcome | None:
        """The outcome that a closed log records; known after all messages were read."""
        found = [file.metadata[OUTCOME] for file in self._files if OUTCOME in file.metadata]
        return LogOutcome.of(found[-1]) if found and self.closed else None

    @property
    def warning(self) -> str:
        """The warning for a log that is not closed; empty for a closed one."""
        if self.being_written:
            return f'{self._name} is being written: the messages in it so far are used'
        if self.closed:
            return ''
        return (
            f'{self._name} was not closed: the messages in it are used '
            '("resting_aspects recover" closes it)'
        )

    def messages(self) -> Iterator[LoggedMessage]:
        """Yield all messages in file order; of a split bag, in time order.

        From a log that was not closed, or is being written, all complete messages are read. Raises
        LogError if a file cannot be read or is damaged, which may be detected only at its end.
        """
        each = (file.messages() for file in self._files)
        return heapq.merge(*each, key=lambda message: message.time)

    def of_types(self, types: Collection[str]) -> Iterator[LoggedMessage]:
        """Yield all messages of the types.

        Raises LogError as `messages`, or if a message was written with a definition of its type
        that differs from the installed one.
        """
        checked: set[tuple[str, str | None]] = set()
        for message in self.messages():
            if (kind := message.type) in types:
                if (kind, message.type_hash) not in checked:
                    check_definition(self.path, kind, message.type_hash)
                    checked.add((kind, message.type_hash))
                yield message


def messages(path: Path, type_name: str) -> Iterator[bytes]:
    """Yield all messages of a type in a log as CDR; see `Log.of_types`."""
    with open_log(path) as log:
        for message in log.of_types([type_name]):
            yield message.data


# -- playback -------------------------------------------------------------------------------------


@dataclass
class RecordedTopic:
    """A topic as described by a log of any writer.

    encoding : str
        Encoding of the messages: `cdr` in a log of ROS 2.
    qos : Qos
        None if it is not recorded.
    type_hash : str
        None if it is not recorded.
    start, end : int
        Log times of the first and the last message, ns since 1970.
    """

    name: str
    type: str
    encoding: str
    qos: Qos | None
    type_hash: str | None
    start: int
    end: int


class Recording:
    """The messages of a log, which is read once for its topics and again for each playback.

    The log may be one that was not closed or is being written. At most one chunk is in memory at
    a time.

    path : Path
        A folder, its metadata.yaml, or an MCAP file.

    Raises LogError if it is not a log, cannot be read, is damaged before its end, or has no
    message.

    topics : dict
        The topics that have messages, by name.
    warning : str
        See `Log.warning`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, RecordedTopic] = {}
        with open_log(path) as log:
            self.warning = log.warning
            for message in _in_time(log):
                self._add(message)
        if not self.topics:
            raise LogError(f'invalid log {str(path)!r}: expected at least one message, found none')

    def messages(self, topics: Collection[str]) -> Iterator[LoggedMessage]:
        """Yield the messages of some topics in time order; times never decrease."""
        with open_log(self.path) as log:
            for message in _in_time(log):
                if message.topic in topics:
                    yield message

    def _add(self, message: LoggedMessage) -> None:
        name = message.topic
        if name not in self.topics:
            self.topics[name] = self._topic(message)
        known = self.topics[name]
        if (message.type, message.type_hash) != (known.type, known.type_hash):
            raise LogError(
                one_line(
                    f'invalid log {str(self.path)!r}: expected one type for topic {name}, '
                    f'found {message.type} ({message.type_hash}) and {known.type} '
                    f'({known.type_hash})',
                    600,
                )
            )
        known.end = message.time

    def _topic(self, message: LoggedMessage) -> RecordedTopic:
        channel, time = message.channel, message.time
        try:
            qos = recorded_qos(channel.metadata.get('offered_qos_profiles', ''))
        except LogError as error:
            topic = one_line(channel.topic)
            raise LogError(f'{named("log", self.path)}, topic {topic}: {error}') from None
        encoding = channel.message_encoding
        return RecordedTopic(
            channel.topic, message.type, encoding, qos, message.type_hash, time, time
        )


def _in_time(log: Log) -> Iterator[LoggedMessage]:
    """Yield the messages with log times that do not decrease."""
    time = 0
    for each in log.messages():
        time = each.message.log_time = max(time, each.time)
        yield each
