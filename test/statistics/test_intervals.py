"""Intervals against SciPy and published examples, and the stopping rule."""

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.conditions import MAX_DROPS
from resting_aspects_ros.statistics.intervals import (
    CHECKPOINT_STEP,
    METHODS,
    MIN_PRECISION,
    bounds,
    checkpoints,
    intervals,
    is_precise,
    stopping_confidence,
)

from .conftest import CONFIDENCES, COUNT

counted = st.lists(st.integers(0, 10**6), min_size=1, max_size=20).filter(any)
methods = pytest.mark.parametrize('method', METHODS)


@given(counted, st.integers(0, 1000), CONFIDENCES)
def test_intervals_agree_with_scipy(counts, rest, confidence):
    drops = sum(counts) + rest
    wilson = intervals(counts, drops, 'wilson', confidence)
    simultaneous = intervals(counts, drops, 'simultaneous', confidence)
    bonferroni = 1 - (1 - confidence) / len(counts)
    for count, alone, together in zip(counts, wilson, simultaneous, strict=True):
        test = binomtest(count, drops)
        theirs = test.proportion_ci(confidence, 'wilson')
        assert alone.probability == count / drops
        assert (alone.lower, alone.upper) == pytest.approx((theirs.low, theirs.high), abs=1e-10)
        theirs = test.proportion_ci(bonferroni, 'exact')
        assert (together.lower, together.upper) == pytest.approx(
            (theirs.low, theirs.high), rel=1e-7
        )


@methods
@given(st.lists(COUNT, min_size=1, max_size=6), st.sampled_from([0, 1, 1000, 10**15]), CONFIDENCES)
def test_interval_contains_the_share_and_grows_with_confidence(method, counts, rest, confidence):
    drops = sum(counts) + rest
    narrow = intervals(counts, drops, method, confidence)
    wide = intervals(counts, drops, method, (1 + confidence) / 2)
    for count, inner, outer in zip(counts, narrow, wide, strict=True):
        assert 0 <= outer.lower <= inner.lower <= inner.probability
        assert inner.probability <= inner.upper <= outer.upper <= 1
        assert (inner.lower == 0) == (count == 0)
        assert (inner.upper == 1) == (count == drops)
    assert intervals([], drops, method) == []


@pytest.mark.parametrize(
    'wrong',
    [
        {'method': 'wald'},
        *({'confidence': each} for each in (0.5, '0.9', math.nan)),
        *({'counts': each} for each in ([3, -1], [6, 5])),
    ],
    ids=str,
)
def test_invalid_arguments_are_named(wrong):
    (value,) = wrong.values()
    with pytest.raises(InvalidValueError, match=re.escape(repr(value))):
        intervals(**({'counts': [1, 2], 'drops': 10} | wrong))


@given(st.integers(1, MAX_DROPS))
def test_checkpoints_grow_by_a_quarter_up_to_the_limit(drop_limit):
    found = checkpoints(drop_limit)
    assert found[-1] == drop_limit
    assert all(drops % CHECKPOINT_STEP == 0 for drops in found[:-1])
    for before, after in pairwise(found[:-1]):
        assert 1.25 * before <= after < 1.25 * before + CHECKPOINT_STEP
    assert found[0] == min(250, drop_limit)


def test_precision_of_maximum_drops():
    # A share of one half has the widest interval. Simultaneous intervals are wider.
    half = [MAX_DROPS // 2] * 2
    assert is_precise(half, MAX_DROPS, MIN_PRECISION, 'wilson', 0.99)
    assert is_precise([*half, *[0] * 6], MAX_DROPS, MIN_PRECISION, 'simultaneous')
    assert not is_precise([*half, *[0] * 7], MAX_DROPS, MIN_PRECISION, 'simultaneous')


def test_sample_size_of_goldberg():
    # 385 drops give 5 % at 95 % for any probability (Goldberg et al. 1999), without checkpoints.
    # A confidence of 0.9375 makes the confidence at the checkpoints 0.95.
    assert is_precise([192, 193], 385, 0.05, 'wilson', 0.9375)
    assert not is_precise([187, 188], 375, 0.05, 'wilson', 0.9375)


def test_coverage_of_stopped_runs_is_nominal():
    """The exact coverage of the interval of one aspect in stopped runs, for many shares.

    The distribution of the counts is carried from checkpoint to checkpoint, without the counts at
    which a run stops. The aspect itself stops the run, which maximizes the effect of stopping.
    """
    shares, before = np.linspace(0.01, 0.5, 99), 0
    alive = [np.ones(1) for _ in shares]
    covered, drops_made = np.zeros((2, len(shares)))
    for drops in checkpoints(MAX_DROPS):
        count = np.arange(drops + 1)
        stops = np.array([is_precise([c], drops, 0.03, 'wilson', 0.95) for c in count])
        lower, upper = bounds(count[:, None], drops, 'wilson', stopping_confidence(0.95))
        more = np.arange(drops - before + 1)
        for i, share in enumerate(shares):
            chance = np.convolve(alive[i], binom.pmf(more, more[-1], share))
            hold = (lower[:, 0] <= share) & (share <= upper[:, 0])
            covered[i] += chance[stops & hold].sum()
            drops_made[i] += drops * chance[stops].sum()
            alive[i] = np.where(stops, 0, chance)
        before = drops
        if stops.all():
            break
    frequent = covered[shares * drops_made >= 10]
    assert frequent.min() > 0.944
    assert np.quantile(frequent, 0.05) > 0.95
    assert 0.955 < frequent.mean() < 0.965


@pytest.mark.parametrize('precision', [0.000999, 0.2501, math.nan, '0.01', True])
def test_precision_outside_limits_is_refused(precision):
    with pytest.raises(InvalidValueError, match=f'invalid precision {precision!r}'):
        is_precise([5, 5], 10, precision)
