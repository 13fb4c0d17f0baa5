"""Fit of conditions to measured shares: points, their weights, and what each case predicts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import expit

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.statistics.model_range import discrepancy
from validation.measured import deviance, log_odds

# Standard deviations of the discrepancy at a share of 1/2; all equally probable beforehand.
SCALES = np.linspace(0.02, 1.0, 50)


@dataclass(frozen=True, eq=False)
class Posterior:
    """How probable points and discrepancies are, given the measured shares of c cases.

    The log odds of a measured share are normal about those of the simulated share of a point. The
    variance is that of both samples, and the square of the discrepancy of the model.

    counts, rolls : (c,) int
        Measured.
    shares : (m, c) float
        Simulated at m points, which are equally probable beforehand.
    drops : int
        Of each simulated share.
    """

    counts: Counts
    rolls: Counts
    shares: Array
    drops: int

    @cached_property
    def simulated(self) -> Array:
        """(m, c) simulated log odds, finite also without a hit."""
        return log_odds(self._smoothed)

    @property
    def _smoothed(self) -> Array:
        return np.asarray((self.shares * self.drops + 0.5) / (self.drops + 1))

    @cached_property
    def noise(self) -> Array:
        """(m, c) variance of the simulated log odds by sampling."""
        p = self._smoothed
        return np.asarray(1 / (self.drops * p * (1 - p)))

    @cached_property
    def _terms(self) -> Array:
        """(s, m, c) log likelihood of each case, for each scale and point."""
        hits, misses = self.counts + 0.5, self.rolls - self.counts + 0.5
        measured, sampling = np.log(hits / misses), 1 / hits + 1 / misses
        unit = discrepancy(self._smoothed, 1.0)
        variance = sampling + self.noise + (SCALES[:, None, None] * unit) ** 2
        off = (measured - self.simulated) ** 2
        return np.asarray(-0.5 * (off / variance + np.log(variance)))

    def weights(self, without: int | None = None) -> Array:
        """Return the probability (s, m) of each scale and point, also without one of the cases."""
        kept = np.arange(len(self.counts)) != (-1 if without is None else without)
        terms = self._terms[:, :, kept].sum(axis=2)
        likelihood = np.exp(terms - terms.max())
        return np.asarray(likelihood / likelihood.sum())

    def scale(self, without: int | None = None) -> float:
        """Return the mean scale of the discrepancy."""
        return float(self.weights(without).sum(axis=1) @ SCALES)

    def range_of(self, case: int, quantile: float, without: int | None = None) -> Array:
        """Return the lower bound, the middle and the upper bound of the share of a case.

        ``quantile`` is that of the standard normal distribution.
        """
        of_points = self.weights(without).sum(axis=0)
        middle = float(of_points @ self.simulated[:, case])
        spread = of_points @ (self.simulated[:, case] - middle) ** 2
        between = max(0.0, float(spread - of_points @ self.noise[:, case]))
        error = float(discrepancy(expit(middle), self.scale(without)))
        half = quantile * np.hypot(error, np.sqrt(between))
        return np.asarray(expit([middle - half, middle, middle + half]))

    def draws(self, count: int) -> Counts:
        """Return indices of equally probable points, by systematic sampling in their order."""
        ends = np.cumsum(self.weights().sum(axis=0))
        return np.searchsorted(ends, (np.arange(count) + 0.5) / count)


def polynomial_deviance(x: Array, counts: Counts, rolls: Counts, degree: int) -> float:
    """Return the deviance of counts from the best polynomial of their log odds.

    Maximum likelihood by Newton's method (iteratively reweighted least squares).
    """
    design = np.vander((x - x.mean()) / np.ptp(x), degree + 1)
    p = (counts + 0.5) / (rolls + 1)
    for _ in range(50):
        weight = rolls * p * (1 - p)
        target = log_odds(p) + (counts - rolls * p) / weight
        root = np.sqrt(weight)
        found, *_ = np.linalg.lstsq(design * root[:, None], target * root, rcond=None)
        p = expit(design @ found).clip(1e-9, 1 - 1e-9)
    return float(deviance(counts, rolls, p).sum())
