"""What a fit says of each condition, and what the counts do not determine."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.statistics.intervals import containing
from resting_aspects_ros.studies.calibration.fit import Fit
from resting_aspects_ros.studies.design import Factor

Array = npt.NDArray[np.float64]

CONFIDENCE = 0.9
# A condition is not determined if its interval is longer than this share of the range.
WIDE = 0.5
BINS = 64


@dataclass(frozen=True, eq=False)
class Estimate:
    """A fitted condition.

    best : float
        Its value at the most probable conditions.
    mean, deviation : float
        Of the posterior.
    low, high : float
        The shortest interval with 90 % of the posterior, extended to ``best`` and ``mean``.
    determined : bool
        Whether the interval is at most half of the range.
    """

    factor: Factor
    best: float
    mean: float
    deviation: float
    low: float
    high: float
    determined: bool


def estimates(fit: Fit) -> list[Estimate]:
    """Return an estimate of each factor."""
    weights = fit.posterior.weights().sum(axis=0)
    best = best_point(fit)
    found = []
    for k, factor in enumerate(fit.given.factors):
        unit = fit.posterior.points[:, k]
        values = factor.values(unit)
        mean = float(weights @ values)
        start, end = shortest_interval(unit, weights)
        best_value = float(factor.values(best[k : k + 1])[0])
        low, high = factor.values(np.array([start, end]))
        for value in (best_value, mean):
            low, high = containing(value, low, high)
        found.append(
            Estimate(
                factor,
                best_value,
                mean,
                float(np.sqrt(weights @ (values - mean) ** 2)),
                float(low),
                float(high),
                end - start <= WIDE,
            )
        )
    return found


def best_point(fit: Fit) -> Array:
    """Return the most probable point (d,) of the unit cube.

    On a ridge many points are nearly as probable. Among those with at least 90 % of the highest
    density, it is the one nearest to their mean.
    """
    weights = fit.posterior.weights().sum(axis=0)
    high = np.flatnonzero(weights >= 0.9 * weights.max())
    points = fit.posterior.points[high]
    nearest = ((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin()
    return np.asarray(points[nearest])


def shortest_interval(values: Array, weights: Array) -> tuple[float, float]:
    """Return the shortest interval with CONFIDENCE of the weight."""
    order = np.argsort(values)
    ordered, sums = values[order], np.concatenate([[0], np.cumsum(weights[order])])
    ends = np.searchsorted(sums, sums[:-1] + CONFIDENCE * sums[-1] - 1e-12)
    starts = np.flatnonzero(ends <= len(values))
    lengths = ordered[ends[starts] - 1] - ordered[starts]
    first = starts[int(lengths.argmin())]
    return float(ordered[first]), float(ordered[ends[first] - 1])


def discrepancy(fit: Fit) -> tuple[float, float, float]:
    """Return mean, low and high of the discrepancy."""
    weights = fit.posterior.weights().sum(axis=1)
    values = fit.posterior.discrepancies
    sums = np.cumsum(weights)
    low, high = (values[min(int(np.searchsorted(sums, q)), len(values) - 1)] for q in (0.05, 0.95))
    mean = float(weights @ values)
    low, high = containing(mean, low, high)
    return mean, float(low), float(high)


def correlation(fit: Fit, one: int, other: int) -> float:
    """Return the correlation of two factors, on the scales of their ranges."""
    weights = fit.posterior.weights().sum(axis=0)
    points = fit.posterior.points[:, [one, other]]
    centred = points - weights @ points
    covariance = (weights[:, None] * centred).T @ centred
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))
