"""Shares that were counted at samples of uncertain conditions, and the parts of their variance."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2, norm

from resting_aspects_ros.core.statistics.intervals import Interval, containing, intervals

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

# The chi-square test needs about this many expected drops in each cell; rarer outcomes are pooled.
EXPECTED = 5
# An effect of the conditions is shown if the p value of the test is less.
SIGNIFICANCE = 0.05


@dataclass(frozen=True, eq=False)
class SampledShares:
    """Counts of k outcomes at s samples of the conditions, each with the same number of drops.

    counts : (s, k) int
        Drops in each outcome; the other drops are in none of them.
    drops : int
        Number of drops at each sample, at least 2.
    """

    counts: Counts
    drops: int
    confidence: float

    @property
    def all_drops(self) -> int:
        """Number of drops of all samples."""
        return len(self.counts) * self.drops

    @property
    def means(self) -> Array:
        """(k,) mean share of each outcome."""
        return np.asarray(self.counts.sum(axis=0) / max(self.all_drops, 1))

    @property
    def sampling_variance(self) -> Array:
        """(k,) variance of the mean share by the number of drops, p (1 - p) / n."""
        return np.asarray(self.means * (1 - self.means) / max(self.all_drops, 1))

    @property
    def between(self) -> Array:
        """(k,) variance of the probability between the samples; see `between_limit`.

        The variance of the shares is that of the probabilities and the mean variance of the
        sampling at a sample, p (1 - p) / m; negative differences are 0. NaN for less than two
        samples.
        """
        if len(self.counts) < 2:
            return np.full(self.counts.shape[1], np.nan)
        return np.asarray(np.maximum(self._variance - self._within, 0))

    @property
    def between_limit(self) -> Array:
        """(k,) upper limits of `between` that hold simultaneously, each with 1 - 0.05 / k.

        (s - 1) times the variance of the shares, divided by that of the probabilities and of the
        sampling together, has a chi-square distribution with s - 1 degrees of freedom.
        """
        freedom = len(self.counts) - 1
        quantile = chi2.ppf(SIGNIFICANCE / self.counts.shape[1], freedom)
        return np.asarray(np.maximum(freedom * self._variance / quantile - self._within, 0))

    @property
    def _variance(self) -> Array:
        """(k,) variance of the shares of the samples."""
        return np.asarray((self.counts / self.drops).var(axis=0, ddof=1))

    @property
    def _within(self) -> Array:
        """(k,) mean variance of the sampling at a sample, unbiased."""
        shares = self.counts / self.drops
        return np.asarray((shares * (1 - shares)).mean(axis=0) / (self.drops - 1))

    @property
    def surface_variance(self) -> Array:
        """(k,) variance by the unknown conditions, also of the mean over the samples."""
        return np.asarray(self.between * (1 + 1 / max(len(self.counts), 1)))

    @property
    def part_of_surface(self) -> Array:
        """(k,) part of the variance that the unknown conditions cause, 0 to 1."""
        both = self.surface_variance + self.sampling_variance
        return np.asarray(np.where(both > 0, self.surface_variance / np.maximum(both, 1e-300), 0))

    def sampling(self) -> list[Interval]:
        """Return the mean shares, with Wilson's intervals for all drops."""
        return intervals(self.counts.sum(axis=0), self.all_drops, confidence=self.confidence)

    def total(self) -> list[Interval]:
        """Return the intervals that also contain what is not known of the conditions.

        Wilson's interval for as many drops as have the variance of sampling and conditions
        together. It is the sampling interval if the conditions have no effect.
        """
        n, p = float(max(self.all_drops, 1)), self.means
        sampling = self.sampling_variance
        variance = sampling + np.where(sampling > 0, self.surface_variance, 0)
        known = variance > 0
        size = np.where(known, p * (1 - p) / np.where(known, variance, 1), n)
        z2 = norm.ppf((1 + self.confidence) / 2) ** 2
        middle = (p + z2 / (2 * size)) / (1 + z2 / size)
        half = np.sqrt(z2 * (p * (1 - p) / size + z2 / (4 * size**2))) / (1 + z2 / size)
        low, high = containing(p, np.maximum(middle - half, 0), np.minimum(middle + half, 1))
        rows = zip(p.tolist(), low.tolist(), high.tolist(), strict=True)
        return [Interval(*row) for row in rows]

    @cached_property
    def p_value(self) -> float:
        """Of the chi-square test that all samples have the same shares; 1 without two outcomes."""
        rest = self.drops - self.counts.sum(axis=1)
        table = np.column_stack([self.counts, rest])
        common = table.sum(axis=0) >= EXPECTED * len(table)
        table = np.column_stack([table[:, common], table[:, ~common].sum(axis=1)])
        table = table[:, table.sum(axis=0) > 0]
        if table.shape[1] > 1 and table[:, -1].sum() < EXPECTED * len(table):
            # The pooled outcomes are rare together: they are counted with the rarest other one.
            rarest = int(table[:, :-1].sum(axis=0).argmin())
            table[:, rarest] += table[:, -1]
            table = table[:, :-1]
        if min(table.shape) < 2:
            return 1.0
        expected = table.sum(axis=0) / len(table)
        statistic = float(((table - expected) ** 2 / expected).sum())
        return float(chi2.sf(statistic, (len(table) - 1) * (table.shape[1] - 1)))
