"""What a replay publishes when: topics of a log, and the clock of its messages."""

import importlib
import posixpath
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from resting_aspects_ros.errors import LogError, one_line
from resting_aspects_ros.logs.mcap_file import LoggedMessage
from resting_aspects_ros.logs.reader import RecordedTopic, Recording
from resting_aspects_ros.logs.topics import check_definition
from resting_aspects_ros.ros.conversions import NANOSECONDS
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    CELL,
    DETECTIONS,
    FEEDER_ADVICE,
    LATCHED,
    OBSERVED_COUNTS,
    PARTS,
    PICK_RESULT,
    POSES,
    POSTERIOR,
    RESTING_POSES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    TRANSITIONS,
)

_MESSAGES = 'resting_aspects_interfaces/msg'
# Type of the suite's topics, by the beginning of their names, and their QoS if the log has none.
_SUITE = {
    RESTING_POSES: (f'{_MESSAGES}/RestingPoses', POSES),
    PARTS: (f'{_MESSAGES}/PartDescription', LATCHED),
    SURROUNDINGS: (f'{_MESSAGES}/SurroundingsDescription', SURROUNDINGS_QOS),
    ASPECT_DISTRIBUTIONS: (f'{_MESSAGES}/AspectDistribution', LATCHED),
    TRANSITIONS: (f'{_MESSAGES}/TransitionMatrix', LATCHED),
    DETECTIONS: (f'{_MESSAGES}/DetectionArray', CELL),
    PICK_RESULT: (f'{_MESSAGES}/PickResult', CELL),
    FEEDER_ADVICE: (f'{_MESSAGES}/FeederAdvice', LATCHED),
    OBSERVED_COUNTS: (f'{_MESSAGES}/ObservedCounts', LATCHED),
    POSTERIOR: (f'{_MESSAGES}/Posterior', LATCHED),
}
_SINGLE = (RESTING_POSES, DETECTIONS, PICK_RESULT)
_SUITE_TOPIC = re.compile(
    rf'(?P<namespace>(?:/\w+)*)/'
    rf'(?:{"|".join(_SINGLE)}|(?:{"|".join(_SUITE.keys() - set(_SINGLE))})/\w+)',
    re.ASCII,
)
# QoS of other topics if the log has none, as in rosbag2.
_OTHERS = QoSProfile(depth=10)

# A topic name that is valid in ROS and not hidden; the topics of an action are hidden.
_NAME = re.compile(r'(/[A-Za-z]\w*)+', re.ASCII)
_MAX_NAME_LENGTH = 247  # DDS terminates a program that uses a longer name
_TYPE = re.compile(r'[A-Za-z]\w*/msg/[A-Za-z]\w*', re.ASCII)


@dataclass(frozen=True)
class ReplayedTopic:
    """A topic of the log, with the name and QoS with which it is published.

    recorded : name in the log
    name : name relative to the replayer's namespace
    message : class of the messages
    """

    recorded: str
    name: str
    type: str
    message: Any
    qos: QoSProfile

    @property
    def describes_run(self) -> bool:
        """Whether the topic is parts/<part> or surroundings/<part>."""
        return self.type in (_SUITE[PARTS][0], _SUITE[SURROUNDINGS][0])


def replayed_topics(recording: Recording) -> tuple[list[ReplayedTopic], list[str]]:
    """Return the topics that can be replayed, and for each other topic its name and the reason.

    The namespace in which the suite was recorded is removed from the names. If several suites were
    recorded, it is their common namespace.

    Raises LogError if no topic can be replayed, or if the type of a topic is not installed or its
    definition differs from that in the log.
    """
    namespace = _namespace(recording.topics.values())
    replayed, skipped = [], []
    for topic in recording.topics.values():
        reason = _skip_reason(topic, namespace)
        if reason:
            skipped.append(one_line(f'{topic.name}: {reason}'))
            continue
        check_definition(recording.path, topic.type, topic.type_hash)
        name = topic.name.removeprefix(namespace).removeprefix('/')
        message = _message_class(recording, topic)
        replayed.append(ReplayedTopic(topic.name, name, topic.type, message, _qos(topic)))
    if not replayed:
        raise LogError(
            f'log {str(recording.path)!r} has no topic that can be replayed: {"; ".join(skipped)}'
        )
    return replayed, skipped


def _namespace(topics: Iterable[RecordedTopic]) -> str:
    """Return the namespace of the recorded suite, such as '/cell_1' or '/'."""
    namespaces = {
        match['namespace'] or '/'
        for topic in topics
        if (match := _SUITE_TOPIC.fullmatch(topic.name)) and topic.type in _types()
    }
    return posixpath.commonpath(namespaces) if namespaces else '/'


def _types() -> set[str]:
    return {type_name for type_name, _ in _SUITE.values()}


