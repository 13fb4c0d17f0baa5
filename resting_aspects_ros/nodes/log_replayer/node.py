"""The node that replays a log: topics of a log, the clock of its messages, and the node."""

import importlib
import posixpath
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from resting_aspects_ros.errors import InvalidValueError, LogError, one_line
from resting_aspects_ros.logs.bag import EXPECTED
from resting_aspects_ros.logs.reader import LoggedMessage, Recording
from resting_aspects_ros.logs.topics import check_definition
from resting_aspects_ros.ros.callbacks import advertise, steady_timer
from resting_aspects_ros.ros.conversions import NANOSECONDS, time_msg
from resting_aspects_ros.ros.health import (
    CLOCK,
    Diagnosis,
    LivelinessMonitor,
    announce,
    clock_conflicts,
    count_text,
    publish_diagnostics,
)
from resting_aspects_ros.ros.interface import (
    CELL,
    DROP_SIMULATOR,
    LATCHED,
    LOG_REPLAYER,
    PAUSE,
    POSES,
    RESUME,
    SERVICES,
    SURROUNDINGS_QOS,
)
from resting_aspects_ros.ros.program import Parameter, declare, run_node

# QoS of the suite's topics by their types, if the log has none. The name of a topic is that of its
# kind, followed by the part unless there is one topic for all parts.
_FOR_ALL = {'RestingPoses': POSES, 'DetectionArray': CELL, 'PickResult': CELL}
_BY_PART = {
    'PartDescription': LATCHED,
    'SurroundingsDescription': SURROUNDINGS_QOS,
    'AspectDistribution': LATCHED,
    'TransitionMatrix': LATCHED,
    'FeederAdvice': LATCHED,
    'ObservedCounts': LATCHED,
    'Posterior': LATCHED,
}
_PACKAGE = 'resting_aspects_interfaces/msg/'
# QoS of other topics if the log has none, as in rosbag2.
_OTHERS = QoSProfile(depth=10)


@dataclass(frozen=True)
class ReplayedTopic:
    """A topic of the log, with the name and QoS with which it is published.

    recorded : name in the log
    name : name relative to the replayer's namespace
    message : class of the messages
    """

    recorded: str
    name: str
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
            skipped.append(one_line(f'{topic.topic}: {reason}'))
            continue
        check_definition(recording.path, topic.type, topic.type_hash)
        name = topic.topic.removeprefix(namespace).removeprefix('/')
        replayed.append(
            ReplayedTopic(
                topic.topic, name, _message_class(recording, topic), _qos(recording, topic)
            )
        )
    if not replayed:
        raise LogError(
            f'log {str(recording.path)!r} has no topic that can be replayed: {"; ".join(skipped)}'
        )
    return replayed, skipped


def _namespace(topics: Iterable[LoggedMessage]) -> str:
    """Return the namespace of the recorded suite, such as '/cell_1' or '/'."""
    namespaces = set()
    for topic in topics:
        kind = topic.type.removeprefix(_PACKAGE)
        if kind in _FOR_ALL:
            namespaces.add(posixpath.dirname(topic.topic))
        elif kind in _BY_PART:
            namespaces.add(posixpath.dirname(posixpath.dirname(topic.topic)))
    return posixpath.commonpath(namespaces) if namespaces else '/'


def _skip_reason(topic: LoggedMessage, namespace: str) -> str:
    if not topic.topic.startswith(f'{namespace.rstrip("/")}/'):
        return f'not in {namespace}, the namespace of the suite in the log'
    try:
        validate_full_topic_name(topic.topic)  # DDS ends a program that uses a longer name
    except InvalidTopicNameException:
        return 'not a valid ROS topic name'
    if '/_' in topic.topic:
        return 'hidden, as the topics of an action are'
    encoding = topic.channel.message_encoding
    if encoding != 'cdr' or '/msg/' not in topic.type:
        return f'not ROS 2 messages (type {topic.type or "missing"}, encoding {encoding})'
    return ''


def _message_class(recording: Recording, topic: LoggedMessage) -> Any:
    package, _, short = topic.type.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), short)
    except (ImportError, AttributeError) as error:
        raise LogError(
            f'log {str(recording.path)!r} has topic {topic.topic} of type {topic.type}, but the '
            f'Python class of this type is not installed: {error}'
        ) from None


def _qos(recording: Recording, topic: LoggedMessage) -> QoSProfile:
    default = {**_FOR_ALL, **_BY_PART}.get(topic.type.removeprefix(_PACKAGE), _OTHERS)
    try:
        recorded = topic.qos
    except LogError as error:
        raise LogError(f'log {str(recording.path)!r}, topic {topic.topic}: {error}') from None
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


