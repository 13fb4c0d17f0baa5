"""Intervals: against scipy, published examples, and how often they cover the truth."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.intervals import METHODS, Interval, bounds, intervals

counted = st.lists(st.integers(0, 10**6), min_size=1, max_size=20)
confidences = st.floats(0.501, 0.9999)
methods = pytest.mark.parametrize('method', METHODS)


def five_standard_errors(runs, share):
    """Return the tolerance of a share that is counted in this number of runs."""
    return 5 * math.sqrt(share * (1 - share) / runs)


def together(truth, drops, method, confidence, runs, seed):
    """Return the share of simulated runs in which the intervals of all aspects hold."""
    truth = np.array(truth)
    rest = max(0.0, 1 - truth.sum())
    counts = np.random.default_rng(seed).multinomial(drops, [*truth, rest], size=runs)[:, :-1]
    lower, upper = bounds(counts, drops, method, confidence)
    return ((lower <= truth) & (truth <= upper)).all(axis=1).mean()


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


@given(counted, st.integers(0, 1000))
def test_simultaneous_is_wider_than_single_exact_intervals(counts, rest):
    drops = sum(counts) + rest
    every = intervals(counts, drops, 'simultaneous')
    for count, one in zip(counts, every, strict=True):
        (alone,) = intervals([count], drops, 'simultaneous')
        assert one.lower <= alone.lower
        assert one.upper >= alone.upper


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


@pytest.mark.parametrize('drops', [250, 1000, 2375])
def test_mean_coverage_of_wilson_is_nominal(drops):
    # The coverage is computed exactly, over all counts. Because counts are integers, its mean over
    # p deviates from the nominal one by less than 0.002 from 250 drops on.
    p = np.linspace(10 / drops, 1 - 10 / drops, 501)[:, None]
    count = np.arange(drops + 1)
    lower, upper = bounds(np.stack([count, drops - count], axis=-1), drops)
    hold = (lower[:, 0] <= p) & (p <= upper[:, 0])
    covered = (binom.pmf(count, drops, p) * hold).sum(axis=1)
    assert covered.mean() == pytest.approx(0.95, abs=0.002)
    assert covered.min() > 0.93


def test_wilson_coverage_is_low_for_a_fifth_of_a_drop():
    # This weakness of the method is known (Brown, Cai, DasGupta 2001). The lower bound of count 1
    # is 0.1765 / n, so just below it the interval of every run with a drop misses the truth.
    expected = 0.17
    missed = 1 - math.exp(-expected)
    found = together([expected / 1000], 1000, 'wilson', 0.95, 20_000, seed=2)
    assert found == pytest.approx(1 - missed, abs=five_standard_errors(20_000, missed))


DISTRIBUTIONS = {
    'two': [0.5, 0.5],
    'skewed': [0.9, 0.05, 0.03, 0.019, 0.001],
    'with a rest': [0.6, 0.2, 0.1],
    'twenty': [0.05] * 20,
    'nineteen rare': [0.9981, *[0.0001] * 19],
    'nineteen rarer': [1 - 19 * 8e-5, *[8e-5] * 19],
}


@pytest.mark.quick_cases(12)
@pytest.mark.parametrize('confidence', [0.8, 0.95, 0.99])
@pytest.mark.parametrize('drops', [100, 1000])
@pytest.mark.parametrize('name', DISTRIBUTIONS)
def test_simultaneous_intervals_have_their_nominal_coverage(name, drops, confidence):
    runs = 4000
    held = together(DISTRIBUTIONS[name], drops, 'simultaneous', confidence, runs, seed=3)
    assert held >= confidence - five_standard_errors(runs, confidence)


def test_goodmans_intervals_have_less_than_nominal_coverage():
    # The reason why `simultaneous` is not Goodman's method, which divides the error of Wilson's
    # interval by k.
    truth = DISTRIBUTIONS['nineteen rarer']
    k = len(truth)
    assert together(truth, 1000, 'wilson', 1 - 0.05 / k, 4000, seed=4) < 0.3
    assert together(truth, 1000, 'simultaneous', 0.95, 4000, seed=4) > 0.99


@pytest.mark.parametrize(
    ('asked', 'expected'),
    [
        ({'method': 'wald'}, "invalid interval 'wald': expected wilson or simultaneous"),
        ({'method': ''}, "invalid interval '': expected wilson or simultaneous"),
        ({'confidence': 0.5}, 'invalid confidence 0.5: expected more than 0.5 and less than 1'),
        ({'confidence': 1}, 'invalid confidence 1: expected more than 0.5 and less than 1'),
        ({'confidence': 95}, 'invalid confidence 95: expected more than 0.5 and less than 1'),
        ({'confidence': True}, 'invalid confidence True: expected more than 0.5 and less than 1'),
        (
            {'confidence': '0.9'},
            "invalid confidence '0.9': expected more than 0.5 and less than 1",
        ),
        (
            {'confidence': math.nan},
            'invalid confidence nan: expected more than 0.5 and less than 1',
        ),
        (
            {'counts': [3, -1]},
            'invalid counts [3, -1]: expected 0 or more, at most 10 in total',
        ),
        (
            {'counts': [6, 5]},
            'invalid counts [6, 5]: expected 0 or more, at most 10 in total',
        ),
    ],
)
def test_error_for_invalid_argument(asked, expected):
    with pytest.raises(InvalidValueError) as caught:
        intervals(**({'counts': [1, 2], 'drops': 10} | asked))
    assert str(caught.value) == expected
