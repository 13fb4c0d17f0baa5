"""Two-sample G test of a window of parts against simulated drops, for batches that scatter.

The null distribution of the G statistic (log-likelihood ratio) is conditional: tables with both
margins of the window and the drops are drawn at random. So it holds for few parts, the sampling
error of the simulation is taken into account, and no class has to be pooled with another.

Parts of a batch lie more alike than parts of different batches: a lot is oily, a hopper is full.
Their counts then have a larger variance than the multinomial one, by a factor (overdispersion;
McCullagh, Nelder 1989, Generalized Linear Models, section 4.5). It is estimated from successive
batches, which a slow drift of the machine hardly tells apart.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import xlogy

from resting_aspects_ros.arrays import Array, Counts

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
