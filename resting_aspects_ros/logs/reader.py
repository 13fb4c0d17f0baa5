"""Reading of logs, closed or not: messages by type, through the index, and for playback."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
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
    def has_index(self) -> bool:
        """Whether the log is one closed file whose index covers all messages."""
        return len(self._files) == 1 and self._files[0].index is not None

    @property
    def message_count(self) -> int:
        """Number of messages according to the index; otherwise of those that were read."""
        return sum(file.message_count for file in self._files)

    @property
    def outcome(self) -> LogOutcome | None:
        """The outcome that a closed log records; without an index, known after it was read."""
        if not self.closed:
            return None
        if self.has_index:
            return LogOutcome.of(self._files[0].indexed_metadata(OUTCOME))
        found = [file.metadata[OUTCOME] for file in self._files if OUTCOME in file.metadata]
        return LogOutcome.of(found[-1]) if found else None

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

    def first(self, type_name: str) -> bytes | None:
        """Return the first message of a type in a file with an index; None if there is none."""
        return self._indexed(type_name, last=False)

    def last(self, type_name: str) -> bytes | None:
        """Return the last message of a type in a file with an index; None if there is none."""
        return self._indexed(type_name, last=True)

    def _indexed(self, type_name: str, *, last: bool) -> bytes | None:
        found = self._files[0].indexed_message(type_name, last=last)
        if found is None:
            return None
        check_definition(self.path, type_name, found.type_hash)
        return found.data


def messages(path: Path, type_name: str) -> Iterator[bytes]:
    """Yield all messages of a type in a log as CDR; see `Log.of_types`."""
    with open_log(path) as log:
        for message in log.of_types([type_name]):
            yield message.data


# -- playback -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RecordedTopic:
    """A topic as described by a log of any writer.

    encoding : str
        Encoding of the messages: `cdr` in a log of ROS 2.
    qos : Qos
        None if it is not recorded.
    type_hash : str
        None if it is not recorded.
    """

    name: str
    type: str
    encoding: str
    qos: Qos | None
    type_hash: str | None


@dataclass
class Span:
    """Log times of the first and the last message, ns since 1970, and the number of messages."""

    start: int
    end: int
    messages: int


class Recording:
    """The complete messages of a log, which is read once for its topics and again for playback.

    No index is needed, so the log may be one that was not closed or is being written. At most one
    chunk is in memory at a time.

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
        self._spans: dict[str, Span] = {}
        with open_log(path) as log:
            self.warning = log.warning
            for message in _in_time(log):
                self._add(message)
        self._count = sum(span.messages for span in self._spans.values())
        if not self._count:
            raise LogError(f'invalid log {str(path)!r}: expected at least one message, found none')

    def span(self, topics: Collection[str]) -> Span:
        """Return the span of the messages of at least one topic."""
        spans = [self._spans[name] for name in topics]
        return Span(
            min(span.start for span in spans),
            max(span.end for span in spans),
            sum(span.messages for span in spans),
        )

    def messages(
        self, topics: Collection[str], first: Collection[str] = ()
    ) -> Iterator[LoggedMessage]:
        """Yield the messages of some topics in time order; times never decrease.

        first : names of topics
            The first message of each of these topics is yielded before all other messages, with
            the time of the first message of all.
        """
        early: dict[str, LoggedMessage] = {}
        for message in self._all() if first else ():
            if message.topic in first:
                early.setdefault(message.topic, message)
            if len(early) == len(first):
                break
        start = self.span(topics).start
        for each in early.values():
            each.message.log_time = start
            yield each
        for message in self._all():
            if early.pop(message.topic, None) is None and message.topic in topics:
                yield message

    def _add(self, message: LoggedMessage) -> None:
        name, time = message.topic, message.time
        if name not in self.topics:
            self.topics[name] = self._topic(message)
            self._spans[name] = Span(time, time, 0)
        known, span = self.topics[name], self._spans[name]
        if (message.type, message.type_hash) != (known.type, known.type_hash):
            raise LogError(
                one_line(
                    f'invalid log {str(self.path)!r}: expected one type for topic {name}, '
                    f'found {message.type} ({message.type_hash}) and {known.type} '
                    f'({known.type_hash})',
                    600,
                )
            )
        span.end = time
        span.messages += 1

    def _topic(self, message: LoggedMessage) -> RecordedTopic:
        channel = message.channel
        try:
            qos = recorded_qos(channel.metadata.get('offered_qos_profiles', ''))
        except LogError as error:
            topic = one_line(channel.topic)
            raise LogError(f'{named("log", self.path)}, topic {topic}: {error}') from None
        return RecordedTopic(
            channel.topic, message.type, channel.message_encoding, qos, message.type_hash
        )

    def _all(self) -> Iterator[LoggedMessage]:
        """Yield the messages that were complete when the log was read for its topics."""
        with open_log(self.path) as log:
            yield from islice(_in_time(log), self._count)


def _in_time(log: Log) -> Iterator[LoggedMessage]:
    """Yield the messages with log times that do not decrease."""
    time = 0
    for each in log.messages():
        time = each.message.log_time = max(time, each.time)
        yield each
