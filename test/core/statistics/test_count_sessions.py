"""Totals of counters: lost, repeated, late and invalid reports, and restarts."""

import numpy as np
import pytest

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics import count_sessions
from resting_aspects_ros.core.statistics.count_sessions import CountSessions, CountWindows, Totals

SECOND = 10**9


def report(supplied=(), session='a', time=0, action='', moved=()):
    arrays = (np.array(each, dtype=np.uint64) for each in (supplied, moved))
    supplied, moved = arrays
    return Totals(session, time * SECOND, supplied, action, moved)


@pytest.fixture
def sessions():
    return CountSessions(2)


def add(sessions, *reports, now=100):
    return [sessions.add(each, now * SECOND).tolist() for each in reports]


def test_lost_and_repeated_reports_do_no_harm(sessions):
    first, second, third = (report([k, 2 * k], time=k) for k in (1, 2, 3))
    assert add(sessions, first, first, third) == [[1, 2], [0, 0], [2, 4]]
    assert add(sessions, second, third) == [[0, 0], [0, 0]]  # late, and repeated
    assert (sessions.supplied.tolist(), sessions.late) == ([3, 6], 1)


def test_sessions_of_restarted_counters_add_up(sessions):
    add(sessions, report([5, 5]), report([2, 0], 'b'), report([6, 5]), report([2, 1], 'b'))
    assert (sessions.supplied.tolist(), sessions.parts) == ([8, 6], 14)


def test_moved_parts_are_counted_by_action(sessions):
    add(
        sessions,
        report([1, 0], action='flip', moved=[1, 2, 3, 4]),
        report(action='tap', moved=[0, 1, 0, 0]),
        report([2, 0], action='flip', moved=[1, 2, 3, 5]),
        report(action='flip', moved=[1, 0, 0, 0], session='b'),
    )
    assert sessions.supplied.tolist() == [2, 0]
    moved = {name: counts.tolist() for name, counts in sessions.moved.items()}
    assert moved == {'flip': [[2, 2], [3, 5]], 'tap': [[0, 1], [0, 0]]}


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        (report([4, 5]), r'count 4 in supplied of class 1: expected 5 or more, because a total'),
        (report([5, 5], action='flip', moved=[0, 1, 0, 0]), 'from class 1 to class 1: expected 1'),
        (report([6, 5, 1]), 'number of counts 3 in supplied: expected 2, or none'),
        (report([6, 5], action='flip', moved=[1]), 'counts 1 in moved: expected 4, or none'),
        (report([2**63, 5]), 'count 9223372036854775808 in supplied: expected at most'),
        (report([6, 5], time=200), r'expected none in the future; it is 100\.0 s ahead'),
        (report([6, 5], moved=[2, 0, 0, 0]), "invalid action '' of moved parts"),
    ],
)
def test_invalid_report_changes_nothing(sessions, wrong, message):
    add(sessions, report([5, 5], action='flip', moved=[1, 0, 0, 0]))
    with pytest.raises(InvalidValueError, match=message):
        add(sessions, wrong)
    assert sessions.supplied.tolist() == [5, 5]
    assert sessions.moved['flip'].tolist() == [[1, 0], [0, 0]]
    assert add(sessions, report([6, 5])) == [[1, 0]]


def test_memory_is_bounded(sessions, monkeypatch):
    for name in ('MAX_SESSIONS', 'MAX_ACTIONS', 'MAX_BATCHES'):
        monkeypatch.setattr(count_sessions, name, 4)
    windows = CountWindows()
    for k in range(20):
        (new,) = add(sessions, report([1, 2], session=str(k)))
        windows.add(np.array(new), k)
    assert sessions.supplied.tolist() == [20, 40]
    for k in range(4):
        add(sessions, report(action=f'a{k}', moved=[1, 0, 0, 0]))
    with pytest.raises(InvalidValueError, match='expected at most 4 actions'):
        add(sessions, report(action='more', moved=[1, 0, 0, 0]))
    windows.resize(3)  # the batches were joined before the size was known
    assert windows.ends[-1] == 60
    assert len(windows.windows) <= 4
    assert np.sum([each.counts for each in windows.windows], axis=0).tolist() == [20, 40]
    for k in range(20, 40):
        windows.add(np.array([3, 0]), k)
    assert windows.ends[-1] == 120
    assert len(windows.windows) <= 4
    assert windows.windows[-1].counts.tolist() == [3, 0]


def test_windows_have_whole_batches():
    windows = CountWindows()
    windows.resize(5)
    for time, counts in enumerate([[3, 0], [1, 0], [0, 4], [9, 0], [0, 2], [0, 0]]):
        windows.add(np.array(counts), time)
    found = [(each.counts.tolist(), each.time) for each in windows.windows]
    assert found == [([4, 4], 0), ([9, 0], 3)]
    assert windows.ends.tolist() == [0, 8, 17]


def test_windows_that_became_too_small_are_joined():
    windows = CountWindows()
    windows.resize(2)
    for time in range(6):
        windows.add(np.array([1, 1]), time)
    assert windows.ends.tolist() == [0, 2, 4, 6, 8, 10, 12]
    windows.resize(5)
    assert windows.ends.tolist() == [0, 6, 12]
    assert [each.time for each in windows.windows] == [0, 3]
    windows.resize(4)  # large enough
    assert windows.ends.tolist() == [0, 6, 12]
