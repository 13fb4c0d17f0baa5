"""The calibration: drops over the ranges, surrogates, posterior, and new drops where it lies."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.studies.calibration.counted_part import CountedPart
from resting_aspects_ros.studies.calibration.counts_file import SurfaceCounts
from resting_aspects_ros.studies.calibration.dependence import find_dependence
from resting_aspects_ros.studies.calibration.posterior import Posterior, find_posterior
from resting_aspects_ros.studies.calibration.simulated_drops import SimulatedDrops
from resting_aspects_ros.studies.design import Factor, point_values, sobol
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate, added_counts
from resting_aspects_ros.studies.surrogate_form import likely_scales

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

# New drops are made until the standard deviation of the surrogate's shares is at most this share
# of that of the counted shares, which is from sampling and discrepancy.
MAX_ERROR = 0.5
NEW_POINTS = 8
MAX_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Fit:
    """Surrogates of the parts, and the posterior.

    points : (m, d) float
        Of the unit cube, where drops were made.
    simulated : tuple of (m, g) int
        Counts of the simulated drops of each part at the points.
    rounds : int
        How often drops were added.
    errors : (p,) float
        Standard deviation of the surrogate of each part as a share of that of its counts.
    """

    given: SurfaceCounts
    points: Array
    simulated: tuple[Counts, ...]
    surrogates: tuple[ShareSurrogate, ...]
    posterior: Posterior
    discrepancy: bool
    rounds: int
    errors: Array

    @property
    def simulated_drops(self) -> int:
        """Number of simulated drops that the surrogates were fitted to."""
        return int(sum(each.sum() for each in self.simulated))


def fit_surface(
    given: SurfaceCounts,
    drops: SimulatedDrops,
    *,
    points: int,
    per_point: int,
    seed: int,
    discrepancy: bool = True,
    rounds: int = MAX_ROUNDS,
    note: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Return the fit of counts.

    Parameters
    ----------
    points, per_point : int
        Number of points of the first design, and of drops of each part at each point.
    discrepancy : bool
        False if the counts are known to be of the simulation itself.
    rounds : int
        Maximum number of times that drops are added.
    note : callable
        Called with a line about each round.
    """
    design = sobol(len(given.factors), points, seed)
    simulated = [_simulate(part, given, design, drops, per_point) for part in given.parts]
    found = _fit(given, design, simulated, seed, discrepancy)
    for number in range(1, rounds + 1):
        if found.errors.max() <= MAX_ERROR:
            break
        note(
            f'round {number}: the error of the model of the shares is '
            f'{found.errors.max():.2f} of that of the counts: {NEW_POINTS} more points'
        )
        rng = np.random.default_rng((seed, number))
        weights = found.posterior.weights().sum(axis=0)
        # The least weight is that of no point, so that there are always enough different ones.
        weights = weights + 1e-12
        chosen = rng.choice(len(weights), NEW_POINTS, replace=False, p=weights / weights.sum())
        new = found.posterior.points[chosen]
        design = np.concatenate([design, new])
        simulated = [
            np.concatenate([old, _simulate(part, given, new, drops, per_point)])
            for part, old in zip(given.parts, simulated, strict=True)
        ]
        found = _fit(given, design, simulated, seed, discrepancy)
        found = dataclasses.replace(found, rounds=number)
    return found


def _fit(
    given: SurfaceCounts,
    points: Array,
    simulated: Sequence[Counts],
    seed: int,
    discrepancy: bool,
) -> Fit:
    surrogates = fit_shares(points, simulated, seed)
    return fit_counts(
        given,
        points,
        simulated,
        surrogates,
        discrepancy=discrepancy,
        dependence=find_dependence(surrogates, points, simulated, seed),
    )


def fit_shares(
    points: Array, simulated: Sequence[Counts], seed: int
) -> tuple[ShareSurrogate, ...]:
    """Return a surrogate of the shares of each part."""
    rng = np.random.default_rng(seed)
    # The conditions act on all parts in similar ways, so that their scales are the same.
    scales = likely_scales(points, [added_counts(each) for each in simulated])
    return tuple(ShareSurrogate.fit(points, each, rng, scales) for each in simulated)


def fit_counts(
    given: SurfaceCounts,
    points: Array,
    simulated: Sequence[Counts],
    surrogates: Sequence[ShareSurrogate],
    *,
    discrepancy: bool = True,
    dependence: float = 1.0,
) -> Fit:
    """Return the fit of counts with the simulated drops that there are."""
    posterior = find_posterior(
        len(given.factors),
        surrogates,
        [part.counts for part in given.parts],
        discrepancy=discrepancy,
        dependence=dependence,
    )
    errors = np.array([_error(posterior, k, part) for k, part in enumerate(given.parts)])
    return Fit(
        given, points, tuple(simulated), tuple(surrogates), posterior, discrepancy, 0, errors
    )


def conditions_at(
    base: DropConditions, factors: Sequence[Factor], points: Array, part: CountedPart | None = None
) -> list[DropConditions]:
    """Return the conditions of a part at points of the unit cube."""
    values = {} if part is None else part.values
    return [base.changed(**{**row, **values}) for row in point_values(factors, points)]


def _simulate(
    part: CountedPart, given: SurfaceCounts, points: Array, drops: SimulatedDrops, per_point: int
) -> Counts:
    conditions = conditions_at(given.base, given.factors, points, part)
    return part.grouped(drops.counts(part.part, conditions, per_point))


def _error(posterior: Posterior, k: int, part: CountedPart) -> float:
    """Return the standard deviation of the surrogate, relative to that of the counts."""
    weights = posterior.weights()
    shares, variances = posterior.shares[k], posterior.variances[k]
    of_points = weights.sum(axis=0)
    rho = float(weights.sum(axis=1) @ posterior.own @ posterior.discrepancies**2)
    of_counts = (shares * (1 - shares)).sum(axis=1) * (1 / part.drops + rho)
    ratio = float((of_points @ variances.sum(axis=1)) / (of_points @ of_counts))
    return float(np.sqrt(ratio))
