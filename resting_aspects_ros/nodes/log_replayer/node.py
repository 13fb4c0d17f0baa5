"""The node that replays a log: topics of a log, the clock of its messages, and the node."""

import importlib
import posixpath
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from resting_aspects_ros.errors import InvalidValueError, LogError, one_line
from resting_aspects_ros.logs.bag import EXPECTED
from resting_aspects_ros.logs.mcap_file import LoggedMessage
from resting_aspects_ros.logs.reader import RecordedTopic, Recording
from resting_aspects_ros.logs.topics import check_definition
from resting_aspects_ros.ros.callbacks import advertise, steady_timer
from resting_aspects_ros.ros.conversions import NANOSECONDS, time_msg
from resting_aspects_ros.ros.diagnostics import Diagnosis, count_text, publish_diagnostics
from resting_aspects_ros.ros.discovery import CLOCK, LivelinessMonitor, announce, clock_conflicts
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    CELL,
    DETECTIONS,
    DROP_SIMULATOR,
    FEEDER_ADVICE,
    LATCHED,
    LOG_REPLAYER,
    OBSERVED_COUNTS,
    PARTS,
    PAUSE,
    PICK_RESULT,
    POSES,
    POSTERIOR,
    RESTING_POSES,
    RESUME,
    SERVICES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    TRANSITIONS,
)
from resting_aspects_ros.ros.program import Parameter, declare, run_node

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
    types = {type_name for type_name, _ in _SUITE.values()}
    namespaces = {
        match['namespace'] or '/'
        for topic in topics
        if (match := _SUITE_TOPIC.fullmatch(topic.name)) and topic.type in types
    }
    return posixpath.commonpath(namespaces) if namespaces else '/'


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
        described = (_SUITE[PARTS][0], _SUITE[SURROUNDINGS][0])
        self._descriptions = {topic.recorded for topic in topics if topic.type in described}
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


MIN_RATE, MAX_RATE = 0.001, 1000.0
PARAMETERS = (
    Parameter('log', '', 'log to replay: the folder of a run, or an .mcap file'),
    Parameter('rate', 1.0, 'speed of the replay, relative to the recording', (MIN_RATE, MAX_RATE)),
    Parameter('as_fast_as_possible', False, 'ignore the recorded times; requires rate 1.0'),
    Parameter('loop', False, 'start again one second after the end'),
    Parameter('clock', False, 'publish the recorded time on /clock, for nodes with use_sim_time'),
)
# Maximum time between two calls of ``watch``, ns.
WATCH_PERIOD = 100_000_000


class LogReplayer(Node):
    """Publishes the topics of a log, and /clock on request; serves ~/pause and ~/resume.

    It keeps running after the last message so that late subscribers receive latched topics.

    Parameters
    ----------
    given : values of parameters, which override those of --ros-args
    options : of rclpy.node.Node, such as the namespace and the context
    """

    def __init__(
        self,
        given: Mapping[str, Any] | None = None,
        **options: Any,
    ) -> None:
        overrides = [RosParameter(name, value=value) for name, value in (given or {}).items()]
        super().__init__(LOG_REPLAYER, parameter_overrides=overrides, **options)
        values = declare(self, PARAMETERS)
        rate, fast = values['rate'], values['as_fast_as_possible']
        if fast and rate != 1.0:
            raise InvalidValueError(f'invalid rate {rate}: expected 1.0 with as_fast_as_possible')
        if not values['log']:
            raise InvalidValueError(f"invalid log '': {EXPECTED}")
        recording = Recording(Path(values['log']))
        self._log = recording.path
        topics, skipped = replayed_topics(recording)
        self._outputs = {
            topic.recorded: advertise(self, topic.message, topic.name, topic.qos, overridable=True)
            for topic in topics
        }
        self._started = time.monotonic()
        self._replay = LogPlayer(
            recording,
            topics,
            self._publish,
            rate=None if fast else rate,
            loop=values['loop'],
        )
        self._clock_output = (
            self.create_publisher(Clock, CLOCK, QoSProfile(depth=1)) if values['clock'] else None
        )
        self.create_service(Trigger, PAUSE, self._pause, qos_profile=SERVICES)
        self.create_service(Trigger, RESUME, self._resume, qos_profile=SERVICES)
        self._simulators = LivelinessMonitor(self, DROP_SIMULATOR)
        announce(self, LOG_REPLAYER)
        publish_diagnostics(self, self._diagnose)
        if recording.warning:
            self.get_logger().warning(recording.warning)
        for topic_and_reason in skipped:
            self.get_logger().warning(f'not replayed: {topic_and_reason}')
        self.get_logger().info(
            f'ready: {recording.path}, {count_text(len(topics), "topic", "topics")}, '
            f'{self._replay.position.length:.3f} s'
        )
        self._timer = steady_timer(self, 0.0, self._step)

    def _publish(self, message: LoggedMessage) -> None:
        self._outputs[message.topic].publish(message.data)

    def _step(self) -> None:
        wait = self._replay.play()
        position = self._replay.position
        if self._clock_output is not None:
            self._clock_output.publish(Clock(clock=time_msg(position.time)))
        if wait is None:
            self._timer.cancel()
        else:
            self._step_after(min(wait, WATCH_PERIOD))
        if position.over:
            self.get_logger().info(
                f'replayed in {time.monotonic() - self._started:.3f} s: '
                f'{count_text(position.messages, "message", "messages")}; '
                'latched topics stay available until Ctrl-C'
            )

    def _step_after(self, wait: int) -> None:
        self._timer.timer_period_ns = wait
        self._timer.reset()

    def _diagnose(self) -> Diagnosis:
        position = self._replay.position
        values = {
            'log': self._log,
            'at': position,
            'messages published': position.messages,
            'round': position.round,
        }
        state = 'over' if position.over else 'paused' if position.paused else 'replaying'
        warnings = []
        if self._simulators.count:
            warnings = [f'a {DROP_SIMULATOR} in this namespace publishes on the same topics']
            self.get_logger().warning(warnings[0], once=True)
        if self._clock_output is not None:
            warnings += clock_conflicts(self)
        return Diagnosis(state, values, warnings)

    def _pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._replay.paused:
            return self._answer(response, 'already paused')
        self._replay.pause()
        return self._answer(response, 'paused', changed=True)

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._replay.paused:
            return self._answer(response, 'not paused')
        self._replay.resume()
        self._step_after(0)
        return self._answer(response, 'resumed', changed=True)

    def _answer(
        self, response: Trigger.Response, state: str, *, changed: bool = False
    ) -> Trigger.Response:
        position = self._replay.position
        response.success = not position.over
        response.message = f'{"over" if position.over else state}, at {position}'
        if changed and not position.over:
            self.get_logger().info(response.message)
        return response


def main() -> int:
    """Run the node alone in this process."""
    return run_node(LogReplayer, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
