"""Comparisons: tests of equal shares against SciPy, and intervals of their differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest, chi2_contingency, chisquare, fisher_exact

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.comparison import (
    MAX_UNITS,
    TABLES,
    DropCounts,
    batch_scatter,
    compare,
    compare_with_exact,
    p_of_one,
    p_of_two,
    p_of_window,
    square_and_add,
)
from resting_aspects_ros.statistics.intervals import bounds

from .conftest import CONFIDENCES, COUNT, assert_ordered, batches, generator

pairs = st.integers(1, 8).flatmap(
    lambda k: st.tuples(*[st.lists(COUNT, min_size=k, max_size=k).filter(any)] * 2)
)
# Tolerance of a p value by random tables: five standard errors.
FIVE_ERRORS = 5 * math.sqrt(0.25 / TABLES)
FIVE, TWO = np.array([0.27, 0.28, 0.24, 0.13, 0.08]), np.array([0.7, 0.3])
LEVEL = 0.05


def counts(*numbers):
    return np.minimum(numbers, 10**6)


def compared(one, other, confidence=0.95):
    first, second = (DropCounts(counts(*each)) for each in (one, other))
    return compare(first, second, generator(), confidence)


def with_exact(one, probabilities, confidence=0.95):
    return compare_with_exact(DropCounts(counts(*one)), probabilities, generator(), confidence)


def errors(number, repetitions, rate=LEVEL):
    """Return a number of standard errors of a rate."""
    return number * math.sqrt(rate * (1 - rate) / repetitions)


def test_comparison_calculated_by_hand():
    # The shares of the drops in an aspect are .5 .3 .2 and .4 .2 .4.
    one = DropCounts(counts(50, 30, 20), 60, 30, 10)
    other = DropCounts(counts(80, 40, 80), 0, 50, 0)
    found = compare(one, other, generator())
    np.testing.assert_allclose(found.deviation, [0.1, 0.1, -0.2])
    assert found.total_variation == pytest.approx(0.2)
    assert found.mean_deviation == pytest.approx(0.4 / 3)
    assert (found.largest_aspect, found.largest_deviation) == (3, pytest.approx(-0.2))
    assert found.largest_bounds == (found.lower[2], found.upper[2])
    theirs = chi2_contingency([[50, 30, 20], [80, 40, 80]], correction=False)
    assert (found.p_value, found.p_by) == (pytest.approx(theirs.pvalue), 'chi-square')


def test_comparison_with_exact_probabilities_by_hand():
    given, exact = [43, 138, 117, 31], np.array([1, 3, 3, 1]) / 8
    found = with_exact(given, exact)
    assert found.p_value == pytest.approx(chisquare(given, 329 * exact).pvalue)
    for i, count in enumerate(given):
        # Clopper and Pearson's bounds, with a quarter of the error probability for each of four.
        theirs = binomtest(count, 329).proportion_ci(1 - 0.05 / 4, 'exact')
        ours = found.lower[i] + exact[i], found.upper[i] + exact[i]
        assert ours == pytest.approx((theirs.low, theirs.high))


@given(pairs, CONFIDENCES)
def test_deviations_satisfy_the_axioms_of_a_distance(pair, confidence):
    one, other = pair
    found = compared(one, other, confidence)
    assert 0 <= found.total_variation <= 1 + 1e-12
    # The gain of one aspect is the loss of the others.
    assert abs(found.largest_deviation) <= found.total_variation + 1e-12
    assert_ordered(found.lower, found.deviation, found.upper)
    np.testing.assert_allclose(compared(other, one, confidence).lower, -found.upper)
    from_exact = with_exact(other, counts(*one) / counts(*one).sum(), confidence)
    assert_ordered(from_exact.lower, from_exact.deviation, from_exact.upper)


@pytest.mark.parametrize(
    ('one', 'other', 'lower', 'upper'),
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10.
    [
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((5, 56), (0, 29), -0.0381, 0.1926),
        ((10, 10), (0, 20), 0.6791, 1.0000),
    ],
)
def test_published_intervals_of_differences(one, other, lower, upper):
    shares = [np.array([count / n]) for count, n in (one, other)]
    of_one, of_other = (bounds([count], n, 'wilson') for count, n in (one, other))
    found = square_and_add(shares[0], of_one, shares[1], of_other)
    assert [float(each[0]) for each in found] == pytest.approx([lower, upper], abs=5e-5)


def test_bounds_of_all_deviations_hold_simultaneously():
    first, second = np.array([0.6, 0.3, 0.1]), np.array([0.5, 0.3, 0.2])
    truth, held = first - second, 0
    runs, draw = 400, np.random.default_rng(6)
    for _ in range(runs):
        found = compared(draw.multinomial(1000, first), draw.multinomial(1000, second))
        held += bool(((found.lower <= truth) & (truth <= found.upper)).all())
    assert held / runs >= 0.95 - errors(4, runs)


@pytest.mark.parametrize(
    ('function', 'one', 'other', 'named'),
    [
        (compared, [0, 0], [1, 1], r'counts \[0, 0\] of the first'),
        (compared, [1, 1], [1, 1, 1], 'number of aspects 3 of the second'),
        (with_exact, [5, 5], [1.0], 'number of aspects 1'),
    ],
)
def test_what_cannot_be_compared_is_refused(function, one, other, named):
    with pytest.raises(InvalidValueError, match=named):
        function(one, other)


@pytest.mark.parametrize(
    ('one', 'other'),
    # The first is Fisher's lady tasting tea, the last of millions of drops with a rare aspect.
    [((3, 1), (1, 3)), ((10, 0), (4, 5)), ((999_999, 1), (999_993, 7))],
)
def test_homogeneity_of_few_drops_agrees_with_fishers_test(one, other):
    # Fisher orders tables by their probability. For these examples the selection is the same.
    p, source = p_of_two(counts(*one), counts(*other), generator())
    assert source == 'monte carlo'
    assert p == pytest.approx(fisher_exact([one, other]).pvalue, abs=FIVE_ERRORS)


@pytest.mark.parametrize('count', [0, 2, 4])
def test_fit_of_few_drops_agrees_with_the_sum_over_outcomes(count):
    share, drops = 0.1, 12
    outcomes = np.arange(drops + 1)
    far = np.abs(outcomes - share * drops) >= abs(count - share * drops) - 1e-9
    exact = binom.pmf(outcomes, drops, share)[far].sum()
    given_shares = np.array([share, 1 - share])
    p, source = p_of_one(counts(count, drops - count), given_shares, generator())
    assert source == 'monte carlo'
    assert p == pytest.approx(exact, abs=FIVE_ERRORS)


def test_p_values_at_the_border():
    assert p_of_two(counts(500, 0), counts(0, 4), generator()) == (1 / (1 + TABLES), 'monte carlo')
    assert p_of_two(counts(3), counts(1000), generator())[0] == 1
    assert p_of_one(counts(99, 1), np.array([1.0, 0.0]), generator())[0] == 0
    # The most likely window, a single class, and a class that was never simulated.
    assert p_of_window(counts(50, 0), counts(99_999, 1), generator(), 0.01) == 1
    assert p_of_window(counts(7, 0), counts(100, 0), generator(), 0.01) == 1
    assert p_of_window(counts(95, 5), counts(10_000, 0), generator(), 0.01) < 0.01 / 50


def test_p_value_of_a_window_is_that_of_chi_square_or_fisher():
    window, simulated = np.array([140, 94, 50, 16]), np.array([4000, 3000, 2200, 800])
    found = p_of_window(window, simulated, generator(), 0.001)
    theirs = chi2_contingency([window, simulated], lambda_='log-likelihood').pvalue
    # The relative standard error of the estimate is 10 %.
    assert found == pytest.approx(theirs, rel=0.4)
    few, drops = np.array([3, 9]), np.array([30, 12])
    theirs = fisher_exact([few, drops]).pvalue
    assert p_of_window(few, drops, generator(), 0.001) == pytest.approx(theirs, rel=0.3)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('shares', 'deviation', 'number', 'size'),
    [(FIVE, 0.08, 4, 30), (FIVE, 0.0, 1, 600), (FIVE, 0.0, 60, 30), (TWO, 0.08, 60, 10)],
)
def test_alarm_rate_stays_at_its_level(shares, deviation, number, size):
    rng, repetitions, alarms = np.random.default_rng(5), 400, 0
    for _ in range(repetitions):
        simulated = rng.multinomial(10_000, shares)
        found = batches(rng, shares, number, deviation, size)
        window, scatter = found[-20:].sum(axis=0), batch_scatter(found)
        alarms += p_of_window(window, simulated, rng, LEVEL, scatter) <= LEVEL
    rate = alarms / repetitions
    assert rate <= LEVEL + errors(3, repetitions)
    # With one batch the scatter is not known; with many the test is not needlessly cautious.
    least = {1: LEVEL, 60: LEVEL / 2}.get(number, 0.0)
    assert rate >= least - errors(3, repetitions)


@pytest.mark.parametrize('deviation', [0.0, 0.08])
def test_factor_is_that_of_the_intraclass_correlation(deviation):
    rng = np.random.default_rng(3)
    old, newest = batches(rng, FIVE, 50, 0.2), batches(rng, FIVE, MAX_UNITS, deviation)
    found = batch_scatter(np.concatenate([old, newest]))
    assert found.batches == MAX_UNITS
    within = deviation**2 / np.mean(FIVE * (1 - FIVE))
    expected = 1 + (30 - 1) * within
    # The estimate has the relative standard error of the mean of chi-square statistics. The tails
    # of a Dirichlet distribution are somewhat heavier.
    assert abs(found.factor - expected) < 5 * expected * found.reference.std()
    assert found.reference.mean() == pytest.approx(1)


def test_one_change_of_the_shares_is_no_scatter():
    rng = np.random.default_rng(2)
    before, after = batches(rng, TWO, 21, 0.0, 500), batches(rng, TWO[::-1], 21, 0.0, 500)
    found = batch_scatter(np.concatenate([before, after]))
    assert found.factor < np.quantile(found.reference, 0.999)


def test_scatter_needs_two_batches_with_two_classes():
    assert batch_scatter(np.array([[30, 20, 10]])) is None
    assert batch_scatter(np.array([[30, 0, 0], [40, 0, 0]])) is None
    assert batch_scatter(np.array([[30, 20, 10], [20, 30, 10]])).batches == 2
