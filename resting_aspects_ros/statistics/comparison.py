"""Compare distributions: tests of equal shares, and intervals of their differences."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, xlogy

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, SIMULTANEOUS, bounds

# -- Chi-square -----------------------------------------------------------------------------------


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


# -- Likelihood ratio -----------------------------------------------------------------------------


# Tables are drawn until about this number deviates at least as much as the window. The relative
# standard error of a p value near the level is then 10 %.
EXCEEDANCES = 100
FIRST_TABLES = 256
# Smaller batches are joined until they have this number of parts. With fewer, the variance of the
# statistic of a pair is not that of chi-square.
UNIT = 30
# The newest batches, from which the scatter is estimated.
MAX_UNITS = 1000
# Draws of the estimate, from which its uncertainty follows, and their seed.
DRAWS, SEED = 1000, 1
# From this number of differences on, the largest one is left out.
MIN_TRIMMED = 3


def g_statistic(window: Array | Counts, simulated: Array | Counts) -> Array:
    """Return the G statistic of homogeneity of two sets of counts, both (..., c).

    It is twice the log-likelihood ratio of the hypotheses that both have their own shares, and
    that they have the same.
    """
    both = window + simulated
    totals = window.sum(axis=-1), simulated.sum(axis=-1), both.sum(axis=-1)
    of_cells = xlogy(window, window) + xlogy(simulated, simulated) - xlogy(both, both)
    of_window, of_simulated, of_both = (xlogy(total, total) for total in totals)
    return np.asarray(2 * (of_cells.sum(axis=-1) - of_window - of_simulated + of_both))


@dataclass(frozen=True, eq=False)
class BatchScatter:
    """The factor by which the variance of batches exceeds that of chance, with its uncertainty.

    factor : float
        Estimate; below 1 only by chance.
    reference : (DRAWS,) float
        Estimates from batches that scatter by chance only.
    batches : int
        Number of batches from which it is estimated.
    """

    factor: float
    reference: Array
    batches: int

    def inflation(self, parts: int, drops: int, ratio: float | Array = 1.0) -> Array:
        """Return the factor of the variance of the difference between parts and drops.

        The drops scatter by chance only. ``ratio`` is the estimate divided by the true factor,
        such as a draw of ``reference``; the true factor is at least 1.
        """
        excess = np.maximum(self.factor / np.asarray(ratio), 1.0) - 1
        return np.asarray(1 + drops / (drops + parts) * excess)


def batch_scatter(units: Counts) -> BatchScatter | None:
    """Return the scatter of successive batches; None if there are too few to estimate it.

    The statistic is the sum of Pearson's chi-square of the differences of successive batches, with
    the shares of all batches. The largest difference is left out, because the shares can change
    once.

    Parameters
    ----------
    units : (u, c) int
        Parts of each batch in each class, UNIT or more in each batch.
    """
    units = units[-MAX_UNITS:]
    units = units[:, units.any(axis=0)]
    freedom = units.shape[1] - 1
    if len(units) < 2 or freedom < 1:
        return None
    totals, sizes = units.sum(axis=0), units.sum(axis=1)
    squares = np.diff(units / sizes[:, None], axis=0) ** 2 @ (sizes.sum() / totals)
    found = sizes[1:] * sizes[:-1] / (sizes[1:] + sizes[:-1]) * squares
    chance = _sums_by_chance(len(units), freedom)
    factor = float(_trimmed_sum(found) / chance.mean())
    return BatchScatter(factor, chance / chance.mean(), len(units))


@lru_cache(100)
def _sums_by_chance(batches: int, freedom: int) -> Array:
    """Return draws, (DRAWS,), of the sum of the statistics of batches that scatter by chance."""
    generator = np.random.default_rng(SEED)
    drawn = np.zeros((DRAWS, batches - 1))
    for _ in range(freedom):
        drawn += np.diff(generator.standard_normal((DRAWS, batches)), axis=1) ** 2 / 2
    return _trimmed_sum(drawn)


def _trimmed_sum(statistics: Array) -> Array:
    """Return the sum over the last axis, without the largest one if there are some."""
    total = statistics.sum(axis=-1)
    if statistics.shape[-1] >= MIN_TRIMMED:
        total = total - statistics.max(axis=-1)
    return np.asarray(total)


def p_of_window(
    window: Counts,
    simulated: Counts,
    generator: np.random.Generator,
    level: float,
    scatter: BatchScatter | None = None,
) -> float:
    """Return the probability of a G statistic at least as large, without drift.

    It is at most ``level`` with a probability of ``level`` at most, for any number of parts and
    drops and any shares. Tables are drawn until EXCEEDANCES of them are as extreme, at most
    EXCEEDANCES / level tables (Besag, Clifford 1991, Biometrika 78:301), which needs few unless
    the p value is small.

    If batches scatter, the statistic of each table is multiplied by a factor that the scatter
    allows for: the estimate divided by a draw of its error. For a known factor this is the scaled
    chi-square test, and for an estimate with a chi-square distribution the F test of
    quasi-likelihood.

    Parameters
    ----------
    window, simulated : (c,) int
        Counts, at least one in each.
    """
    parts, drops = int(window.sum()), int(simulated.sum())
    columns = window + simulated
    # Tables with an equal statistic count in spite of rounding.
    found = float(g_statistic(window, simulated)) * (1 - 1e-9) - 1e-9
    tables = math.ceil(EXCEEDANCES / level)
    drawn = extreme = 0
    while drawn < tables and extreme < EXCEEDANCES:
        size = min(max(drawn, FIRST_TABLES), tables - drawn)
        table = generator.multivariate_hypergeometric(
            columns, parts, size=size, method='marginals'
        )
        g = g_statistic(table, columns - table)
        if scatter is not None:
            g = g * scatter.inflation(parts, drops, generator.choice(scatter.reference, size))
        extreme += int((g >= found).sum())
        drawn += size
    # The window counts as a table, too (Phipson, Smyth 2010).
    return (1 + extreme) / (1 + drawn)


# -- Comparison -----------------------------------------------------------------------------------


# The counts of drops that are in no aspect.
REST = ('unclassified', 'unsettled', 'failed')


@dataclass(frozen=True, eq=False)
class DropCounts:
    """Counts of drops by aspect and by failure, from any source; `Distribution` has them too.

    counts : (k,) int
        Drops in each aspect, by id from 1.
    """

    counts: npt.NDArray[np.int64]
    unclassified: int = 0
    unsettled: int = 0
    failed: int = 0

    @property
    def drops(self) -> int:
        """Number of drops that were counted."""
        return int(self.counts.sum()) + self.unclassified + self.unsettled + self.failed


@dataclass(frozen=True, eq=False)
class Comparison:
    """The shares of two distributions and the difference between them.

    first, second : (k,) float
        Share of each aspect in the drops that are in an aspect; the sum of each is 1.
    lower, upper : (k,) float
        Simultaneous bounds of the true difference first - second, with ``confidence``.
    p_value : float
        Probability of a difference at least as large, by Pearson's chi-square, if the true shares
        are the same.
    p_by : str
        Source of the p value: the chi-square distribution, or random tables.
    """

    first: Array
    second: Array
    lower: Array
    upper: Array
    confidence: float
    p_value: float
    p_by: Source

    @property
    def deviation(self) -> Array:
        """(k,) differences first - second."""
        return self.first - self.second

    @property
    def total_variation(self) -> float:
        """Half the sum of absolute deviations: the share of drops that end differently, 0 to 1."""
        return float(np.abs(self.deviation).sum() / 2)

    @property
    def mean_deviation(self) -> float:
        """Mean of the absolute deviations over the aspects, as the seed method reports it."""
        return float(np.abs(self.deviation).mean())

    @property
    def largest_aspect(self) -> int:
        """Id of the aspect with the largest absolute deviation; the lowest id of equal ones."""
        return int(np.abs(self.deviation).argmax()) + 1

    @property
    def largest_deviation(self) -> float:
        """Deviation of the aspect `largest_aspect`, with its sign."""
        return float(self.deviation[self.largest_aspect - 1])

    @property
    def largest_bounds(self) -> tuple[float, float]:
        """Lower and upper bound of `largest_deviation`.

        The bounds of all aspects hold together, so choosing the largest does not weaken them.
        """
        index = self.largest_aspect - 1
        return float(self.lower[index]), float(self.upper[index])


def compare(
    first: DropCounts | Distribution,
    second: DropCounts | Distribution,
    generator: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Comparison:
    """Return the comparison of two sets of drops, both with a sampling error.

    Raises InvalidValueError if the numbers of aspects differ, if one set has no drop in any
    aspect, or if a count or the confidence is invalid.
    """
    one, other = _counts('first', first), _counts('second', second)
    _check_aspect_count('the second distribution', len(other), len(one))
    a, b = one / one.sum(), other / other.sum()
    lower, upper = square_and_add(
        a,
        bounds(one, one.sum(), SIMULTANEOUS, confidence),
        b,
        bounds(other, other.sum(), SIMULTANEOUS, confidence),
    )
    p_value, p_by = p_of_two(one, other, generator)
    return Comparison(a, b, lower, upper, confidence, p_value, p_by)


def compare_with_exact(
    first: DropCounts | Distribution,
    probabilities: npt.ArrayLike,
    generator: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Comparison:
    """Return the comparison of drops with exact probabilities, such as those of an estimator.

    probabilities : (k,) float
        Their sum is 1, but for rounding. Raises InvalidValueError as `compare`.
    """
    one = _counts('first', first)
    exact = np.asarray(probabilities, dtype=np.float64)
    exact = exact / exact.sum()
    _check_aspect_count('the estimate', len(exact), len(one))
    lower, upper = bounds(one, one.sum(), SIMULTANEOUS, confidence)
    p_value, p_by = p_of_one(one, exact, generator)
    share = one / one.sum()
    return Comparison(share, exact, lower - exact, upper - exact, confidence, p_value, p_by)


def square_and_add(
    first: Array,
    first_bounds: tuple[Array, Array],
    second: Array,
    second_bounds: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Return the bounds of first - second, from the shares and the lower and upper bounds of each.

    This is method 10 of Newcombe 1998 (Statistics in Medicine 17:873), who uses Wilson's bounds.
    """
    difference = first - second
    below = np.hypot(first - first_bounds[0], second_bounds[1] - second)
    above = np.hypot(first_bounds[1] - first, second - second_bounds[0])
    return difference - below, difference + above


def _counts(name: str, given: DropCounts | Distribution) -> Counts:
    counts = np.asarray(given.counts, dtype=np.int64)
    if (counts < 0).any() or counts.sum() < 1:
        raise InvalidValueError(
            f'invalid counts {counts.tolist()} of the {name} distribution: expected 0 or more, '
            'not all 0'
        )
    return counts


def _check_aspect_count(name: str, count: int, expected: int) -> None:
    if count != expected:
        raise InvalidValueError(
            f'invalid number of aspects {count} of {name}: expected {expected}, as in the first'
        )
