"""Counters, batches and windows of supplied parts, and their shares with a prior."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics import counted_parts
from resting_aspects_ros.statistics.counted_parts import (
    BatchSeries,
    CountSessions,
    LiveCounts,
    Totals,
)
from resting_aspects_ros.statistics.intervals import Interval

from .conftest import CONFIDENCES, COUNT, assert_ordered

SECOND = 10**9


def report(supplied=(), session='a', time=0, action='', moved=()):
    supplied, moved = (np.array(each, dtype=np.uint64) for each in (supplied, moved))
    return Totals(session, time * SECOND, supplied, action, moved)


@pytest.fixture
def sessions():
    return CountSessions(2)


def add(sessions, *reports, now=100):
    return [sessions.add(each, now * SECOND).tolist() for each in reports]


def test_lost_repeated_and_restarted_reports_do_no_harm(sessions):
    first, second, third = (report([k, 2 * k], time=k) for k in (1, 2, 3))
    assert add(sessions, first, first, third) == [[1, 2], [0, 0], [2, 4]]
    assert add(sessions, second, third) == [[0, 0], [0, 0]]  # late, and repeated
    assert sessions.supplied.tolist() == [3, 6]
    add(sessions, report([2, 0], 'b'), report([4, 6], time=4), report([2, 1], 'b'))
    assert (sessions.supplied.tolist(), sessions.parts) == ([6, 7], 13)


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
        (report([5, 5], action='flip', moved=[0, 1, 0, 0]), 'from class 1 to class 1: expected 1'),
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
        monkeypatch.setattr(counted_parts, name, 4)
    series = BatchSeries()
    for k in range(20):
        (new,) = add(sessions, report([1, 2], session=str(k)))
        series.add(np.array(new), k)
        series.add(np.array([0, 0]), k + 0.5)  # an empty batch has no row
    assert sessions.supplied.tolist() == [20, 40]
    for k in range(4):
        add(sessions, report(action=f'a{k}', moved=[1, 0, 0, 0]))
    with pytest.raises(InvalidValueError, match='expected at most 4 actions'):
        add(sessions, report(action='more', moved=[1, 0, 0, 0]))
    found = series.observed(((1,), (2,)), str)
    assert (series.parts, found.parts, found.totals.tolist()) == (60, 60, [20, 40])
    assert len(found.labels) <= 4
    # The oldest are joined, and the newest are as they were.
    assert (found.labels[0], found.labels[-1]) == ('0', '19')
    assert found.windows(1)[0][-1].tolist() == [1, 2]


def live(simulated, observed=None, **options):
    observed = [0] * len(simulated) if observed is None else observed
    ids = tuple(range(1, len(simulated) + 1))
    return LiveCounts(ids, np.array(simulated), np.array(observed), **options)


def test_simulation_has_the_weight_of_a_number_of_drops():
    found = live([6000, 4000], [30, 10], weight=100)
    np.testing.assert_allclose(found.concentration, [90, 50], rtol=1e-3)
    first, _ = found.intervals()
    a, b = found.concentration
    assert (first.lower, first.upper) == pytest.approx(beta.ppf([0.025, 0.975], a, b))
    # A few drops have no more weight than their number.
    assert live([6, 4], weight=100).concentration.sum() == pytest.approx(10)
    with pytest.raises(InvalidValueError, match='invalid prior weight'):
        live([5, 5], weight=float('nan'))


@given(
    st.lists(st.tuples(COUNT, COUNT), min_size=2, max_size=8),
    st.sampled_from([1e-3, 1.0, 60.0, 1e9]),
    CONFIDENCES,
)
def test_intervals_contain_the_mean_share(rows, weight, confidence):
    simulated, observed = np.array(rows).T
    if not simulated.any():
        return
    found = live(simulated, observed, weight=weight)
    assert sum(each.probability for each in found.intervals()) == pytest.approx(1)
    for each in found.intervals(confidence):
        assert_ordered(each.lower, each.probability, each.upper)


def test_share_of_the_only_class_is_certain():
    assert live([100], [30]).intervals() == [Interval(1.0, 1.0, 1.0)]
    # Also a share without a noticeable rest has an interval.
    first, second = live([100, 0], [10**8, 0], weight=1e-300).intervals()
    assert (first.lower, first.upper) == (1.0, 1.0)
    assert 0 <= second.lower <= second.probability <= second.upper < 1e-9
