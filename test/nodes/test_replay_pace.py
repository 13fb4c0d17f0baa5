"""When a message goes out: at its recorded time, or when no reader can lose another for it."""

import itertools

import pytest

from resting_aspects_ros.logs.recording import RecordedMessage
from resting_aspects_ros.nodes.replay_pace import READER_SPEED, RecordedPace, SlowReader

SECOND = 10**9
START = 1_700_000_000 * SECOND


def message(time, size=1):
    return RecordedMessage('/a', START + time, bytes(size))


@pytest.mark.parametrize('rate', [0.001, 0.3, 1.0, 4.0, 1000.0])
def test_a_message_is_due_at_its_time_divided_by_the_rate(rate):
    pace = RecordedPace(rate)
    pace.begin(START, now=5 * SECOND)
    for k in range(0, 3_000_000, 70_001):  # ms, 50 minutes
        late = message(k * 10**6)
        due = 5 * SECOND + round(k * 10**6 / rate)
        # To the ns, in up to 35 days.
        assert pace.wait(late, now=5 * SECOND) == pytest.approx(due - 5 * SECOND, abs=1)
        assert pace.wait(late, due + 1) == 0


def test_delays_do_not_add_up():
    """Whenever a message went out, the next is due at its own time."""
    pace = RecordedPace(2.0)
    pace.begin(START, now=0)
    for k in range(1000):
        due = k * SECOND // 20
        late = message(k * SECOND // 10)
        assert pace.wait(late, due - 5) == 5
        pace.sent(late, due + 30_000_000)


def test_a_pause_is_as_if_no_time_went_by():
    pace = RecordedPace(4.0)
    pace.begin(START, now=0)
    late = message(8 * SECOND)
    assert pace.reached(SECOND) == START + 4 * SECOND
    before = pace.wait(late, now=SECOND)
    pace.delay(100 * SECOND)
    assert pace.wait(late, now=101 * SECOND) == before == SECOND
    assert pace.reached(101 * SECOND) == START + 4 * SECOND


def test_before_it_begins_nothing_is_reached():
    pace = RecordedPace(4.0)
    pace.begin(START, now=10 * SECOND)
    assert pace.reached(0) == START
    assert pace.wait(message(0), 9 * SECOND) == SECOND


def most_kept(depth, speed, hiccup, count=400, size=1000):
    """The longest queue of a reader, if each message is sent to it as soon as it may be.

    hiccup : it takes nothing for so long at first, ns
    """
    pace, now, taken = SlowReader({'a': depth}), 0, []
    free, longest = hiccup, 0
    for _ in range(count):
        while wait := pace.wait('a', now):
            now += wait
        pace.send('a', size, now)
        free = max(free, now) + size * SECOND // speed
        taken.append(free)
        longest = max(longest, sum(each > now for each in taken))
    return longest, now


@pytest.mark.parametrize('depth', [2, 3, 10, 100, 399, 400, 2000])
def test_a_reader_of_that_speed_never_keeps_more_than_the_depth(depth):
    half = depth // 2 * 1000 * SECOND // READER_SPEED
    for speed, hiccup in itertools.product([READER_SPEED, 10 * READER_SPEED], [0, half // 2]):
        longest, _ = most_kept(depth, speed, hiccup)
        assert longest <= min(depth, 400)


def test_what_fits_goes_out_at_once_and_the_rest_at_the_speed_of_the_reader():
    assert most_kept(400, READER_SPEED, 0) == (400, 0)
    _, seconds = most_kept(100, READER_SPEED, 0)
    # 50 wait when the last has gone out, itself among them.
    assert seconds == 350 * 1000 * SECOND // READER_SPEED


def test_a_reader_that_is_slower_would_lose_messages():
    """So the bound above is one: half the speed is too slow."""
    longest, _ = most_kept(100, READER_SPEED // 2, 0)
    assert longest > 100


def test_of_a_topic_of_depth_one_only_the_newest_is_wanted():
    pace = SlowReader({'a': 1})
    for _ in range(10):
        assert pace.wait('a', 0) == 0
        pace.send('a', 10**9, 0)


def test_topics_share_the_reader():
    pace = SlowReader({'a': 2, 'b': 2000})
    pace.send('a', 1, 0)
    pace.send('a', 1, 0)
    for _ in range(100):
        pace.send('b', READER_SPEED, 0)
    assert pace.wait('b', 0) == 0
    assert pace.wait('a', 0) > 0
    pace.send('a', 1, SECOND)
    assert pace.wait('a', SECOND) > 98 * SECOND