class LogPlayer:
    """Publishes a log, once or in a loop.

    Parameters
    ----------
    publish : called with each message
    rate : divides the recorded times; None publishes without pauses
    clock : returns monotonic time, ns

    Attributes
    ----------
    sent : number of messages published in this round
    round : number of the round, from 1; increases with each repetition of a loop
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
        self._start, self._length = recording.start, recording.end - recording.start
        self._publish = publish
        self._rate = rate
        self._loop = loop
        self._clock = clock
        self._paused_at: int | None = None
        self.round = 0
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
    def time(self) -> int:
        """Time in the log, ns since 1970; with a rate, it advances between two messages, too."""
        if self.over:
            return self._start + self._length
        if self._rate is None:
            return self._last
        now = self._clock() if self._paused_at is None else self._paused_at
        done = max(0, int((now - self._started) * self._rate))
        return self._start + min(self._length, done)

    @property
    def position(self) -> str:
        """The position as a text."""
        seconds, length = (self.time - self._start) / NANOSECONDS, self._length / NANOSECONDS
        return f'{seconds:.3f} s of {length:.3f} s, message {self.sent}'

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
        self._messages = self._recording.messages(self._topics)
        self._next = next(self._messages, None)
        self._last = self._start
        self.sent = 0
        self.round += 1
        self._started = self._clock() + PAUSE_BEFORE

    def _due(self, message: LoggedMessage) -> int:
        """Return the clock time of publication; relative to the start, so delays do not add up."""
        if self._rate is None:
            return self._started
        return self._started + int((message.time - self._start) / self._rate)

    def _send(self, message: LoggedMessage) -> None:
        self._publish(message)
        self._last = message.time
        self.sent += 1
        self._next = next(self._messages, None)
        if self._next is None and self._loop:
            self._begin()


MIN_RATE, MAX_RATE = 0.001, 1000.0
PARAMETERS = (
    Parameter('log', '', 'log to replay: the folder of a run, or an .mcap file'),
    Parameter('rate', 1.0, 'speed of the replay, relative to the recording', (MIN_RATE, MAX_RATE)),
    Parameter('as_fast_as_possible', False, 'ignore the recorded times, and the rate'),
    Parameter('loop', False, 'start again one second after the end'),
    Parameter('clock', False, 'publish the recorded time on /clock, for nodes with use_sim_time'),
)
# Maximum time between two messages on /clock, ns.
CLOCK_PERIOD = 100_000_000
# The largest number of seconds in a message with a time.
MAX_SECONDS = 2**31 - 1


class LogReplayer(Node):
    """Publishes the topics of a log, and /clock on request; serves ~/pause and ~/resume.

    It keeps running after the last message so that late subscribers receive latched topics.

    Parameters
    ----------
    given : values of parameters, which override those of --ros-args
    options : of rclpy.node.Node, such as the namespace and the context
    """

    def __init__(self, given: Mapping[str, Any] | None = None, **options: Any) -> None:
        overrides = [RosParameter(name, value=value) for name, value in (given or {}).items()]
        super().__init__(LOG_REPLAYER, parameter_overrides=overrides, **options)
        values = declare(self, PARAMETERS)
        if not values['log']:
            raise InvalidValueError(f"invalid log '': {EXPECTED}")
        recording = Recording(Path(values['log']))
        if values['clock'] and recording.end // NANOSECONDS > MAX_SECONDS:
            raise LogError(
                f'invalid log {str(recording.path)!r} with a message {recording.end} ns after '
                f'1970: expected at most {MAX_SECONDS} s, the latest time on {CLOCK}'
            )
        self._log = recording.path
        topics, skipped = replayed_topics(recording)
        self._outputs = {
            topic.recorded: advertise(self, topic.message, topic.name, topic.qos, overridable=True)
            for topic in topics
        }
        self._started = time.monotonic()
        self._player = LogPlayer(
            recording,
            topics,
            lambda message: self._outputs[message.topic].publish(message.data),
            rate=None if values['as_fast_as_possible'] else values['rate'],
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
        number = count_text(len(topics), 'topic', 'topics')
        self.get_logger().info(f'ready: {recording.path}, {number}')
        self._timer = steady_timer(self, 0.0, self._step)

    def _step(self) -> None:
        wait = self._player.play()
        if self._clock_output is not None:
            self._clock_output.publish(Clock(clock=time_msg(self._player.time)))
        if wait is None:
            self._timer.cancel()
        else:
            self._step_after(wait if self._clock_output is None else min(wait, CLOCK_PERIOD))
        if self._player.over:
            self.get_logger().info(
                f'replayed in {time.monotonic() - self._started:.3f} s: '
                f'{count_text(self._player.sent, "message", "messages")}; '
                'latched topics stay available until Ctrl-C'
            )

    def _step_after(self, wait: int) -> None:
        self._timer.timer_period_ns = wait
        self._timer.reset()

    def _diagnose(self) -> Diagnosis:
        player = self._player
        values = {
            'log': self._log,
            'at': player.position,
            'messages published': player.sent,
            'round': player.round,
        }
        state = 'over' if player.over else 'paused' if player.paused else 'replaying'
        warnings = []
        if self._simulators.count:
            warnings = [f'a {DROP_SIMULATOR} in this namespace publishes on the same topics']
            self.get_logger().warning(warnings[0], once=True)
        if self._clock_output is not None:
            warnings += clock_conflicts(self)
        return Diagnosis(state, values, warnings)

    def _pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._player.pause()
        return self._answer(response, 'paused')

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._player.paused:
            self._player.resume()
            self._step_after(0)
        return self._answer(response, 'replaying')

    def _answer(self, response: Trigger.Response, state: str) -> Trigger.Response:
        player = self._player
        response.success = not player.over
        response.message = f'{"over" if player.over else state}, at {player.position}'
        self.get_logger().info(response.message)
        return response


def main() -> int:
    """Run the node alone in this process."""
    return run_node(LogReplayer, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
