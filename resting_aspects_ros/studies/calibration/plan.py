"""Which part to drop by hand, and how often, to learn most about a surface.

The measure is the expected information gain: by how many bits the counts are expected to reduce
the uncertainty of the fitted conditions. One bit halves the range that is left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.config_files import parts_folder
from resting_aspects_ros.simulation.part_library import PartLibrary
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED, check_seed
from resting_aspects_ros.studies.calibration.calibrate import (
    check_number,
    drops_file,
    given_counts,
)
from resting_aspects_ros.studies.calibration.counts_file import SurfaceCounts, made_conditions
from resting_aspects_ros.studies.calibration.fit import conditions_at, fit_surface
from resting_aspects_ros.studies.calibration.likelihood import log_density, surrogate_rho
from resting_aspects_ros.studies.calibration.posterior import DISCREPANCIES, DISCREPANCY_SCALE
from resting_aspects_ros.studies.calibration.simulated_drops import SimulatedDrops
from resting_aspects_ros.studies.design import Factor, sobol
from resting_aspects_ros.studies.points import counts_by_class
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate

Array = npt.NDArray[np.float64]

# Half of what a calibration uses: the gain needs the shares only roughly.
DEFAULT_POINTS = 32
DEFAULT_DROPS = 125
# What is known of the release, if nothing is stated.
CONDITIONS = {'height': 0.06}
NUMBERS = (50, 100, 200, 400)
# Conditions that counts are drawn from, and conditions that are compared with them.
OUTER, INNER = 400, 1000


@dataclass(frozen=True, eq=False)
class Candidate:
    """A part that could be dropped by hand.

    gains, errors : (m,) float
        Expected information gain for each number of drops, bit, and its standard error.
    spread : (c,) float
        Standard deviation of the share of each class over the conditions.
    """

    name: str
    gains: Array
    errors: Array
    spread: Array


@dataclass(frozen=True, eq=False)
class CalibrationPlan:
    """Candidates in descending order of the gain of the largest number of drops."""

    factors: tuple[Factor, ...]
    numbers: tuple[int, ...]
    candidates: tuple[Candidate, ...]
    counted: int

    def document(self) -> dict[str, Any]:
        """Return the plan as plain values."""
        return {
            'schema_version': 1,
            'fitted': [factor.name for factor in self.factors],
            'drops': list(self.numbers),
            'counted_before': self.counted,
            'candidates': [
                {
                    'part': each.name,
                    'bits': each.gains.tolist(),
                    'standard_errors': each.errors.tolist(),
                    'spread_of_shares': each.spread.tolist(),
                }
                for each in self.candidates
            ],
        }

    def __str__(self) -> str:
        *most, last = (factor.label for factor in self.factors)
        names = f'{", ".join(most)} and {last}' if most else last
        lines = [
            f'Expected information about {names}, in bits, by number of drops by hand'
            + (f', beyond the {self.counted} that are counted:' if self.counted else ':'),
            '',
            f'{"part":<24}' + ''.join(f'{n:>8}' for n in self.numbers),
        ]
        lines += [
            f'{each.name[:23]:<24}' + ''.join(f'{g:>8.2f}' for g in each.gains)
            for each in self.candidates
        ]
        best = self.candidates[0]
        enough = int(np.argmax(best.gains >= 0.8 * best.gains[-1]))
        share = 100 * best.gains[enough] / max(best.gains[-1], 1e-9)
        advice = (
            f'Drop {best.name} {self.numbers[enough]} times: this gives {share:.0f} % of what '
            f'{self.numbers[-1]} drops tell.\nOne bit halves the range of possible conditions.'
        )
        return '\n'.join([*lines, '', advice])


def plan_calibration(
    parts: Sequence[Part | str | Path] = (),
    counts: str | Path | Mapping[str, Any] | None = None,
    *,
    conditions: Mapping[str, Any] | None = None,
    way: str = 'dropped',
    numbers: Sequence[int] = NUMBERS,
    points: int | None = None,
    drops: int = DEFAULT_DROPS,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    folder: str | Path | None = None,
    progress: bool = False,
) -> CalibrationPlan:
    """Find which part and how many drops by hand would tell most about a surface.

    Parameters
    ----------
    parts : sequence of Part, str or Path
        Candidates; the example parts by default.
    counts : str, Path or mapping, optional
        Counts that there are already, as for `calibrate`: what they tell is not counted again.
        They also state the conditions and the way of release.
    conditions, way
        As in a counts file, without ``counts``; the height is 60 mm by default.
    numbers : sequence of int
        Numbers of drops by hand, ascending.
    points, drops, seed, workers, folder, progress
        As for `calibrate`; 32 points and 125 drops of each part at each point by default.
    """
    loaded = [given_part(part) for part in parts] if parts else _examples()
    for number in numbers:
        check_number('numbers', number, 1, 10**6)
    given = None if counts is None else given_counts(counts)
    factors, base = (
        made_conditions(CONDITIONS if conditions is None else conditions, way)
        if given is None
        else (given.factors, given.base)
    )
    check_seed(seed)
    count = DEFAULT_POINTS if points is None else points
    check_number('points', count, 8, 4096)
    check_number('drops', drops, 1, 10**6)
    file = drops_file(folder)
    design = sobol(len(factors), count, seed)
    rng = np.random.default_rng((seed, 2))
    total = (len(loaded) + (len(given.parts) if given else 0)) * count * drops
    found = []
    with given_workers(workers) as pool, DropProgress('plan', total, shown=progress) as bar:
        simulated = SimulatedDrops(pool, seed, bar.update, file)
        places, weights = _state(given, simulated, len(factors), count, drops, seed)
        for part in loaded:
            aspects = find_aspects(part)
            by_aspect = simulated.counts(part, conditions_at(base, factors, design), drops)
            by_class = counts_by_class(aspects, by_aspect)
            if by_class.shape[1] < 2:
                continue
            surrogate = ShareSurrogate.fit(design, by_class, rng)
            found.append(_candidate(part.name, surrogate, places, weights, numbers, rng))
        bar.end(simulated.made)
    if not found:
        raise InvalidValueError('invalid parts: expected one with two or more classes of aspects')
    found.sort(key=lambda each: -each.gains[-1])
    return CalibrationPlan(factors, tuple(numbers), tuple(found), given.drops if given else 0)


def information_gain(
    shares: Array, rho: Array, drops: int, rng: np.random.Generator, outer: int = OUTER
) -> tuple[float, float]:
    """Return the expected information gain of counts, bit, and its standard error.

    ``shares`` (n, k) are those at n equally probable conditions, and ``rho`` (n,) are the
    intraclass correlations of the counts there.
    """
    chosen = rng.integers(len(shares), size=outer)
    total = 1 / np.maximum(rho[chosen], 1e-7) - 1
    gammas = rng.standard_gamma(np.maximum(shares[chosen] * total[:, None], 1e-6))
    drawn = gammas / np.maximum(gammas.sum(axis=1, keepdims=True), 1e-300)
    gains = np.empty(outer)
    for k, counts in enumerate(rng.multinomial(drops, drawn / drawn.sum(axis=1, keepdims=True))):
        logs = log_density(counts, shares, rho)
        gains[k] = logs[chosen[k]] - (logsumexp(logs) - np.log(len(logs)))
    gains /= np.log(2)
    return float(gains.mean()), float(gains.std() / np.sqrt(outer))


def _candidate(
    name: str,
    surrogate: ShareSurrogate,
    places: Array,
    weights: Array,
    numbers: Sequence[int],
    rng: np.random.Generator,
) -> Candidate:
    chosen = places[rng.choice(len(places), INNER, p=weights)]
    shares = surrogate.shares(chosen)
    # The discrepancy is not known before; its prior's root mean square is used.
    typical = min(DISCREPANCY_SCALE, float(DISCREPANCIES[-1])) ** 2
    rho = 1 - (1 - typical) * (1 - surrogate_rho(shares, surrogate.variances(chosen)))
    # The same random numbers for all numbers of drops: chance then hardly changes their order.
    seed = int(rng.integers(2**32))
    found = [information_gain(shares, rho, n, np.random.default_rng(seed)) for n in numbers]
    return Candidate(
        name,
        np.array([max(gain, 0.0) for gain, _ in found]),
        np.array([error for _, error in found]),
        shares.std(axis=0),
    )


def _state(
    given: SurfaceCounts | None,
    simulated: SimulatedDrops,
    factors: int,
    points: int,
    drops: int,
    seed: int,
) -> tuple[Array, Array]:
    """Return points of the unit cube and their probabilities before the new counts."""
    if given is None:
        places = sobol(factors, 4096, seed)
        return places, np.full(len(places), 1 / len(places))
    fit = fit_surface(given, simulated, points=points, per_point=drops, seed=seed, rounds=0)
    return fit.posterior.points, fit.posterior.weights().sum(axis=0)


def _examples() -> list[Part]:
    library = PartLibrary(parts_folder())
    return [library.load(name) for name in library.names()]
