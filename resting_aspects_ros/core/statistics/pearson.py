"""Whether chance explains a difference: p values of Pearson's chi-square, also of few drops."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.special import chdtrc

from resting_aspects_ros.core.statistics.intervals import Array, Counts

# The chi-square distribution is used where all expected counts are at least this (Cochran 1954).
# With less its p can be off by a multiple, and it is counted among drawn tables instead.
MIN_EXPECTED = 5.0
# So many of them: the standard error of a p of 0.05 is 0.002.
TABLES = 9999

Source = Literal['chi-square', 'monte carlo']


def p_of_two(one: Counts, other: Counts, generator: np.random.Generator) -> tuple[float, Source]:
    """Pearson's test of homogeneity: are two counts over the same aspects of the same shares.

    one, other : (k,) int
        At least one drop each.
    """
    # An aspect that neither saw says nothing of a difference.
    columns = (one + other)[one + other > 0]
    one = one[one + other > 0]
    share = one.sum() / columns.sum()
    expected, of_other = columns * share, columns * (1 - share)

    def draw(tables: int) -> Counts:
        # With both margins as they are, as in Fisher's exact test.
        return generator.multivariate_hypergeometric(
            columns, int(one.sum()), size=tables, method='marginals'
        )

    least = min(expected.min(), of_other.min())
    # The rows deviate alike, with opposite signs.
    return _p_value(one, expected, 1 / expected + 1 / of_other, least, draw)


def p_of_one(one: Counts, exact: Array, generator: np.random.Generator) -> tuple[float, Source]:
    """Pearson's test of goodness of fit: are counts of these shares.

    one : (k,) int
        At least one drop.
    exact : (k,) float
        Probabilities that add up to 1.
    """
    if (one[exact == 0] > 0).any():
        # What cannot happen has happened.
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
    least: float,
    draw: Callable[[int], Counts],
) -> tuple[float, Source]:
    """How often the weighted sum of squared deviations is at least what it is of the counts."""

    def statistic(each: Counts) -> Array:
        return np.asarray((weights * (each - expected) ** 2).sum(axis=-1), dtype=np.float64)

    found = float(statistic(counts))
    if len(counts) == 1:
        return 1.0, 'chi-square'
    if least >= MIN_EXPECTED:
        return float(chdtrc(len(counts) - 1, found)), 'chi-square'
    # Equal tables count, whatever the rounding; the observed one is one of them, without which a
    # p could be 0 (Phipson, Smyth 2010).
    as_far = int((statistic(draw(TABLES)) >= found * (1 - 1e-9) - 1e-9).sum())
    return (1 + as_far) / (1 + TABLES), 'monte carlo'
