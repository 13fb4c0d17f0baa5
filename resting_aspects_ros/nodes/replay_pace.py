"""When each message of a log is published: as it was recorded, or as fast as readers can take it.

Times of the clock are ns of one that never jumps; times of the log are its own.
"""

from abc import ABC, abstractmethod
from collections import deque

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile

from resting_aspects_ros.logs.recording import RecordedMessage
from resting_aspects_ros.nodes.convert import NANOSECONDS

# The slowest reader that loses nothing when messages come as fast as possible takes so many bytes
# per second, which are 6250 poses. An aspect_classifier with a core of its own takes 45,000.
READER_SPEED = 500_000
# How often it is looked whether readers have received what they were sent, ns.
ACK_PERIOD = 2_000_000
# Messages that DDS surely keeps for the readers of a topic that keeps all of them.
MOST_KEPT = 1000


class Pace(ABC):
    """Decides when messages go out. ``begin`` is called before anything else, and in each round.

    _start, _begun : log time and time of the clock at which the round began
    _reached : log time of the last message
    """

    def begin(self, start: int, now: int) -> None:
        """At ``now``, which may be yet to come, a round begins with the log time ``start``."""
        self._start = self._reached = start
        self._begun = now

    @abstractmethod
    def wait(self, message: RecordedMessage, now: int) -> int:
        """How long the message has yet to wait, ns; 0 if it may go out."""

    def sent(self, message: RecordedMessage, now: int) -> None:  # noqa: ARG002 - one needs it
        """The message went out."""
        self._reached = message.time

    def delay(self, pause: int) -> None:
        """Time stood still for so long, ns."""
        self._begun += pause

    def reached(self, now: int) -> int:  # noqa: ARG002 - one needs it
        """The log time that has been reached."""
        return self._reached


class RecordedPace(Pace):
    """The recorded times, divided by a rate: against the clock, so that no delay adds up."""

    def __init__(self, rate: float) -> None:
        self._rate = rate

    def wait(self, message: RecordedMessage, now: int) -> int:
        """How long until its time has come, ns."""
        due = self._begun + int((message.time - self._start) / self._rate)
        return max(0, due - now)

    def reached(self, now: int) -> int:
        """The log time that it is now, also between two messages."""
        return self._start + max(0, int((now - self._begun) * self._rate))


class FastestPace(Pace):
    """As fast as possible without a loss.

    Reliable is not back-pressure: a message that is not acknowledged is given up for one that is
    newer by the topic's depth, and one that is acknowledged can still be pushed out of the
    reader's own queue, of which nobody tells. So a message waits until the one that it pushes out
    is acknowledged, and until a reader of READER_SPEED has taken it. The second not where the
    depth is 1: who wants more than the newest of such a topic keeps more of them.

    publishers : dict
        By recorded name, each with its QoS.
    """

    def __init__(self, publishers: dict[str, tuple[Publisher, QoSProfile]]) -> None:
        self._acks = {name: _Acks(*each) for name, each in publishers.items()}
        self._reader = SlowReader({name: acks.kept for name, acks in self._acks.items()})

    def wait(self, message: RecordedMessage, now: int) -> int:
        """How long until it surely pushes out nothing, or until it is time to look again, ns."""
        wait = max(self._begun - now, self._reader.wait(message.topic, now))
        if wait <= 0 and not self._acks[message.topic].room():
            wait = ACK_PERIOD
        return max(0, wait)

    def sent(self, message: RecordedMessage, now: int) -> None:
        """The message went out."""
        super().sent(message, now)
        self._acks[message.topic].pending += 1
        self._reader.send(message.topic, len(message.data), now)


class SlowReader:
    """How far behind a reader is that takes one message after the other, at READER_SPEED.

    Nothing is lost to it while no more was sent than it keeps. After that only half of what it
    keeps may wait, so that it can stop for a moment.

    depths : dict
        How many messages it keeps of each topic.
    """

    def __init__(self, depths: dict[str, int]) -> None:
        self._depths = depths
        self._sent = dict.fromkeys(depths, 0)
        # When it will have taken each message that waits.
        self._taken: dict[str, deque[int]] = {topic: deque() for topic in depths}
        self._free = 0

    def wait(self, topic: str, now: int) -> int:
        """How long until one more message of a topic can be sent, ns."""
        taken, depth = self._taken[topic], self._depths[topic]
        while taken and taken[0] <= now:
            taken.popleft()
        if depth == 1 or self._sent[topic] < depth or len(taken) < depth // 2:
            return 0
        return taken[-(depth // 2)] - now

    def send(self, topic: str, size: int, now: int) -> None:
        """Send it a message of so many bytes."""
        self._free = max(self._free, now) + size * NANOSECONDS // READER_SPEED
        self._taken[topic].append(self._free)
        self._sent[topic] += 1


class _Acks:
    """Messages of a topic that may not have been received by all readers yet."""

    def __init__(self, publisher: Publisher, qos: QoSProfile) -> None:
        self._publisher = publisher
        self.kept = MOST_KEPT if qos.history == HistoryPolicy.KEEP_ALL else qos.depth
        self.pending = 0

    def room(self) -> bool:
        """Whether one more message pushes out none that is not acknowledged."""
        if self.pending >= self.kept and self._publisher.wait_for_all_acked(Duration()):
            self.pending = 0
        return self.pending < self.kept
