"""The G test against scipy, its rate of false alarms, and batches that scatter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2_contingency, fisher_exact

from resting_aspects_ros.statistics.comparison import (
    MAX_UNITS,
    batch_scatter,
    g_statistic,
    p_of_window,
)

counts = st.integers(2, 8).flatmap(
    lambda k: st.tuples(*[st.lists(st.integers(0, 300), min_size=k, max_size=k).filter(any)] * 2)
)
FIVE, TWO = np.array([0.27, 0.28, 0.24, 0.13, 0.08]), np.array([0.7, 0.3])
DROPS, SIZE, LEVEL = 10_000, 30, 0.05
# Shares, drops and parts; with rare classes, and with windows larger than the simulation.
CASES = {
    'l_bracket': (FIVE, 10_000, 400),
    'two classes': ([0.9, 0.1], 1000, 100),
    'few drops': ([0.5, 0.3, 0.2], 100, 500),
    'rare class': ([0.98, 0.02], 1000, 100),
    'rare classes': ([0.97, 0.01, 0.01, 0.005, 0.005], 2000, 150),
    'few parts': ([0.4, 0.3, 0.2, 0.1], 5000, 10),
}
# With rare classes or few parts, equal statistics are frequent, and the test is cautious.
CAUTIOUS = ('rare class', 'rare classes', 'few parts')


def batches(rng, shares, number, deviation, size=SIZE):
    """Return counts of batches whose true shares have this standard deviation (Dirichlet)."""
    if deviation:
        within = deviation**2 / np.mean(shares * (1 - shares))
        shares = rng.dirichlet(shares * (1 / within - 1), size=number)
    return rng.multinomial(size, shares, size=number)


def alarm_rate(shares, deviation, number, repetitions, *, known=True, size=SIZE):
    """Return the share of runs whose last batches, at most 20, raise an alarm."""
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(repetitions):
        simulated = rng.multinomial(DROPS, shares)
        found = batches(rng, shares, number, deviation, size)
        scatter = batch_scatter(found) if known else None
        alarms += p_of_window(found[-20:].sum(axis=0), simulated, rng, LEVEL, scatter) <= LEVEL
    return alarms / repetitions


def tolerance(repetitions, rate=LEVEL):
    """Return three standard errors of a rate."""
    return 3 * np.sqrt(rate * (1 - rate) / repetitions)


@given(counts)
def test_statistic_is_that_of_scipy(pair):
    window, simulated = np.array(pair)
    seen = window + simulated > 0
    table = np.array([window, simulated])[:, seen]
    theirs = 0.0
    if seen.sum() > 1:
        theirs = chi2_contingency(table, correction=False, lambda_='log-likelihood').statistic
    assert g_statistic(window, simulated) == pytest.approx(theirs, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('window', [[110, 90, 70, 30], [128, 94, 58, 20], [140, 94, 50, 16]])
def test_p_value_of_many_parts_is_that_of_chi_square(window):
    simulated = np.array([4000, 3000, 2200, 800])
    found = p_of_window(np.array(window), simulated, np.random.default_rng(1), 0.001)
    theirs = chi2_contingency([window, simulated], lambda_='log-likelihood').pvalue
    # The relative standard error of the estimate is 10 %.
    assert found == pytest.approx(theirs, rel=0.4)


def test_p_value_of_few_parts_is_that_of_fisher():
    window, simulated = np.array([3, 9]), np.array([30, 12])
    found = p_of_window(window, simulated, np.random.default_rng(1), 0.001)
    assert found == pytest.approx(fisher_exact([window, simulated]).pvalue, rel=0.3)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('level', [0.05, 0.01])
@pytest.mark.parametrize('case', CASES)
def test_false_rate_is_the_level(case, level):
    shares, drops, parts = CASES[case]
    rng, repetitions = np.random.default_rng(5), 1000
    windows = rng.multinomial(parts, shares, size=repetitions)
    simulated = rng.multinomial(drops, shares, size=repetitions)
    alarms = sum(
        p_of_window(*pair, rng, level) <= level for pair in zip(windows, simulated, strict=True)
    )
    rate, error = alarms / repetitions, 3.3 * np.sqrt(level * (1 - level) / repetitions)
    assert rate <= level + error
    assert case in CAUTIOUS or rate >= level - error


@pytest.mark.parametrize(
    ('window', 'simulated', 'low', 'high'),
    [
        ([50, 0], [99_999, 1], 1, 1),  # the most likely window
        ([7, 0], [100, 0], 1, 1),  # a single class
        ([95, 5], [10_000, 0], 0, 0.01 / 50),  # a class that was never simulated
    ],
)
def test_p_value_at_the_border(window, simulated, low, high):
    rng = np.random.default_rng(1)
    assert low <= p_of_window(np.array(window), np.array(simulated), rng, 0.01) <= high


def test_alarms_are_too_frequent_without_the_scatter_and_not_with_it():
    repetitions = 300
    without = alarm_rate(FIVE, 0.08, 20, repetitions, known=False)
    assert without > LEVEL + 2 * tolerance(repetitions)
    assert alarm_rate(FIVE, 0.08, 20, repetitions) <= LEVEL + tolerance(repetitions)


@pytest.mark.slow
@pytest.mark.parametrize('number', [4, 20, 60])
@pytest.mark.parametrize('deviation', [0.0, 0.03, 0.08])
@pytest.mark.parametrize('shares', [FIVE, TWO], ids=['five', 'two'])
def test_alarm_rate_stays_at_its_level(shares, deviation, number):
    repetitions = 1500
    rate = alarm_rate(shares, deviation, number, repetitions)
    assert rate <= LEVEL + tolerance(repetitions)
    # With many batches the test is not needlessly cautious.
    assert number < 60 or rate > LEVEL / 2 - tolerance(repetitions)


@pytest.mark.slow
@pytest.mark.parametrize('size', [10, 100])
def test_alarm_rate_stays_at_its_level_for_other_sizes_of_batches(size):
    repetitions = 800
    rate = alarm_rate(FIVE, 0.05, 40, repetitions, size=size)
    assert rate <= LEVEL + tolerance(repetitions)


@pytest.mark.parametrize('deviation', [0.0, 0.03, 0.08])
def test_factor_is_that_of_the_intraclass_correlation(deviation):
    found = batch_scatter(batches(np.random.default_rng(3), FIVE, MAX_UNITS, deviation))
    within = deviation**2 / np.mean(FIVE * (1 - FIVE))
    expected = 1 + (SIZE - 1) * within
    # The estimate has the relative standard error of the mean of chi-square statistics. The tails
    # of a Dirichlet distribution are somewhat heavier.
    error = expected * found.reference.std()
    assert abs(found.factor - expected) < 5 * error
    assert found.reference.mean() == pytest.approx(1)


def test_one_change_of_the_shares_is_no_scatter():
    rng = np.random.default_rng(2)
    before, after = batches(rng, TWO, 21, 0.0, 500), batches(rng, TWO[::-1], 21, 0.0, 500)
    found = batch_scatter(np.concatenate([before, after]))
    assert found.factor < np.quantile(found.reference, 0.999)


def test_scatter_needs_two_batches_with_two_classes():
    assert batch_scatter(np.zeros((0, 3), dtype=np.int64)) is None
    assert batch_scatter(np.array([[30, 20, 10]])) is None
    assert batch_scatter(np.array([[30, 0, 0], [40, 0, 0]])) is None
    assert batch_scatter(np.array([[30, 20, 10], [20, 30, 10]])).batches == 2


def test_scatter_is_that_of_the_newest_batches():
    rng = np.random.default_rng(3)
    units = np.concatenate([batches(rng, TWO, 50, 0.2), batches(rng, TWO, MAX_UNITS, 0.0)])
    found, newest = batch_scatter(units), batch_scatter(units[-MAX_UNITS:])
    assert (found.factor, found.batches) == (newest.factor, MAX_UNITS)
