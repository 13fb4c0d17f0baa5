"""Playback of a log: decides when each message is published."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from resting_aspects_ros.logs.mcap_file import LoggedMessage
from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.nodes.log_replayer.topics import ReplayedTopic
from resting_aspects_ros.ros.conversions import NANOSECONDS

# Pause before each round, in which subscribers can discover the topics, ns.
PAUSE_BEFORE = NANOSECONDS
# Maximum time for which messages are published without a break, so that services respond, ns.
SLICE = NANOSECONDS // 20
# Time between two checks for acknowledgements, ns.
ACK_PERIOD = 2_000_000
# The player stops waiting for a subscriber that has not acknowledged within this time, ns. DDS
# itself removes a subscriber whose process died after 20 s.
ACK_TIMEOUT = 60 * NANOSECONDS


@dataclass(frozen=True)
class ReplayPosition:
    """The position of a replay.

    seconds : time since the start of the log, s
    length : length of the log, s
    messages : number of messages published in this round
    round : number of the round, from 1; increases with each repetition of a loop
    """

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
    acknowledged : returns whether all subscribers have received all messages of a recorded topic
    rate : divides the recorded times; None publishes as fast as subscribers acknowledge.
        Then, when the number of messages of a topic reaches its depth, the next message waits
        until they are acknowledged, so that DDS does not replace a message that a reliable
        subscriber has not received.
    warn : called with a text if a subscriber stops acknowledging
    clock : returns monotonic time, ns
    """

    def __init__(
        self,
        recording: Recording,
        topics: Sequence[ReplayedTopic],
        publish: Callable[[LoggedMessage], object],
        acknowledged: Callable[[str], bool],
        *,
        rate: float | None,
        loop: bool,
        warn: Callable[[str], object],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._recording = recording
        self._topics = {topic.recorded: topic for topic in topics}
        self._descriptions = {topic.recorded for topic in topics if topic.describes_run}
        self._span = recording.span(self._topics)
        self._publish = publish
        self._acknowledged = acknowledged
        self._rate = rate
        self._loop = loop
        self._warn = warn
        self._clock = clock
        self._unacknowledged: Counter[str] = Counter()
        self._waiting_since: int | None = None
        self._wait_for_subscribers = rate is None
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
            self._paused_at = self._waiting_since = None

    def play(self) -> int | None:
        """Publish messages that are due; return the time until the next call, ns, or None."""
        end = self._clock() + SLICE
        while self._next is not None and not self.paused:
            now = self._clock()
            wait = max(0, self._due(self._next) - now)
            if not wait and self._wait_for_subscribers and not self._has_room(self._next, now):
                wait = ACK_PERIOD
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

    def _has_room(self, message: LoggedMessage, now: int) -> bool:
        """Return whether publishing the message would not replace an unacknowledged one."""
        topic = message.topic
        if self._unacknowledged[topic] < self._topics[topic].qos.depth:
            return True
        if self._acknowledged(topic):
            self._unacknowledged[topic] = 0
            self._waiting_since = None
            return True
        if self._waiting_since is None:
            self._waiting_since = now
        if now - self._waiting_since > ACK_TIMEOUT:
            self._wait_for_subscribers = False
            self._warn(
                f'a subscriber of {self._topics[topic].name} has not acknowledged for '
                f'{ACK_TIMEOUT // NANOSECONDS} s: continuing without waiting, it may lose messages'
            )
        return not self._wait_for_subscribers

    def _send(self, message: LoggedMessage) -> None:
        self._publish(message)
        self._unacknowledged[message.topic] += 1
        self._last = message.time
        self._sent += 1
        self._next = next(self._messages, None)
        if self._next is None and self._loop:
            self._begin()
