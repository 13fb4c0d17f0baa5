"""Calibrate a surface to counts, for the Python interface and the command line."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.runner import DropProgress, Progress, given_workers, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, StoppedError, shown
from resting_aspects_ros.simulation.conditions import DEFAULT_SEED, check_seed
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studies.calibration.counts_file import (
    SurfaceCounts,
    make_surface_counts,
    read_surface_counts,
)
from resting_aspects_ros.studies.calibration.posterior import (
    REPEATED,
    ROUNDS,
    Fit,
    find_estimates,
    find_fit_test,
    fit_surface,
    predict,
)
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.points import Simulation as PartSimulation
from resting_aspects_ros.studies.points import Task, point_seed, reasons, run_tasks

# Points of the first round for each fitted condition, and bounds of their number.
POINTS_PER_FACTOR, MIN_POINTS, MAX_POINTS = 32, 8, 1024
# Simulated drops of a part at each point: as many as were counted, within bounds. All points
# together determine the shares, so that they add little to the variance of the counts.
MIN_DROPS, MAX_DROPS = 100, 300


def calibrate(
    counts: str | Path | Mapping[str, Any],
    *,
    points: int | None = None,
    drops: int | None = None,
    discrepancy: bool = True,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> CalibrationResult:
    """Find the restitution and the friction of a surface from parts that were counted on it.

    Parts are dropped in the simulation at points that fill the ranges of the conditions, then
    where the counts are probable, and at last at the most probable conditions, as a check.

    Parameters
    ----------
    counts : str, Path or mapping
        A counts file, or its content; see docs/reference/files.md. Paths of meshes in a mapping
        are relative to the current folder.
    points : int, optional
        Number of points of the first round, and twice that of each of two further ones; 32 for
        each fitted condition.
    drops : int, optional
        Number of drops of each part at each point; as many as were counted, but 100 to 300.
    discrepancy : bool
        Whether real parts may deviate from the simulation beyond sampling. False only for counts
        that were simulated.
    seed : int
        Of the drops, and of all random numbers.
    workers : int or Workers, optional
        Number of workers, one for each core by default; or workers to use.
    progress : bool or callable
        As for `drop`.
    stopped : callable
        Ends early if it returns True: the result is that of the rounds that are complete.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    InvalidValueError
        The counts name unknown aspects or do not add up, or a value is out of bounds.
    PartError, UnknownPartError
        A part cannot be used.
    EngineError
        Workers died repeatedly.
    StoppedError
        It was stopped before the first round was complete.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> counts = {
    ...     'surface': 'oak_table',
    ...     'conditions': {'height': '100 mm'},
    ...     'parts': [{'box': [20, 20, 15], 'counts': {'z': 109, 'rest': 91}}],
    ... }
    >>> result = ra.calibrate(counts, points=8, drops=25)
    >>> [each.factor.name for each in result.estimates]
    ['restitution', 'friction']
    """
    check_seed(seed)
    if points is not None:
        _check_number('points', points, MIN_POINTS, MAX_POINTS)
    if drops is not None:
        _check_number('drops', drops, 1, 1_000_000)
    given = given_counts(counts)
    count = points or POINTS_PER_FACTOR * len(given.factors)
    per_point = [drops or min(max(each.drops, MIN_DROPS), MAX_DROPS) for each in given.parts]
    total = sum(per_point) * (count + ROUNDS * (count // 2) + REPEATED)
    with (
        given_workers(workers) as pool,
        DropProgress(given.surface, total, shown=progress) as bar,
    ):
        simulate = Simulation(given, per_point, seed, pool, bar.update, stopped)
        fit = fit_surface(given, simulate, points=count, seed=seed, discrepancy=discrepancy)
        if fit is None:
            raise StoppedError('interrupted in the first round of drops: there is no result')
        bar.end(simulate.made)
    return summarise(fit, seed)


def summarise(fit: Fit, seed: int) -> CalibrationResult:
    """Return the result of a fit, with its checks."""
    rng = np.random.default_rng((seed, 1))
    return CalibrationResult(
        fit,
        tuple(find_estimates(fit)),
        tuple(predict(fit, rng)),
        tuple(predict(fit, rng, left_out=True)),
        find_fit_test(fit, rng),
        seed,
    )


def given_counts(counts: str | Path | Mapping[str, Any]) -> SurfaceCounts:
    """Return the counts of a file or a mapping."""
    if isinstance(counts, Mapping):
        return make_surface_counts(counts, Path())
    return read_surface_counts(Path(counts))


def _check_number(name: str, value: Any, low: int, high: int) -> None:
    if type(value) is not int or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )


@dataclass(eq=False)
class Simulation:
    """Drops the counted parts at points; the drops of a point do not depend on the others.

    per_point : sequence of int
        Number of drops of each part at each point.
    progress : callable
        Called with the number of all drops made so far.
    """

    given: SurfaceCounts
    per_point: Sequence[int]
    seed: int
    workers: Workers
    progress: Callable[[int], None] = lambda _: None
    stopped: Callable[[], bool] = never
    made: int = 0

    def __post_init__(self) -> None:
        self._parts = [
            PartSimulation(each.part, self.workers, Landscape(each.part), each.aspects)
            for each in self.given.parts
        ]

    def __call__(self, points: Array) -> list[Counts] | None:
        """Return the counts (m, g) of each part at points (m, d); None if it was stopped.

        Drops that ended in no aspect are left out. Raises InvalidValueError if a part cannot be
        dropped at one of the points.
        """
        tasks = [task for k in range(len(self._parts)) for task in self._tasks(k, points)]
        found = run_tasks(
            tasks, self.workers, lambda done: self.progress(self.made + done), self.stopped
        )
        for index, reason in reasons(found).items():
            name = self.given.parts[index // len(points)].name
            raise InvalidValueError(
                f'{name}: {reason}; expected ranges in which all parts can be dropped'
            )
        if self.stopped():
            return None
        counts = []
        for k, part in enumerate(self.given.parts):
            own = np.array(found[k * len(points) : (k + 1) * len(points)])
            self.made += int(own.sum())
            counts.append(part.grouped(own))
        return counts

    def _tasks(self, k: int, points: Array) -> Iterator[Task]:
        """Yield the tasks of a part; those of equal points have other random numbers."""
        part, simulation = self.given.parts[k], self._parts[k]
        seen: Counter[bytes] = Counter()
        for point, conditions in zip(points, self.given.conditions(points, part), strict=True):
            before, setting = seen[point.tobytes()], Setting(conditions)
            seen[point.tobytes()] += 1
            purpose = f'repetition {before}' if before else ''
            seed = point_seed(self.seed, part.part, setting, purpose)
            yield partial(simulation.dropped, setting, self.per_point[k], seed)