def _skip_reason(topic: RecordedTopic, namespace: str) -> str:
    if not topic.name.startswith(f'{namespace.rstrip("/")}/'):
        return f'not in {namespace}, the namespace of the suite in the log'
    if not _NAME.fullmatch(topic.name) or len(topic.name) > _MAX_NAME_LENGTH:
        return 'hidden, or not a valid ROS topic name'
    if topic.encoding != 'cdr' or not _TYPE.fullmatch(topic.type):
        return f'not ROS 2 messages (type {topic.type or "missing"}, encoding {topic.encoding})'
    return ''


def _message_class(recording: Recording, topic: RecordedTopic) -> Any:
    package, _, short = topic.type.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), short)
    except (ImportError, AttributeError) as error:
        raise LogError(
            f'log {str(recording.path)!r} has topic {topic.name} of type {topic.type}, but the '
            f'Python class of this type is not installed: {error}'
        ) from None


def _qos(topic: RecordedTopic) -> QoSProfile:
    default = dict(_SUITE.values()).get(topic.type, _OTHERS)
    recorded = topic.qos
    if recorded is None:
        return default
    return QoSProfile(
        depth=recorded.depth or default.depth,
        history=HistoryPolicy.get_from_short_key(recorded.history),
        reliability=ReliabilityPolicy.get_from_short_key(recorded.reliability),
        durability=DurabilityPolicy.get_from_short_key(recorded.durability),
    )


# Pause before each round, in which subscribers can discover the topics, ns.
PAUSE_BEFORE = NANOSECONDS
# Maximum time for which messages are published without a break, so that services respond, ns.
SLICE = NANOSECONDS // 20


@dataclass(frozen=True)
class ReplayPosition:
    """The position of a replay.

    time : time in the log, ns since 1970
    seconds : time since the start of the log, s
    length : length of the log, s
    messages : number of messages published in this round
    round : number of the round, from 1; increases with each repetition of a loop
    """

    time: int
    seconds: float
    length: float
    messages: int
    round: int
    paused: bool
    over: bool

    def __str__(self) -> str:
        return f'{self.seconds:.3f} s of {self.length:.3f} s, message {self.messages}'


class LogPlayer:
    """Publishes a log, once or in a loop.

    The descriptions of parts and surroundings are published first.

    publish : called with each message
    rate : divides the recorded times; None publishes without pauses
    clock : returns monotonic time, ns
    """

    def __init__(
        self,
        recording: Recording,
        topics: Sequence[ReplayedTopic],
        publish: Callable[[LoggedMessage], object],
        *,
        rate: float | None,
        loop: bool,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._recording = recording
        self._topics = {topic.recorded for topic in topics}
        self._descriptions = {topic.recorded for topic in topics if topic.describes_run}
        self._span = recording.span(self._topics)
        self._publish = publish
        self._rate = rate
        self._loop = loop
        self._clock = clock
        self._paused_at: int | None = None
        self._round = 0
        self._begin()

    @property
    def over(self) -> bool:
        """Whether the last message has been published and no round follows."""
        return self._next is None

    @property
    def paused(self) -> bool:
        """Whether the player waits for ``resume``."""
        return self._paused_at is not None

    @property
    def position(self) -> ReplayPosition:
        """The current position; with a rate, it advances between two messages as well."""
        length = self._span.end - self._span.start
        done = length if self.over else min(length, self._elapsed())
        return ReplayPosition(
            self._span.start + done,
            done / NANOSECONDS,
            length / NANOSECONDS,
            self._sent,
            self._round,
            self.paused,
            self.over,
        )

    def pause(self) -> None:
        """Publish nothing until ``resume``."""
        if not self.paused and not self.over:
            self._paused_at = self._clock()

    def resume(self) -> None:
        """Continue where it was paused."""
        if self._paused_at is not None:
            self._started += self._clock() - self._paused_at
            self._paused_at = None

    def play(self) -> int | None:
        """Publish messages that are due; return the time until the next call, ns, or None."""
        end = self._clock() + SLICE
        while self._next is not None and not self.paused:
            now = self._clock()
            wait = max(0, self._due(self._next) - now)
            if wait or now > end:
                return wait
            self._send(self._next)
        return None

    def _begin(self) -> None:
        self._messages = self._recording.messages(self._topics, first=self._descriptions)
        self._next = next(self._messages, None)
        self._last = self._span.start
        self._sent = 0
        self._round += 1
        self._started = self._clock() + PAUSE_BEFORE

    def _elapsed(self) -> int:
        """Return the current time in the log, ns since its start."""
        if self._rate is None:
            return self._last - self._span.start
        now = self._clock() if self._paused_at is None else self._paused_at
        return max(0, int((now - self._started) * self._rate))

    def _due(self, message: LoggedMessage) -> int:
        """Return the clock time of publication; relative to the start, so delays do not add up."""
        if self._rate is None:
            return self._started
        return self._started + int((message.time - self._span.start) / self._rate)

    def _send(self, message: LoggedMessage) -> None:
        self._publish(message)
        self._last = message.time
        self._sent += 1
        self._next = next(self._messages, None)
        if self._next is None and self._loop:
            self._begin()
