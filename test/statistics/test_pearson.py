"""Pearson's chi-square: against scipy, exact tests and how often it is wrong."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, chi2_contingency, chisquare, fisher_exact

from resting_aspects_ros.statistics.comparison import MIN_EXPECTED, TABLES, p_of_one, p_of_two

# Tolerance of a p value by random tables: five standard errors.
FIVE_ERRORS = 5 * math.sqrt(0.25 / TABLES)


def generator():
    return np.random.default_rng(7)


def counts(*numbers):
    return np.array(numbers, dtype=np.int64)


many = st.integers(2, 8).flatmap(
    lambda k: st.tuples(*[st.lists(st.integers(0, 500), min_size=k, max_size=k)] * 2)
)


@given(many)
def test_homogeneity_of_many_drops_agrees_with_scipy(rows):
    one, other = (counts(*row) for row in rows)
    seen = one + other > 0
    if min(one.sum(), other.sum()) == 0 or seen.sum() < 2:
        return
    theirs = chi2_contingency([one[seen], other[seen]], correction=False)
    if theirs.expected_freq.min() < MIN_EXPECTED:
        return
    p, source = p_of_two(one, other, generator())
    assert source == 'chi-square'
    assert p == pytest.approx(theirs.pvalue, rel=1e-6, abs=1e-300)


def test_fit_of_many_drops_agrees_with_scipy():
    found = counts(43, 138, 117, 31)
    exact = np.array([0.125, 0.375, 0.375, 0.125])
    p, source = p_of_one(found, exact, generator())
    assert source == 'chi-square'
    assert p == pytest.approx(chisquare(found, 329 * exact).pvalue)


def test_fishers_tea_tasting_experiment():
    # Fisher's lady tasting tea, 3 of 4 correct: 34 of the 70 tables deviate at least as much,
    # calculated by hand: 2 (1 + 16).
    p, source = p_of_two(counts(3, 1), counts(1, 3), generator())
    assert source == 'monte carlo'
    assert p == pytest.approx(34 / 70, abs=FIVE_ERRORS)


@pytest.mark.parametrize(
    ('one', 'other'),
    [((8, 2), (1, 5)), ((10, 0), (4, 5)), ((200, 1), (190, 4)), ((2000, 0), (30, 1))],
)
def test_homogeneity_of_few_drops_agrees_with_fishers_test(one, other):
    # Fisher orders tables by their probability. For these examples the selection is the same.
    p, source = p_of_two(counts(*one), counts(*other), generator())
    assert source == 'monte carlo'
    assert p == pytest.approx(fisher_exact([one, other]).pvalue, abs=FIVE_ERRORS)


@pytest.mark.parametrize('count', [0, 1, 2, 4])
def test_fit_of_few_drops_agrees_with_the_sum_over_outcomes(count):
    share, drops = 0.1, 12
    outcomes = np.arange(drops + 1)
    far = np.abs(outcomes - share * drops) >= abs(count - share * drops) - 1e-9
    exact = binom.pmf(outcomes, drops, share)[far].sum()
    given_shares = np.array([share, 1 - share])
    p, source = p_of_one(counts(count, drops - count), given_shares, generator())
    assert source == 'monte carlo'
    assert p == pytest.approx(exact, abs=FIVE_ERRORS)


def test_chi_square_is_used_from_five_expected_drops():
    assert p_of_two(counts(5, 95), counts(5, 95), generator()) == (1.0, 'chi-square')
    assert p_of_two(counts(4, 96), counts(5, 95), generator())[1] == 'monte carlo'
    half = np.array([0.5, 0.5])
    assert p_of_one(counts(5, 5), half, generator()) == (1.0, 'chi-square')
    assert p_of_one(counts(5, 4), half, generator())[1] == 'monte carlo'


@pytest.mark.parametrize('drops', [(40, 25), (1000, 1000)])
def test_false_positive_rate_is_at_most_p(drops):
    runs = 300
    truth = [0.6, 0.3, 0.09, 0.01]
    draw = np.random.default_rng(5)
    p = [p_of_two(*(draw.multinomial(n, truth) for n in drops), draw)[0] for _ in range(runs)]
    for level in (0.05, 0.2):
        found = np.mean(np.array(p) <= level)
        assert found <= level + 4 * math.sqrt(level * (1 - level) / runs)


def test_aspect_never_seen_does_not_change_p():
    with_it = p_of_two(counts(30, 0, 70), counts(50, 0, 50), generator())
    assert with_it == p_of_two(counts(30, 70), counts(50, 50), generator())
    exact = np.array([0.4, 0.0, 0.6])
    with_it = p_of_one(counts(30, 0, 70), exact, generator())
    assert with_it == p_of_one(counts(30, 70), exact[[0, 2]], generator())


def test_p_of_millions_of_drops_with_a_rare_aspect():
    p, source = p_of_two(counts(1_999_998, 2), counts(1_999_990, 10), generator())
    assert source == 'chi-square'
    p, source = p_of_two(counts(1_999_999, 1), counts(1_999_993, 7), generator())
    assert source == 'monte carlo'
    # Each rare drop is in either count with probability 1/2: 1 of 8, or a larger deviation.
    assert p == pytest.approx(2 * (1 + 8) / 2**8, abs=FIVE_ERRORS)


def test_p_values_at_the_border():
    assert p_of_two(counts(500, 0), counts(0, 4), generator()) == (1 / (1 + TABLES), 'monte carlo')
    assert p_of_two(counts(3), counts(1000), generator())[0] == 1
    assert p_of_one(counts(3), np.ones(1), generator())[0] == 1
    assert p_of_one(counts(99, 1), np.array([1.0, 0.0]), generator())[0] == 0
