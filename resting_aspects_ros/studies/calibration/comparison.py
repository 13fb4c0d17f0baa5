"""Comparison of two surfaces: whether the counts of both can be of the same one."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp, xlogy
from scipy.stats import chi2

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics.g_test import g_statistic
from resting_aspects_ros.studies.calibration.counted_part import CountedPart
from resting_aspects_ros.studies.calibration.fit import Fit

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SurfaceComparison:
    """Whether the counts of two files can be of the same surface.

    overlap : float
        Common weight of the two posteriors: 1 if they are equal, 0 if no conditions fit both.
    log_ratio : float
        Logarithm of the ratio of the probabilities of all counts: two surfaces over one.
    same_parts : bool
        Whether both files have the same parts, with the same groups and release. Then the
        simulation deviates from both in the same way, so that only sampling is taken into account.
    same_parts_p : float or None
        P value of a two-sample G test of the parts that both files have (chi-squared
        distribution); None without such a part. It needs no simulation.
    """

    one: str
    other: str
    overlap: float
    log_ratio: float
    same_parts: bool
    same_parts_p: float | None


def compare_surfaces(one: Fit, other: Fit) -> SurfaceComparison:
    """Compare two surfaces whose factors have the same ranges; raises InvalidValueError."""
    names = one.given.surface, other.given.surface
    if one.given.factors != other.given.factors:
        raise InvalidValueError(
            f'{names[0]} and {names[1]} cannot be compared: expected the same ranges'
        )
    if len(one.posterior.points) != len(other.posterior.points):
        raise InvalidValueError(
            f'{names[0]} and {names[1]} cannot be compared: one has far more counts'
        )
    pairs = list(_same_parts(one, other))
    same = len(pairs) == len(one.given.parts) == len(other.given.parts)
    a, b = (_log_likelihood(fit, sampling=same) for fit in (one, other))
    weights = [np.exp(each - logsumexp(each)) for each in (a, b)]
    return SurfaceComparison(
        *names,
        float(np.minimum(*weights).sum()),
        _log_mean(a) + _log_mean(b) - _log_mean(a + b),
        same,
        _p_value(pairs),
    )


def _log_likelihood(fit: Fit, *, sampling: bool) -> Array:
    """Return the log likelihood (n,) of the counts; ``sampling``: of nothing but sampling."""
    posterior = fit.posterior
    if not sampling:
        return posterior.density
    rows = [
        xlogy(part.counts, shares).sum(axis=1)
        for part, shares in zip(fit.given.parts, posterior.shares, strict=True)
    ]
    return np.asarray(np.sum(rows, axis=0))


def _log_mean(values: Array) -> float:
    return float(logsumexp(values) - np.log(len(values)))


def _same_parts(one: Fit, other: Fit) -> Iterator[tuple[CountedPart, CountedPart]]:
    """Yield the parts that both have, with the same groups and release."""
    if one.given.base != other.given.base:
        return
    theirs = {part.part.part_sha256: part for part in other.given.parts}
    for part in one.given.parts:
        match = theirs.get(part.part.part_sha256)
        if match is not None and match.groups == part.groups and match.values == part.values:
            yield part, match


def _p_value(pairs: list[tuple[CountedPart, CountedPart]]) -> float | None:
    statistic = sum(float(g_statistic(a.counts, b.counts)) for a, b in pairs)
    freedom = sum(int((a.counts + b.counts > 0).sum()) - 1 for a, b in pairs)
    return float(chi2.sf(statistic, freedom)) if freedom else None
