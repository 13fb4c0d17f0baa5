"""When replayed messages are published: rate, pause and resume, loop."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.nodes.log_replayer.node import PAUSE_BEFORE, LogPlayer, replayed_topics

SECOND = 10**9
# Batches of the log, its first message is the part, and the time between two messages.
COUNT, GAP = 41, SECOND // 10
POSES, PART = '/cell/resting_poses', '/cell/parts/tetrahedron'


class Player:
    """A replay with a simulated clock.

    published : the clock and the message, of each
    """

    def __init__(self, log, rate=None, *, loop=False):
        self.now = 5 * SECOND
        self.published = []
        recording = Recording(log)
        topics, _ = replayed_topics(recording)
        self.replay = LogPlayer(
            recording,
            topics,
            lambda message: self.published.append((self.now, message)),
            rate=rate,
            loop=loop,
            clock=lambda: self.now,
        )

    def run(self, until=None, late=0):
        """Play until the end, or until a time; each call comes so late."""
        while (wait := self.replay.play()) is not None:
            if until is not None and self.now + wait > until:
                self.now = until
                return
            self.now += wait + late

    def times(self, topic=POSES):
        return [now for now, message in self.published if message.topic == topic]


@pytest.fixture(scope='module')
def log(batches, write_log, tmp_path_factory):
    return write_log(tmp_path_factory.mktemp('log'), batches(COUNT), gap=GAP / SECOND)


@pytest.mark.parametrize('rate', [0.001, 1.0, 1000.0])
def test_messages_are_published_at_their_time_over_the_rate(log, rate):
    player = Player(log, rate)
    player.run()
    start = 5 * SECOND + PAUSE_BEFORE
    assert player.times(PART) == [start]
    due = [start + k * GAP / rate for k in range(1, COUNT + 1)]
    assert player.times() == pytest.approx(due, abs=1)


@pytest.mark.slow
@given(late=st.integers(1, GAP // 4 - 1))
def test_delays_do_not_add_up(log, late):
    player = Player(log, 2.0)
    player.run(late=late)
    start = 5 * SECOND + PAUSE_BEFORE
    due = [start + k * GAP // 2 for k in range(1, COUNT + 1)]
    assert [now - d for now, d in zip(player.times(), due, strict=True)] == [late] * COUNT


def test_pause_delays_the_following_messages(log):
    whole, player = Player(log, 0.5), Player(log, 0.5)
    whole.run()
    player.run(until=5 * SECOND + PAUSE_BEFORE + SECOND)
    count = len(player.times())
    before = player.replay.position
    player.replay.pause()
    player.now += 100 * SECOND
    assert player.replay.play() is None
    paused = player.replay.position
    assert (paused.paused, paused.seconds, paused.messages) == (True, 0.5, before.messages)
    assert len(player.times()) == count == 5
    player.replay.resume()
    assert player.replay.position == before
    player.run()
    later = [now - 100 * SECOND for now in player.times()[count:]]
    assert later == whole.times()[count:]


def test_position_follows_the_clock(log):
    player = Player(log, 4.0)
    length = COUNT * GAP / SECOND
    start = player.replay.position
    assert (start.seconds, start.length, start.messages, start.over) == (0, length, 0, False)
    player.run(until=5 * SECOND + PAUSE_BEFORE + SECOND // 8)
    middle = player.replay.position
    assert (middle.seconds, middle.messages) == (0.5, 6)
    assert middle.time == start.time + SECOND // 2  # the time in the log
    player.run()
    end = player.replay.position
    assert (end.seconds, end.messages, end.over) == (length, COUNT + 1, True)


def test_loop_repeats_after_a_second(log):
    player = Player(log, 10.0, loop=True)
    player.run(until=20 * SECOND)
    data = [message.data for _, message in player.published]
    once = COUNT + 1
    assert len(data) > 2 * once
    assert all(data[k] == data[k % once] for k in range(len(data)))
    assert player.times(PART)[1] - player.times()[COUNT - 1] == PAUSE_BEFORE
    assert player.replay.position.round == len(data) // once + 1


def test_full_speed_publishes_without_pauses(log):
    player = Player(log)
    player.run()
    assert player.times() == COUNT * [5 * SECOND + PAUSE_BEFORE]
