"""Every interval contains its estimate: lower <= estimate <= upper, also at the border."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from resting_aspects_ros.statistics.comparison import DropCounts, compare, compare_with_exact
from resting_aspects_ros.statistics.counted_parts import LiveCounts
from resting_aspects_ros.statistics.drift import largest_deviation
from resting_aspects_ros.statistics.intervals import METHODS, bounds, containing
from resting_aspects_ros.statistics.markov import long_run, long_run_bounds
from resting_aspects_ros.statistics.transitions import LEVELS, RetentionCurve

# Counts at the border of what is possible, and anything between.
count = st.one_of(st.sampled_from([0, 0, 1, 2, 10**12]), st.integers(0, 300))
counts = st.lists(count, min_size=2, max_size=6).map(np.array).filter(lambda each: each.any())
small = st.lists(st.integers(0, 30), min_size=2, max_size=2).filter(any)
confidences = st.one_of(st.sampled_from([0.5000001, 0.95, 0.999999]), st.floats(0.501, 0.9999))


def assert_ordered(lower, value, upper):
    assert np.all(np.asarray(lower) <= value), (lower, value, upper)
    assert np.all(value <= np.asarray(upper)), (lower, value, upper)


@given(counts, st.sampled_from(METHODS), confidences, st.sampled_from([0, 1, 10**15]))
def test_bounds_of_counts_contain_the_share(row, method, confidence, rest):
    drops = int(row.sum()) + rest
    lower, upper = bounds(row, drops, method, confidence)
    assert_ordered(lower, row / drops, upper)
    assert_ordered(0, lower, 1)
    assert_ordered(0, upper, 1)


@given(counts, st.data(), st.sampled_from([1e-3, 1.0, 60.0, 1e9]), confidences)
def test_credible_intervals_of_live_counts_contain_the_mean(simulated, data, weight, confidence):
    observed = np.array(
        data.draw(st.lists(count, min_size=len(simulated), max_size=len(simulated)))
    )
    live = LiveCounts(tuple(range(1, len(simulated) + 1)), simulated, observed, weight)
    for each in live.intervals(confidence):
        assert_ordered(each.lower, each.probability, each.upper)


@given(counts, st.data(), confidences)
def test_bounds_of_a_difference_contain_it(one, data, confidence):
    other = data.draw(st.lists(count, min_size=len(one), max_size=len(one)).filter(any))
    rng = np.random.default_rng(1)
    first, second = DropCounts(np.minimum(one, 10**6)), DropCounts(np.minimum(other, 10**6))
    for found in (
        compare(first, second, rng, confidence),
        compare_with_exact(first, second.counts / second.counts.sum(), rng, confidence),
    ):
        assert_ordered(found.lower, found.deviation, found.upper)
    drift = largest_deviation(first.counts, second.counts, confidence)
    assert_ordered(drift.lower, drift.difference, drift.upper)


@st.composite
def curves(draw):
    rows = draw(st.lists(st.tuples(small, st.floats(1e-4, 0.1)), max_size=8))
    left = np.array([each[0] for each, _ in rows], dtype=np.int64)
    parts = np.array([sum(each) for each, _ in rows], dtype=np.int64)
    lift = np.cumsum([step for _, step in rows])
    barrier = draw(st.one_of(st.just(math.inf), st.floats(1e-5, 0.5)))
    return RetentionCurve(1, barrier, lift, left, parts, draw(confidences))


@given(curves(), st.one_of(st.sampled_from(LEVELS), st.floats(0.001, 0.999)))
@example(  # all parts leave below the barrier
    RetentionCurve(
        1, 0.00216, np.array([1e-4, 1e-2]), np.array([400, 400]), np.array([400, 400]), 0.95
    ),
    0.01,
)
def test_lift_interval_contains_the_lift(curve, level):
    lift = curve.lift_at(level)
    low, high = curve.lift_interval(level)
    # NaN is beyond the maximum height.
    low, lift, high = (math.inf if math.isnan(each) else each for each in (low, lift, high))
    assert 0 < low <= lift <= high


def test_lift_interval_begins_at_the_barrier_where_the_counts_agree_with_it():
    parts = np.array([100, 100])
    curve = RetentionCurve(1, 0.00154, np.array([0.001, 0.002]), np.array([0, 90]), parts, 0.95)
    low, high = curve.lift_interval(0.5)
    assert curve.lift_at(0.5) == pytest.approx(0.001 + 0.001 * 5 / 9)
    assert low == 0.00154 < curve.lift_at(0.5) < high


@given(st.integers(1, 4), st.data(), confidences)
def test_bounds_of_long_run_shares_contain_them(k, data, confidence):
    row = st.lists(st.integers(0, 5), min_size=k + 1, max_size=k + 1).filter(any)
    actions = np.array([data.draw(row) for _ in range(k)])
    drop = np.array(data.draw(st.lists(st.integers(0, 3), min_size=k, max_size=k).filter(any)))
    lower, upper = long_run_bounds(actions, drop, confidence, np.random.default_rng(1), 50)
    share = actions / actions.sum(axis=1, keepdims=True)
    assert_ordered(lower, long_run(share[:, :k], share[:, k], drop).shares, upper)


def test_bounds_are_only_extended_where_they_miss_the_value():
    lower, upper = containing(np.array([0.5, 0.1, 0.9]), [0.4, 0.2, 0.2], [0.6, 0.8, 0.8])
    assert lower.tolist() == [0.4, 0.1, 0.2]
    assert upper.tolist() == [0.6, 0.8, 0.9]
