"""Reading of a log for playback: its topics, its time span, and its messages in time order."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from mcap.records import Channel, Message

from resting_aspects_ros.errors import LogError, one_line
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.message_reader import written_hash
from resting_aspects_ros.logs.split_log import open_log
from resting_aspects_ros.logs.topic_metadata import Qos, recorded_qos


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


@dataclass(frozen=True)
class RecordedMessage:
    """A serialized message.

    topic : str
        Name of the topic in the log.
    time : int
        Log time, ns since 1970.
    """

    topic: str
    time: int
    data: bytes


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
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, RecordedTopic] = {}
        self._spans: dict[str, Span] = {}
        self._count = 0
        for topic, message in _read(path):
            known = self.topics.setdefault(topic.name, topic)
            if (topic.type, topic.type_hash) != (known.type, known.type_hash):
                raise LogError(
                    one_line(
                        f'invalid log {str(path)!r}: expected one type for topic {topic.name}, '
                        f'found {topic.type} ({topic.type_hash}) and {known.type} '
                        f'({known.type_hash})',
                        600,
                    )
                )
            span = self._spans.setdefault(topic.name, Span(message.time, message.time, 0))
            span.end = message.time
            span.messages += 1
            self._count += 1
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
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics in time order; times never decrease.

        first : names of topics
            The first message of each of these topics is yielded before all other messages, with
            the time of the first message of all.
        """
        waiting = set(first)
        start = self.span(topics).start
        for message in self._all() if waiting else ():
            if message.topic in waiting:
                waiting.remove(message.topic)
                yield replace(message, time=start)
            if not waiting:
                break
        yielded = set(first) - waiting
        for message in self._all():
            if message.topic in yielded:
                yielded.remove(message.topic)
            elif message.topic in topics:
                yield message

    def _all(self) -> Iterator[RecordedMessage]:
        """Yield the messages that were complete when the log was read for its topics."""
        return islice((message for _, message in _read(self.path)), self._count)


def _read(path: Path) -> Iterator[tuple[RecordedTopic, RecordedMessage]]:
    topics: dict[int, RecordedTopic] = {}
    time = 0
    with open_log(path) as file:
        for record in file.records():
            if isinstance(record, Message):
                key = record.channel_id
                if key not in topics:
                    topics[key] = _topic(path, file.channels[key], file.type_of(key))
                time = max(time, record.log_time)
                yield topics[key], RecordedMessage(topics[key].name, time, record.data)


def _topic(path: Path, channel: Channel, type_name: str) -> RecordedTopic:
    try:
        qos = recorded_qos(channel.metadata.get('offered_qos_profiles', ''))
    except LogError as error:
        topic = one_line(channel.topic)
        raise LogError(f'{named("log", path)}, topic {topic}: {error}') from None
    return RecordedTopic(
        channel.topic, type_name, channel.message_encoding, qos, written_hash(channel)
    )
