"""Transition matrices and retention curves: every action is counted once."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.stats import binomtest

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.intervals import intervals
from resting_aspects_ros.statistics.transitions import (
    LEVELS,
    OUTCOMES,
    RetentionCurve,
    TransitionMatrix,
    no_actions,
)

from .conftest import CONFIDENCES


@pytest.fixture(scope='module')
def aspects(solid, solids):
    """The six sides of a box, in three symmetry classes of two."""
    found = find_aspects(solid(solids.box(10, 20, 30)))
    assert [a.symmetry_class for a in found.aspects] == [1, 1, 2, 2, 3, 3]
    return found


def counted(aspects, seed):
    shape = (len(aspects), len(aspects) + len(OUTCOMES))
    counts = np.random.default_rng(seed).poisson(20, shape)
    return TransitionMatrix(aspects, counts.astype(np.int64))


@pytest.mark.parametrize(
    ('method', 'by_precision', 'used'), [('wilson', False, 0.9), ('simultaneous', True, 0.92)]
)
def test_row_has_the_shares_and_intervals_of_its_counts(aspects, method, by_precision, used):
    # After a stop by precision the error probability is 0.8 times as large.
    matrix = dataclasses.replace(
        counted(aspects, 1), interval=method, confidence=0.9, by_precision=by_precision
    )
    lower, upper = matrix.bounds()
    for i, row in enumerate(matrix.counts):
        expected = intervals(row, int(row.sum()), method, used)
        assert matrix.probability[i] == pytest.approx([each.probability for each in expected])
        assert lower[i] == pytest.approx([each.lower for each in expected], abs=1e-12)
        assert upper[i] == pytest.approx([each.upper for each in expected], abs=1e-12)


def test_row_without_actions_is_unknown_with_bounds_zero_to_one(aspects):
    matrix = no_actions(aspects)
    matrix.counts[1, 2] = 5
    lower, upper = matrix.bounds()
    assert np.isnan(matrix.probability).all(axis=1).tolist() == [i != 1 for i in range(6)]
    assert (lower[0] == 0).all()
    assert (upper[0] == 1).all()


@given(st.integers(0, 2**32 - 1))
def test_by_class_counts_each_action_by_the_classes_of_its_aspects(aspects, seed):
    matrix = counted(aspects, seed)
    number = [a.symmetry_class - 1 for a in aspects] + [3, 4, 5, 6]
    expected = np.zeros((3, 7), dtype=np.int64)
    for (i, j), actions in np.ndenumerate(matrix.counts):
        expected[number[i], number[j]] += actions
    found = matrix.by_class()
    assert found.counts.tolist() == expected.tolist()
    assert found.transitions.sum(axis=1) + found.left == pytest.approx(np.ones(3))


def test_matrices_of_different_actions_can_be_added(aspects):
    first = dataclasses.replace(counted(aspects, 3), energy_growth=0.2)
    second = dataclasses.replace(counted(aspects, 4), energy_growth=0.1)
    total = first + second
    assert total.counts.tolist() == (first.counts + second.counts).tolist()
    assert total.energy_growth == 0.2
    other = no_actions(AspectSet('another', tuple(aspects)))
    with pytest.raises(ValueError, match='different parts'):
        first + other


def curve(left, parts=100, lift=None, barrier=0.0005):
    left = np.array(left, dtype=np.int64)
    lift = np.arange(1, len(left) + 1) / 1000 if lift is None else np.array(lift)
    return RetentionCurve(1, barrier, lift, left, np.full(len(left), parts), 0.95)


@st.composite
def curves(draw):
    points = draw(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 200)), max_size=8))
    left = np.array([min(pair) for pair in points], dtype=np.int64)
    parts = np.array([max(*pair, 1) for pair in points], dtype=np.int64)
    steps = draw(st.lists(st.floats(1e-4, 0.1), min_size=len(left), max_size=len(left)))
    barrier = draw(st.one_of(st.just(math.inf), st.floats(1e-5, 0.5)))
    return RetentionCurve(2, barrier, np.cumsum(steps), left, parts, draw(CONFIDENCES))


def test_lift_is_interpolated_up_to_the_first_crossing():
    found = curve([0, 0, 20, 60, 90])
    # 1 % is 1/20 of the way from 2 to 3 mm, 10 % half of it; 50 % is 3/4 of that from 3 to 4 mm.
    assert [found.lift_at(level) for level in LEVELS] == pytest.approx([2.05e-3, 2.5e-3, 3.75e-3])
    # The curve is not monotone.
    found = curve([0, 50, 10, 90])
    assert [found.lift_at(p) for p in (0.2, 0.7)] == pytest.approx([1.4e-3, 3.75e-3])
    with pytest.raises(InvalidValueError, match='invalid level nan'):
        found.lift_at(math.nan)


@given(curves(), st.one_of(st.sampled_from(LEVELS), st.floats(0.001, 0.999)))
# All parts leave below the barrier.
@example(curve([400, 400], 400, lift=[1e-4, 1e-2], barrier=0.00216), 0.01)
def test_curve_reaches_the_level_at_the_lift_for_the_first_time(each, level):
    lift = each.lift_at(level)
    below = each.lift < lift if math.isfinite(lift) else np.ones(len(each.lift), dtype=bool)
    assert (each.probability[below] < level).all()
    if math.isfinite(lift):
        points = np.append(0, each.lift), np.append(0, each.probability)
        assert np.interp(lift, *points) == pytest.approx(level, rel=1e-9)
    # NaN is beyond the maximum height.
    low, high = each.lift_interval(level)
    low, lift, high = (math.inf if math.isnan(end) else end for end in (low, lift, high))
    assert 0 < low <= lift <= high


def test_ends_of_the_interval_are_the_lifts_of_the_bounds():
    found = curve([0, 30])
    none = binomtest(0, 100).proportion_ci(0.95, 'wilson').high
    some = binomtest(30, 100).proportion_ci(0.95, 'wilson')
    first, last = found.lift_interval(0.1)
    assert first == pytest.approx(0.001 + 0.001 * (0.1 - none) / (some.high - none))
    assert last == pytest.approx(0.001 + 0.001 * 0.1 / some.low)
    # Only the upper bound, 39.6 %, reaches 35 %.
    first, last = found.lift_interval(0.35)
    assert 0.001 < first < 0.002
    assert math.isnan(last)


def test_lift_interval_begins_at_the_barrier_where_the_counts_agree_with_it():
    found = curve([0, 90], barrier=0.00154)
    low, high = found.lift_interval(0.5)
    assert low == 0.00154 < found.lift_at(0.5) < high
