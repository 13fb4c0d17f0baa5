"""The G test against scipy, and its false rate without drift."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2_contingency, fisher_exact, power_divergence

from resting_aspects_ros.core.statistics.g_test import g_statistic, p_of_window

counts = st.integers(2, 8).flatmap(
    lambda k: st.tuples(*[st.lists(st.integers(0, 300), min_size=k, max_size=k).filter(any)] * 2)
)
REPETITIONS = 1000
# Shares, drops and parts; with rare classes, and with windows larger than the simulation.
CASES = {
    'l_bracket': ([0.27, 0.28, 0.24, 0.13, 0.08], 10_000, 400),
    'two classes': ([0.9, 0.1], 1000, 100),
    'rare class': ([0.98, 0.02], 1000, 100),
    'rare classes': ([0.97, 0.01, 0.01, 0.005, 0.005], 2000, 150),
    'few drops': ([0.5, 0.3, 0.2], 100, 500),
    'few parts': ([0.4, 0.3, 0.2, 0.1], 5000, 10),
}


@given(counts)
def test_statistic_is_that_of_scipy(pair):
    window, simulated = np.array(pair)
    seen = window + simulated > 0
    table = np.array([window, simulated])[:, seen]
    theirs = 0.0
    if seen.sum() > 1:
        theirs = chi2_contingency(table, correction=False, lambda_='log-likelihood').statistic
    assert g_statistic(window, simulated) == pytest.approx(theirs, rel=1e-9, abs=1e-9)


def test_many_drops_give_the_statistic_of_exact_shares():
    window, shares = np.array([43, 138, 117, 31]), np.array([1, 3, 3, 1]) / 8
    theirs = power_divergence(window, 329 * shares, lambda_='log-likelihood').statistic
    found = g_statistic(window, (shares * 1e8).astype(np.int64))
    assert found == pytest.approx(theirs, rel=1e-4)


@pytest.mark.parametrize('window', [[110, 90, 70, 30], [128, 94, 58, 20], [140, 94, 50, 16]])
def test_p_value_of_many_parts_is_that_of_chi_square(window):
    simulated = np.array([4000, 3000, 2200, 800])
    found = p_of_window(np.array(window), simulated, np.random.default_rng(1), 0.001)
    theirs = chi2_contingency([window, simulated], lambda_='log-likelihood').pvalue
    # The relative standard error of both is 10 % at most.
    assert found == pytest.approx(theirs, rel=0.4)


def test_p_value_of_few_parts_is_that_of_fisher():
    window, simulated = np.array([3, 9]), np.array([30, 12])
    found = p_of_window(window, simulated, np.random.default_rng(1), 0.001)
    theirs = fisher_exact([window, simulated]).pvalue
    tied = theirs - fisher_exact([[2, 10], [31, 11]]).pvalue
    assert theirs - tied - 0.3 * theirs <= found <= 1.3 * theirs


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('level', [0.05, 0.01])
@pytest.mark.parametrize('case', CASES)
def test_false_rate_is_the_level(case, level):
    shares, drops, parts = CASES[case]
    rng = np.random.default_rng(5)
    windows = rng.multinomial(parts, shares, size=REPETITIONS)
    simulated = rng.multinomial(drops, shares, size=REPETITIONS)
    alarms = sum(
        p_of_window(*pair, rng, level) <= level for pair in zip(windows, simulated, strict=True)
    )
    error = np.sqrt(level * (1 - level) / REPETITIONS)
    assert abs(alarms / REPETITIONS - level) <= 3.3 * error


def test_most_likely_window_is_never_an_alarm():
    simulated, window = np.array([99_999, 1]), np.array([50, 0])
    rng = np.random.default_rng(1)
    assert min(p_of_window(window, simulated, rng, 0.25) for _ in range(200)) > 0.25


def test_single_class_cannot_drift():
    rng = np.random.default_rng(1)
    assert p_of_window(np.array([7, 0]), np.array([100, 0]), rng, 0.01) == 1


def test_class_that_was_never_simulated_is_an_alarm():
    rng = np.random.default_rng(1)
    assert p_of_window(np.array([95, 5]), np.array([10_000, 0]), rng, 0.01) == 0.01 / 100
