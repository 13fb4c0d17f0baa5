"""Intervals: against scipy, whose coverage is known, and published examples."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.intervals import METHODS, Interval, bounds, intervals

counted = st.lists(st.integers(0, 10**6), min_size=1, max_size=20)
confidences = st.floats(0.501, 0.9999)
methods = pytest.mark.parametrize('method', METHODS)


@given(counted, st.integers(0, 1000), confidences)
def test_wilson_agrees_with_scipy(counts, rest, confidence):
    drops = sum(counts) + rest
    if drops == 0:
        return
    found = intervals(counts, drops, 'wilson', confidence)
    for count, ours in zip(counts, found, strict=True):
        theirs = binomtest(count, drops).proportion_ci(confidence, 'wilson')
        assert ours.probability == count / drops
        assert (ours.lower, ours.upper) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


@given(counted, st.integers(0, 1000), confidences)
def test_simultaneous_agrees_with_exact_scipy_and_bonferroni(counts, rest, confidence):
    drops = sum(counts) + rest
    if drops == 0:
        return
    found = intervals(counts, drops, 'simultaneous', confidence)
    each = 1 - (1 - confidence) / len(counts)
    for count, ours in zip(counts, found, strict=True):
        theirs = binomtest(count, drops).proportion_ci(each, 'exact')
        assert (ours.lower, ours.upper) == pytest.approx((theirs.low, theirs.high), rel=1e-7)


@pytest.mark.parametrize(
    ('count', 'drops', 'wilson', 'exact'),
    # Newcombe 1998, Statistics in Medicine 17:857, table I, methods 3 and 5.
    [
        (81, 263, (0.2553, 0.3662), (0.2527, 0.3676)),
        (15, 148, (0.0624, 0.1605), (0.0578, 0.1617)),
        (0, 20, (0.0000, 0.1611), (0.0000, 0.1684)),
        (1, 29, (0.0061, 0.1718), (0.0009, 0.1776)),
    ],
)
def test_published_intervals(count, drops, wilson, exact):
    # For a single aspect, the simultaneous interval is the exact one.
    for method, expected in (('wilson', wilson), ('simultaneous', exact)):
        (found,) = intervals([count], drops, method)
        assert (found.lower, found.upper) == pytest.approx(expected, abs=5e-5)


@methods
@given(counted, st.integers(0, 1000), confidences)
def test_interval_contains_the_share_and_grows_with_confidence(method, counts, rest, confidence):
    drops = sum(counts) + rest
    narrow = intervals(counts, drops, method, confidence)
    wide = intervals(counts, drops, method, (1 + confidence) / 2)
    for count, inner, outer in zip(counts, narrow, wide, strict=True):
        assert 0 <= outer.lower <= inner.lower <= inner.probability
        assert inner.probability <= inner.upper <= outer.upper <= 1
        assert (inner.lower == 0) == (count == 0)
        assert (inner.upper == 1) == (count == drops)


@methods
def test_bounds_of_many_runs_agree_with_single_runs(method):
    generator = np.random.default_rng(1)
    drops = np.array([0, 1, 20, 1000])
    counts = np.array([generator.multinomial(n, [0.5, 0.3, 0.2])[:2] for n in drops])
    lower, upper = bounds(counts, drops, method)
    for i, n in enumerate(drops.tolist()):
        one = intervals(counts[i], n, method)
        assert [each.lower for each in one] == lower[i].tolist()
        assert [each.upper for each in one] == upper[i].tolist()


@methods
def test_intervals_without_drops_or_without_aspects(method):
    assert intervals([0, 0], 0, method) == [Interval(0.0, 0.0, 1.0)] * 2
    assert intervals([], 100, method) == []


@pytest.mark.parametrize(
    'wrong',
    [
        *({'method': each} for each in ('wald', '')),
        *({'confidence': each} for each in (0.5, 1, 95, True, '0.9', math.nan)),
        *({'counts': each} for each in ([3, -1], [6, 5])),
    ],
    ids=str,
)
def test_invalid_arguments_are_named(wrong):
    (value,) = wrong.values()
    with pytest.raises(InvalidValueError, match=re.escape(repr(value))):
        intervals(**({'counts': [1, 2], 'drops': 10} | wrong))
