"""Scatter of batches: how much more their shares differ than chance alone explains.

Parts of a batch lie more alike than parts of different batches: a lot is oily, a hopper is full.
The counts of a batch then have a variance that is larger than the multinomial one by a factor
(overdispersion; McCullagh, Nelder 1989, Generalized Linear Models, section 4.5). The factor is
estimated from successive batches, which a slow drift of the machine hardly tells apart.
"""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.statistics.intervals import Array, Counts

# Smaller batches are joined until they have this number of parts. With fewer, the variance of the
# statistic of a pair is not that of chi-square.
UNIT = 30
MAX_UNITS = 1000
# Draws of the estimate, from which its uncertainty follows.
DRAWS = 1000
SEED = 1
# From this number of differences on, the largest one is left out.
MIN_TRIMMED = 3


class Units:
    """Successive batches, the smaller ones joined; the newest of a long series are kept.

    counts : list of (c,) int
    """

    def __init__(self) -> None:
        self.counts: list[Counts] = []
        self._open: Counts | None = None

    def add(self, counts: Counts) -> None:
        """Add a batch."""
        self._open = counts if self._open is None else self._open + counts
        if int(self._open.sum()) >= UNIT:
            self.counts.append(self._open)
            self._open = None
            if len(self.counts) > MAX_UNITS:
                del self.counts[0]


@dataclass(frozen=True, eq=False)
class BatchScatter:
    """The factor by which the variance of batches exceeds that of chance, with its uncertainty.

    factor : float
        Estimate; below 1 only by chance.
    reference : (DRAWS,) float
        Estimates, ascending, from batches that scatter by chance only.
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

    units : (u, c) int
        Parts of each batch in each class, at least one in each batch.
    """
    units = units[:, units.any(axis=0)]
    freedom = units.shape[1] - 1
    if len(units) < 2 or freedom < 1:
        return None
    totals, sizes = units.sum(axis=0), units.sum(axis=1)
    number = int(totals.sum())
    shares = units / sizes[:, None]
    weights = sizes[1:] * sizes[:-1] / (sizes[1:] + sizes[:-1])
    squares = np.diff(shares, axis=0) ** 2 @ (number / totals)
    # Pearson's statistic with fixed margins has the mean freedom n / (n - 1).
    found = weights * squares * (number - 1) / number
    generator = np.random.default_rng(SEED)
    drawn = np.zeros((DRAWS, len(units) - 1))
    for _ in range(freedom):
        drawn += np.diff(generator.standard_normal((DRAWS, len(units))), axis=1) ** 2 / 2
    sums = np.sort(_sum(drawn))
    return BatchScatter(float(_sum(found) / sums.mean()), sums / sums.mean(), len(units))


def _sum(statistics: Array) -> Array:
    """Return the sum over the last axis, without the largest one if there are some."""
    total = statistics.sum(axis=-1)
    if statistics.shape[-1] >= MIN_TRIMMED:
        total = total - statistics.max(axis=-1)
    return np.asarray(total)
