"""Comparisons: distances by hand, published intervals, and how often they cover the truth."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, chi2_contingency, chisquare

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.comparison import (
    DropCounts,
    compare,
    compare_with_exact,
    square_and_add,
)
from resting_aspects_ros.statistics.intervals import bounds

pairs = st.integers(1, 8).flatmap(
    lambda k: st.tuples(*[st.lists(st.integers(0, 300), min_size=k, max_size=k).filter(any)] * 2)
)


def tally(numbers, *rest):
    return DropCounts(np.array(numbers, dtype=np.int64), *rest)


def compared(one, other, **options):
    return compare(tally(one), tally(other), np.random.default_rng(1), **options)


def test_comparison_calculated_by_hand():
    # The shares of the drops in an aspect are .5 .3 .2 and .4 .2 .4.
    one = tally([50, 30, 20], 60, 30, 10)
    other = tally([80, 40, 80], 0, 50, 0)
    found = compare(one, other, np.random.default_rng(1))
    np.testing.assert_allclose(found.first, [0.5, 0.3, 0.2])
    np.testing.assert_allclose(found.second, [0.4, 0.2, 0.4])
    np.testing.assert_allclose(found.deviation, [0.1, 0.1, -0.2])
    assert found.total_variation == pytest.approx(0.2)
    assert found.mean_deviation == pytest.approx(0.4 / 3)
    assert found.largest_aspect == 3
    assert found.largest_deviation == pytest.approx(-0.2)
    assert found.largest_bounds == (found.lower[2], found.upper[2])
    assert found.p_value == pytest.approx(
        chi2_contingency([[50, 30, 20], [80, 40, 80]], correction=False).pvalue
    )
    assert found.p_by == 'chi-square'
    assert found.confidence == 0.95


def test_comparison_with_exact_probabilities_by_hand():
    found = compare_with_exact(
        tally([43, 138, 117, 31], 3, 0, 1), [1 / 8, 3 / 8, 3 / 8, 1 / 8], np.random.default_rng(1)
    )
    np.testing.assert_allclose(found.first, np.array([43, 138, 117, 31]) / 329)
    np.testing.assert_array_equal(found.second, [0.125, 0.375, 0.375, 0.125])
    assert found.largest_aspect == 2
    assert found.largest_deviation == pytest.approx(138 / 329 - 0.375)
    expected = 329 * found.second
    assert found.p_value == pytest.approx(chisquare([43, 138, 117, 31], expected).pvalue)
    for i, count in enumerate([43, 138, 117, 31]):
        # Clopper and Pearson's bounds, with a quarter of the error probability for each of four.
        theirs = binomtest(count, 329).proportion_ci(1 - 0.05 / 4, 'exact')
        ours = found.lower[i] + found.second[i], found.upper[i] + found.second[i]
        assert ours == pytest.approx((theirs.low, theirs.high))


@given(pairs, st.integers(0, 50))
def test_deviations_satisfy_the_axioms_of_a_distance(pair, rest):
    one, other = pair
    found = compared(one, other)
    deviation = np.abs(found.deviation)
    assert 0 <= found.total_variation <= 1 + 1e-12
    assert deviation.max() == abs(found.largest_deviation)
    # The gain of one aspect is the loss of the others.
    assert abs(found.largest_deviation) <= found.total_variation + 1e-12
    assert found.mean_deviation == pytest.approx(2 * found.total_variation / len(one))
    assert (found.lower <= found.deviation).all()
    assert (found.deviation <= found.upper).all()
    assert 0 < found.p_value <= 1 or found.p_by == 'chi-square'
    back = compared(other, one)
    np.testing.assert_allclose(back.deviation, -found.deviation)
    np.testing.assert_allclose(back.lower, -found.upper)
    assert back.total_variation == pytest.approx(found.total_variation)
    # Drops in no aspect do not change the comparison.
    with_rest = compare(tally(one, rest, rest, rest), tally(other), np.random.default_rng(1))
    assert with_rest.total_variation == found.total_variation
    assert with_rest.p_value == found.p_value


@given(pairs)
def test_distribution_does_not_differ_from_itself(pair):
    one, _ = pair
    for found in (
        compared(one, one),
        compare_with_exact(tally(one), np.array(one) / sum(one), np.random.default_rng(1)),
    ):
        assert found.total_variation == pytest.approx(0, abs=1e-15)
        assert found.p_value == pytest.approx(1)
        assert (found.lower <= 1e-15).all()
        assert (found.upper >= -1e-15).all()


@pytest.mark.parametrize(
    ('one', 'other', 'lower', 'upper'),
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10.
    [
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((6, 7), (2, 7), 0.0582, 0.8062),
        ((5, 56), (0, 29), -0.0381, 0.1926),
        ((0, 10), (0, 20), -0.1611, 0.2775),
        ((0, 10), (0, 10), -0.2775, 0.2775),
        ((10, 10), (0, 20), 0.6791, 1.0000),
    ],
)
def test_published_intervals_of_differences(one, other, lower, upper):
    shares = [np.array([count / n]) for count, n in (one, other)]
    of_one, of_other = (bounds([count], n, 'wilson') for count, n in (one, other))
    found = square_and_add(shares[0], of_one, shares[1], of_other)
    assert [float(each[0]) for each in found] == pytest.approx([lower, upper], abs=5e-5)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('first', 'second', 'drops'),
    [
        ([0.6, 0.3, 0.1], [0.5, 0.3, 0.2], (1000, 1000)),
        ([0.6, 0.3, 0.1], [0.6, 0.3, 0.1], (2000, 100)),
        ([0.5, 0.5], [0.4, 0.6], (300, 100_000)),
        ([0.9985, *[1e-4] * 15], [0.9985, *[1e-4] * 15], (1000, 1_000_000)),
        ([0.9985, *[1e-4] * 15], [0.9985, *[1e-4] * 15], (1000, 1000)),
    ],
)
def test_bounds_of_all_deviations_hold_simultaneously(first, second, drops):
    runs = 400
    draw = np.random.default_rng(6)
    held = 0
    truth = np.array(first) - np.array(second)
    for _ in range(runs):
        one, other = (draw.multinomial(n, p) for n, p in zip(drops, (first, second), strict=True))
        found = compare(tally(one), tally(other), draw)
        held += bool(((found.lower <= truth) & (truth <= found.upper)).all())
    # Four standard errors of a share counted in this number of runs are subtracted.
    assert held / runs >= 0.95 - 4 * math.sqrt(0.95 * 0.05 / runs)


@pytest.mark.parametrize(
    ('one', 'other', 'named'),
    [
        ([0, 0], [1, 1], r'counts \[0, 0\] of the first'),
        ([1, 1], [2, -1], r'counts \[2, -1\] of the second'),
        ([], [], r'counts \[\] of the first'),
        ([1, 1], [1, 1, 1], 'number of aspects 3 of the second distribution: expected 2'),
    ],
)
def test_counts_that_cannot_be_compared_are_refused(one, other, named):
    with pytest.raises(InvalidValueError, match=named):
        compared(one, other)


@pytest.mark.parametrize('exact', [[0.5, 0.6], [1.5, -0.5], [1.0, math.nan], [1.0]])
def test_invalid_probabilities_are_refused(exact):
    with pytest.raises(InvalidValueError, match='invalid'):
        compare_with_exact(tally([5, 5]), exact, np.random.default_rng(1))
