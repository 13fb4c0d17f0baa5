"""Retention curves: Wilson's bounds, and the heights at which a curve reaches a level."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.transitions import LEVELS, RetentionCurve

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


def test_first_crossing_counts_where_the_curve_is_not_monotone():
    found = curve([0, 50, 10, 90])
    assert found.lift_at(0.2) == pytest.approx(1.4e-3)
    assert found.lift_at(0.5) == pytest.approx(2e-3)
    assert found.lift_at(0.7) == pytest.approx(3.75e-3)


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
