"""P values of Pearson's chi-square tests, which are also valid for few drops."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.special import chdtrc

from resting_aspects_ros.arrays import Array, Counts

# The chi-square distribution is used where all expected counts are at least this (Cochran 1954).
# With smaller counts its p value can be wrong by a factor of several, and random tables are
# counted instead.
MIN_EXPECTED = 5.0
# Number of random tables: the standard error of a p value of 0.05 is then 0.002.
TABLES = 9999

Source = Literal['chi-square', 'monte carlo']


def p_of_two(one: Counts, other: Counts, generator: np.random.Generator) -> tuple[float, Source]:
    """Return the p value of Pearson's test of homogeneity: both counts have the same true shares.

    one, other : (k,) int
        Counts by aspect, with at least one drop each.
    """
    # An aspect with no drop in either count does not contribute to the difference.
    columns = (one + other)[one + other > 0]
    one = one[one + other > 0]
    share = one.sum() / columns.sum()
    expected, expected_other = columns * share, columns * (1 - share)

    def draw(tables: int) -> Counts:
        # Both margins are fixed, as in Fisher's exact test.
        return generator.multivariate_hypergeometric(
            columns, int(one.sum()), size=tables, method='marginals'
        )

    min_expected = min(expected.min(), expected_other.min())
    # Both rows have the same deviations, with opposite signs.
    return _p_value(one, expected, 1 / expected + 1 / expected_other, min_expected, draw)


def p_of_one(one: Counts, exact: Array, generator: np.random.Generator) -> tuple[float, Source]:
    """Return the p value of Pearson's test of goodness of fit: the true shares are ``exact``.

    one : (k,) int
        Counts by aspect, with at least one drop.
    exact : (k,) float
        Probabilities; their sum is 1.
    """
    if (one[exact == 0] > 0).any():
        # An aspect with probability 0 was observed.
        return 0.0, 'chi-square'
    one, exact = one[exact > 0], exact[exact > 0]
    drops = int(one.sum())
    expected = drops * exact

    def draw(tables: int) -> Counts:
        return generator.multinomial(drops, exact, size=tables)

    return _p_value(one, expected, 1 / expected, float(expected.min()), draw)


def _p_value(
    counts: Counts,
    expected: Array,
    weights: Array,
    min_expected: float,
    draw: Callable[[int], Counts],
) -> tuple[float, Source]:
    """Return the probability that the weighted sum of squares is at least that of the counts."""

    def statistic(each: Counts) -> Array:
        return np.asarray((weights * (each - expected) ** 2).sum(axis=-1), dtype=np.float64)

    found = float(statistic(counts))
    if len(counts) == 1:
        return 1.0, 'chi-square'
    if min_expected >= MIN_EXPECTED:
        return float(chdtrc(len(counts) - 1, found)), 'chi-square'
    # Tables with an equal statistic count in spite of rounding. The observed table is counted too;
    # otherwise the p value could be 0 (Phipson, Smyth 2010).
    as_far = int((statistic(draw(TABLES)) >= found * (1 - 1e-9) - 1e-9).sum())
    return (1 + as_far) / (1 + TABLES), 'monte carlo'
