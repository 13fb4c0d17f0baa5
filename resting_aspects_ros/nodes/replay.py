"""A log on its way out, message by message."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.logs.recording import RecordedMessage, Recording
from resting_aspects_ros.nodes.batch_length import poses_in
from resting_aspects_ros.nodes.convert import NANOSECONDS
from resting_aspects_ros.nodes.replay_pace import Pace
from resting_aspects_ros.nodes.replay_topics import ReplayedTopic

# Before the first message, for readers to find the topics, and between the rounds of a loop, ns.
PAUSE_BEFORE = NANOSECONDS
# Messages that are due are published for so long at a time, ns: services are answered meanwhile.
SLICE = NANOSECONDS // 20


@dataclass(frozen=True)
class Position:
    """Where a replay is.

    seconds : of the log that are over, s
    length : of the log, s
    messages, drops : published since it began, the last time
    round : 1 for the first, one more each time that a loop begins again
    """

    seconds: float
    length: float
    messages: int
    drops: int
    round: int
    paused: bool
    over: bool

    def __str__(self) -> str:
        return f'{self.seconds:.3f} s of {self.length:.3f} s, {self.drops} drops'


class Replay:
    """Publishes a log: once, or with ``loop`` over and over. Parts come first.

    publish : called with each message
    """

    def __init__(
        self,
        recording: Recording,
        topics: Sequence[ReplayedTopic],
        publish: Callable[[RecordedMessage], object],
        pace: Pace,
        *,
        loop: bool,
    ) -> None:
        self._recording = recording
        self._names = {topic.recorded for topic in topics}
        self._parts = {topic.recorded for topic in topics if topic.describes_part}
        self._poses = {topic.recorded for topic in topics if topic.holds_poses}
        self._span = recording.span(self._names)
        self._publish = publish
        self._pace = pace
        self._loop = loop
        self._paused_at: int | None = None
        self._round = 0
        self._begin()

    @property
    def over(self) -> bool:
        """Whether the end is reached for good."""
        return self._next is None

    @property
    def paused(self) -> bool:
        """Whether it waits for ``resume``."""
        return self._paused_at is not None

    @property
    def position(self) -> Position:
        """Where it is now."""
        now = time.monotonic_ns() if self._paused_at is None else self._paused_at
        length = self._span.end - self._span.start
        done = length if self.over else min(length, self._pace.reached(now) - self._span.start)
        return Position(
            done / NANOSECONDS,
            length / NANOSECONDS,
            self._sent,
            self._drops,
            self._round,
            self.paused,
            self.over,
        )

    def pause(self) -> None:
        """Publish nothing, and let no time go by."""
        if not self.paused and not self.over:
            self._paused_at = time.monotonic_ns()

    def resume(self) -> None:
        """Go on where it was paused."""
        if self._paused_at is not None:
            self._pace.delay(time.monotonic_ns() - self._paused_at)
            self._paused_at = None

    def play(self) -> int | None:
        """Publish what is due; ns until it is to be called again, None if it need not be."""
        end = time.monotonic_ns() + SLICE
        while self._next is not None and not self.paused:
            now = time.monotonic_ns()
            wait = self._pace.wait(self._next, now)
            if wait or now > end:
                return wait
            self._send(self._next, now)
        return None

    def _begin(self) -> None:
        self._messages = self._recording.messages(self._names, first=self._parts)
        self._next = next(self._messages, None)
        self._sent = self._drops = 0
        self._round += 1
        self._pace.begin(self._span.start, time.monotonic_ns() + PAUSE_BEFORE)

    def _send(self, message: RecordedMessage, now: int) -> None:
        drops = self._drops_in(message)
        self._publish(message)
        self._pace.sent(message, now)
        self._sent += 1
        self._drops += drops
        self._next = next(self._messages, None)
        if self._next is None and self._loop:
            self._begin()

    def _drops_in(self, message: RecordedMessage) -> int:
        if message.topic not in self._poses:
            return 0
        try:
            return poses_in(message.data)
        except LogError as error:
            path = str(self._recording.path)
            raise LogError(f'log {path!r}, topic {message.topic}: {error}') from None
