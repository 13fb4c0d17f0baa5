"""P values of a two-sample G test, which are also valid for few parts.

Each window is compared with the simulated drops by a two-sample G test (log-likelihood ratio), so
that the sampling error of the simulation is taken into account. Its null distribution is
conditional: both margins of the table, which contains the window and the simulated drops, are
fixed, and random tables with these margins are drawn. So no class has to be pooled with another,
however rare it is.
"""

import math

import numpy as np
from scipy.special import xlogy

from resting_aspects_ros.core.statistics.batch_scatter import BatchScatter
from resting_aspects_ros.core.statistics.intervals import Array, Counts

# Tables are drawn until this number deviates at least as much as the window. The relative standard
# error of a p value near the level is then 10 %.
EXCEEDANCES = 100
FIRST_BATCH = 256


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


def p_of_window(
    window: Counts,
    simulated: Counts,
    generator: np.random.Generator,
    level: float,
    scatter: BatchScatter | None = None,
) -> float:
    """Return the probability of a G statistic at least as large, without drift.

    It is at most ``level`` with a probability of ``level``, for any number of parts and drops and
    any shares. For this, tables with exactly the same statistic as the window are counted at
    random (Dufour 2006, Journal of Econometrics 133:443); otherwise the probability would be
    lower if one part more or less changes the p value much. A window that is as likely as any is
    never an alarm: without a less extreme table the p value is 1.

    Tables are drawn until EXCEEDANCES of them are as extreme, at most EXCEEDANCES / level tables
    (Besag, Clifford 1991, Biometrika 78:301). This needs few tables unless the p value is small.
    The smallest p value is level / EXCEEDANCES.

    If batches scatter, the statistic of each table is multiplied by a factor that the scatter
    allows for: the estimate divided by a draw of its error. For a known factor this is the scaled
    chi-square test, and for an estimate with a chi-square distribution the F test of
    quasi-likelihood.

    window, simulated : (c,) int
        Counts, at least one in each.
    """
    columns = (window + simulated)[window + simulated > 0]
    if len(columns) == 1:
        return 1.0
    found = float(g_statistic(window, simulated))
    margin = 1e-9 * (1 + found)  # rounding
    tables = math.ceil(EXCEEDANCES / level)
    coin, size = generator.random(), FIRST_BATCH
    drawn = reached = lower = 0
    while drawn < tables - 1:
        size = min(2 * size, tables - 1 - drawn)
        table = generator.multivariate_hypergeometric(
            columns, int(window.sum()), size=size, method='marginals'
        )
        g = g_statistic(table, columns - table)
        if scatter is not None:
            ratio = generator.choice(scatter.reference, size)
            g = g * scatter.inflation(int(window.sum()), int(simulated.sum()), ratio)
        tied = (np.abs(g - found) <= margin) & (generator.random(size) < coin)
        extreme = np.flatnonzero((g > found + margin) | tied)
        lower += int((g < found - margin).sum())
        if reached + len(extreme) >= EXCEEDANCES:
            last = int(extreme[EXCEEDANCES - reached - 1])
            return EXCEEDANCES / (drawn + last + 1)
        reached += len(extreme)
        drawn += size
    return (1 + reached) / (1 + drawn) if lower else 1.0
