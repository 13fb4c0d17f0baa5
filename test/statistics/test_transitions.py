"""Transition matrices and retention curves: every action is counted once."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.intervals import METHODS, intervals
from resting_aspects_ros.statistics.transitions import (
    LEVELS,
    OUTCOMES,
    RetentionCurve,
    TransitionMatrix,
    no_actions,
)

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope='module')
def aspects(solid, solids):
    """The six sides of a box, in three symmetry classes of two."""
    found = find_aspects(solid(solids.box(10, 20, 30)))
    assert [a.symmetry_class for a in found.aspects] == [1, 1, 2, 2, 3, 3]
    return found


def counted(aspects, seed, mean=20):
    shape = (len(aspects), len(aspects) + len(OUTCOMES))
    counts = np.random.default_rng(seed).poisson(mean, shape)
    return TransitionMatrix(aspects, counts.astype(np.int64))


@given(seeds, st.sampled_from([0.1, 1, 100]))
def test_probabilities_are_counts_over_the_actions_of_the_row(aspects, seed, mean):
    matrix = counted(aspects, seed, mean)
    for row, n, probability in zip(
        matrix.counts.tolist(), matrix.actions.tolist(), matrix.probability, strict=True
    ):
        assert n == sum(row)
        assert probability.tolist() == [c / n for c in row] if n else np.isnan(probability).all()


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(('by_precision', 'used'), [(False, 0.9), (True, 0.92)])
def test_bounds_of_a_row_are_the_intervals_of_its_counts(aspects, method, by_precision, used):
    # After a stop by precision the error probability is 0.8 times as large.
    matrix = dataclasses.replace(
        counted(aspects, 1), interval=method, confidence=0.9, by_precision=by_precision
    )
    lower, upper = matrix.bounds()
    for i, row in enumerate(matrix.counts):
        expected = intervals(row, int(row.sum()), method, used)
        assert lower[i] == pytest.approx([each.lower for each in expected], abs=1e-12)
        assert upper[i] == pytest.approx([each.upper for each in expected], abs=1e-12)


def test_row_without_actions_is_unknown_with_bounds_zero_to_one(aspects):
    matrix = no_actions(aspects)
    matrix.counts[1, 2] = 5
    lower, upper = matrix.bounds()
    assert np.isnan(matrix.probability).all(axis=1).tolist() == [i != 1 for i in range(6)]
    assert np.isnan(matrix.left).tolist() == [i != 1 for i in range(6)]
    assert (lower[0] == 0).all()
    assert (upper[0] == 1).all()
    assert upper[1, 2] == 1


@given(seeds)
def test_by_class_counts_each_action_by_the_classes_of_its_aspects(aspects, seed):
    # Single actions are counted by aspect, and counted again by class.
    generator = np.random.default_rng(seed)
    n = 300
    start, end = generator.integers(6, size=n), generator.integers(10, size=n)
    matrix = no_actions(aspects)
    np.add.at(matrix.counts, (start, end), 1)
    number = [a.symmetry_class - 1 for a in aspects] + [3, 4, 5, 6]
    expected = np.zeros((3, 7), dtype=np.int64)
    for i, j in zip(start.tolist(), end.tolist(), strict=True):
        expected[number[i], number[j]] += 1
    found = matrix.by_class()
    assert found.counts.tolist() == expected.tolist()
    assert found.transitions.shape == (3, 3)
    assert found.transitions.sum(axis=1) + found.left == pytest.approx(np.ones(3))


def test_matrices_of_different_actions_can_be_added(aspects):
    first = dataclasses.replace(counted(aspects, 3), energy_growth=0.2)
    second = dataclasses.replace(counted(aspects, 4), energy_growth=0.1)
    total = first + second + no_actions(aspects)
    assert total.counts.tolist() == (first.counts + second.counts).tolist()
    assert total.energy_growth == 0.2
    other = no_actions(AspectSet('another', tuple(aspects)))
    with pytest.raises(ValueError, match='different parts'):
        first + other


def test_part_without_aspects_has_an_empty_matrix():
    matrix = no_actions(AspectSet('a', ()))
    assert matrix.counts.shape == matrix.by_class().counts.shape == (0, 4)
    assert [bound.shape for bound in matrix.bounds()] == [(0, 4), (0, 4)]


levels = st.one_of(st.sampled_from(LEVELS), st.floats(0.001, 0.999))


def curve(left, parts=100, lift=None, confidence=0.95):
    left = np.array(left, dtype=np.int64)
    lift = np.arange(1, len(left) + 1) / 1000 if lift is None else np.array(lift)
    return RetentionCurve(1, 0.0005, lift, left, np.full(len(left), parts), confidence)


@st.composite
def curves(draw):
    points = draw(st.lists(st.tuples(st.integers(0, 200), st.integers(0, 200)), max_size=8))
    left = np.array([min(pair) for pair in points], dtype=np.int64)
    parts = np.array([max(*pair, 1) for pair in points], dtype=np.int64)
    steps = draw(st.lists(st.floats(1e-4, 0.1), min_size=len(left), max_size=len(left)))
    lift = np.cumsum(steps)
    return RetentionCurve(2, math.inf, lift, left, parts, draw(st.sampled_from([0.8, 0.95])))


@given(curves())
def test_probability_is_the_share_that_left_with_wilsons_bounds(each):
    lower, upper = each.bounds()
    for i, (left, parts) in enumerate(zip(each.left.tolist(), each.parts.tolist(), strict=True)):
        expected = binomtest(left, parts).proportion_ci(each.confidence, 'wilson')
        assert each.probability[i] == left / parts
        assert (lower[i], upper[i]) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_lift_is_interpolated_between_neighbouring_heights():
    found = curve([0, 0, 20, 60, 90])
    # 1 % is 1/20 of the way from 2 to 3 mm, 10 % half of it; 50 % is 3/4 of that from 3 to 4 mm.
    assert [found.lift_at(level) for level in LEVELS] == pytest.approx([2.05e-3, 2.5e-3, 3.75e-3])


@given(curves(), levels)
def test_curve_reaches_the_level_at_the_lift_for_the_first_time(each, level):
    lift = each.lift_at(level)
    below = each.lift < lift if math.isfinite(lift) else np.ones(len(each.lift), dtype=bool)
    assert (each.probability[below] < level).all()
    if math.isfinite(lift):
        assert 0 < lift <= each.lift[-1]
        points = np.append(0, each.lift), np.append(0, each.probability)
        assert np.interp(lift, *points) == pytest.approx(level, rel=1e-9)


def test_ends_of_the_interval_are_the_lifts_of_the_bounds():
    # Wilson's bounds of 30 of 100 are 0.2189 and 0.3958 (binomtest of scipy).
    found = curve([0, 30], lift=[0.001, 0.002])
    none = binomtest(0, 100).proportion_ci(0.95, 'wilson').high
    some = binomtest(30, 100).proportion_ci(0.95, 'wilson')
    first, last = found.lift_interval(0.1)
    assert first == pytest.approx(0.001 + 0.001 * (0.1 - none) / (some.high - none))
    assert last == pytest.approx(0.001 + 0.001 * 0.1 / some.low)


def test_interval_is_open_where_only_the_upper_bound_reaches_the_level():
    first, last = curve([0, 30]).lift_interval(0.35)
    assert 0.001 < first < 0.002
    assert math.isnan(last)
    assert math.isnan(curve([0, 30]).lift_at(0.35))


@pytest.mark.parametrize('level', [0.0, 1.0, -0.1, math.nan])
def test_invalid_level_is_refused(level):
    for function in (curve([0, 30]).lift_at, curve([0, 30]).lift_interval):
        with pytest.raises(InvalidValueError, match=f'invalid level {level}'):
            function(level)


def test_first_crossing_counts_where_the_curve_is_not_monotone():
    found = curve([0, 50, 10, 90])
    assert found.lift_at(0.2) == pytest.approx(1.4e-3)
    assert found.lift_at(0.5) == pytest.approx(2e-3)
    assert found.lift_at(0.7) == pytest.approx(3.75e-3)
