"""Stopping: where runs are looked at, when they are precise, and what that costs in coverage."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics.intervals import METHODS, bounds
from resting_aspects_ros.core.statistics.stopping import (
    LOOK_STEP,
    MAX_PRECISION,
    MIN_PRECISION,
    check_precision,
    is_precise,
    looks,
    stopping_confidence,
)
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.run_description import MAX_DROPS

methods = pytest.mark.parametrize('method', METHODS)
precisions = st.floats(MIN_PRECISION, MAX_PRECISION)


def test_the_first_looks_are_spelled_out():
    assert looks(2000) == [250, 375, 500, 625, 875, 1125, 1500, 1875, 2000]


@given(st.integers(1, MAX_DROPS))
def test_looks_grow_by_about_a_quarter_up_to_the_ceiling(ceiling):
    found = looks(ceiling)
    assert found[-1] == ceiling
    assert all(look % LOOK_STEP == 0 for look in found[:-1])
    for before, after in pairwise(found[:-1]):
        assert 1.25 * before <= after < 1.25 * before + LOOK_STEP
    assert found[0] == min(250, ceiling)
    assert len(found) <= 39


@given(st.integers(1, MAX_DROPS), st.integers(1, MAX_DROPS))
def test_the_ceiling_does_not_move_the_looks_below_it(a, b):
    low, high = min(a, b), max(a, b)
    assert looks(low)[:-1] == [look for look in looks(high) if look < low]


def test_a_look_is_at_the_end_of_a_chunk_of_drops():
    assert LOOK_STEP == CHUNK


@pytest.mark.parametrize('ceiling', [0, -5])
def test_a_ceiling_below_one_drop_is_refused(ceiling):
    with pytest.raises(InvalidValueError, match=rf'^ceiling is {ceiling} drops, allowed is 1 or'):
        looks(ceiling)


@pytest.mark.parametrize('precision', [MIN_PRECISION, 0.01, MAX_PRECISION])
def test_a_precision_within_bounds_is_allowed(precision):
    check_precision(precision)


@pytest.mark.parametrize(
    'precision', [0, -0.01, 0.000999, 0.2501, 1, math.nan, math.inf, '0.01', True, None]
)
def test_another_precision_is_refused_in_words(precision):
    for refuse in (check_precision, lambda p: is_precise([5, 5], 10, p)):
        with pytest.raises(InvalidValueError) as caught:
            refuse(precision)
        assert str(caught.value) == f'precision is {precision!r}, allowed is 0.001 to 0.25'


def test_the_least_precision_is_reached_by_the_most_drops_and_the_most_by_the_first_look():
    # A share of one half has the widest interval.
    half = [MAX_DROPS // 2] * 2
    for confidence in (0.9, 0.95, 0.99):
        assert is_precise(half, MAX_DROPS, MIN_PRECISION, 'wilson', confidence)
        assert is_precise([125, 125], 250, 0.1, 'wilson', confidence)
    # All at once costs more.
    assert is_precise([*half, *[0] * 6], MAX_DROPS, MIN_PRECISION, 'simultaneous')
    assert not is_precise([*half, *[0] * 7], MAX_DROPS, MIN_PRECISION, 'simultaneous')


@methods
@given(st.lists(st.integers(0, 3000), min_size=1, max_size=8), st.integers(1, 500), precisions)
def test_precise_means_that_every_interval_is_narrow_enough(method, counts, rest, precision):
    drops = sum(counts) + rest
    error = 0.8 * 0.05 / (len(counts) if method == 'simultaneous' else 1)
    theirs = 'exact' if method == 'simultaneous' else 'wilson'
    found = [binomtest(c, drops).proportion_ci(1 - error, theirs) for c in counts]
    widest = max(each.high - each.low for each in found) / 2
    if abs(widest - precision) > 1e-9:
        assert is_precise(counts, drops, precision, method) == (widest <= precision)


@methods
def test_an_aspect_never_seen_counts_as_well(method):
    # With so few drops its upper bound is what is too wide.
    assert not is_precise([0], 50, 0.03, method)
    assert not is_precise([0, 0], 50, 0.03, method)
    assert is_precise([0], 250, 0.03, method)


@methods
def test_without_drops_nothing_is_precise(method):
    assert not is_precise([0, 0], 0, MAX_PRECISION, method)


def test_goldbergs_sample_size():
    # 385 drops give 5 % at 95 % of any probability (Goldberg et al. 1999), without looking.
    # 0.9375 is what makes the confidence of the looks 0.95.
    assert is_precise([192, 193], 385, 0.05, 'wilson', 0.9375)
    assert not is_precise([187, 188], 375, 0.05, 'wilson', 0.9375)


def test_looks_are_at_a_slightly_larger_confidence():
    assert stopping_confidence() == pytest.approx(0.96)
    assert stopping_confidence(0.9) == pytest.approx(0.92)
    with pytest.raises(InvalidValueError, match=r'^confidence is 2, allowed is more than 0\.5'):
        stopping_confidence(2)


def coverage_when_stopped(precision, confidence, shares):
    """Exactly: how often the interval of one aspect holds when its run stops, for each share.

    The counts' distribution is carried from look to look; what stops is taken out of it. It is
    the aspect itself that decides, so that the effect of stopping is at its largest.
    """
    alive = [np.ones(1) for _ in shares]
    covered, drops_made = np.zeros(len(shares)), np.zeros(len(shares))
    before = 0
    for drops in looks(MAX_DROPS):
        count = np.arange(drops + 1)
        stops = np.array([is_precise([c], drops, precision, 'wilson', confidence) for c in count])
        lower, upper = bounds(count[:, None], drops, 'wilson', stopping_confidence(confidence))
        more = np.arange(drops - before + 1)
        for i, share in enumerate(shares):
            chance = np.convolve(alive[i], binom.pmf(more, more[-1], share))
            hold = (lower[:, 0] <= share) & (share <= upper[:, 0])
            covered[i] += chance[stops & hold].sum()
            drops_made[i] += drops * chance[stops].sum()
            alive[i] = np.where(stops, 0, chance)
        before = drops
        if stops.all():
            return covered[shares * drops_made >= 10]
    raise AssertionError('no number of drops is enough')


SHARES = np.linspace(0.01, 0.5, 99)


@pytest.mark.parametrize('precision', [0.05, 0.03, 0.02])
def test_coverage_at_the_stop_is_what_was_asked_for(precision):
    covered = coverage_when_stopped(precision, 0.95, SHARES)
    assert covered.min() > 0.944
    assert np.quantile(covered, 0.05) > 0.95
    assert 0.955 < covered.mean() < 0.965


def test_without_the_larger_confidence_it_would_be_right_only_on_the_mean():
    # Looks and intervals at 0.95.
    covered = coverage_when_stopped(0.03, 0.9375, SHARES)
    assert 0.93 < covered.min() < 0.94
    assert covered.mean() == pytest.approx(0.95, abs=0.002)


DISTRIBUTIONS = {
    'two': [0.7, 0.3],
    'two, one rare': [0.999, 0.001],
    'three and a rest': [0.6, 0.2, 0.1],
    'five, one rare': [0.6, 0.25, 0.1, 0.049, 0.001],
    'twenty alike': [0.05] * 20,
    'twenty falling': [*np.geomspace(0.3, 0.004, 18) / 1.36, 0.001, 0.001],
}
RUNS = 500


def stopped_runs(truth, precision, method):
    """Counts and drops of runs, each stopped when it is precise."""
    generator = np.random.default_rng(8)
    chances = [*truth, max(0.0, 1 - sum(truth))]
    counts, drops = np.zeros((RUNS, len(truth)), dtype=np.int64), np.zeros(RUNS, dtype=np.int64)
    for i in range(RUNS):
        for look in looks(MAX_DROPS):
            counts[i] += generator.multinomial(look - drops[i], chances)[:-1]
            drops[i] = look
            if is_precise(counts[i], look, precision, method):
                break
    return counts, drops


@methods
@pytest.mark.parametrize('name', DISTRIBUTIONS)
def test_stopped_runs_cover_the_truth_and_are_as_precise_as_asked(name, method):
    truth = np.array(DISTRIBUTIONS[name])
    counts, drops = stopped_runs(truth.tolist(), 0.02, method)
    lower, upper = bounds(counts, drops, method, stopping_confidence())
    assert (upper - lower).max() <= 0.04
    assert (np.abs(counts / drops[:, None] - truth) < 0.02).all(axis=1).mean() > 0.7
    hold = (lower <= truth) & (truth <= upper)
    # Four standard errors of a share counted in RUNS runs, of the worst of up to twenty.
    tolerance = 4 * math.sqrt(0.95 * 0.05 / RUNS)
    if method == 'simultaneous':
        assert hold.all(axis=1).mean() >= 0.95 - tolerance
    else:
        assert hold.mean(axis=0).min() >= 0.95 - tolerance
