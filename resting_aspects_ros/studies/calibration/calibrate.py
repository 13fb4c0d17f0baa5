"""Calibrate a surface to counts, for the Python interface and the command line."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.runner import DropProgress, Progress, given_workers, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, StoppedError, analysis, shown
from resting_aspects_ros.simulation.job import DEFAULT_SEED, check_seed
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studies.calibration.checks import (
    GTest,
    Prediction,
    find_estimates,
    g_test,
    predict,
)
from resting_aspects_ros.studies.calibration.counts_file import (
    CountedPart,
    SurfaceCounts,
    make_surface_counts,
    read_surface_counts,
)
from resting_aspects_ros.studies.calibration.posterior import (
    EFFECTIVE,
    MAX_ROUNDS,
    Fit,
    fit_surface,
)
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studies.points import drop_points

DEFAULT_POINTS = 64
# In more than two dimensions, the same number of points is too sparse for a first round.
POINTS_PER_FACTOR = 16
MIN_POINTS, MAX_POINTS = 8, 1024
# Simulated drops of a part at each point for each counted one, so that they add at most a quarter
# to the variance of the counted shares; within bounds.
PER_COUNTED, MIN_DROPS, MAX_DROPS = 4, 100, 1000


def calibrate(
    counts: str | Path | Mapping[str, Any],
    *,
    points: int | None = None,
    drops: int | None = None,
    rounds: int = MAX_ROUNDS,
    discrepancy: bool = True,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> CalibrationResult:
    """Find the restitution and the friction of a surface from parts that were counted on it.

    Parts are dropped in the simulation at points that fill the ranges of the conditions, and then
    where the counts are probable, until there are enough such points.

    Parameters
    ----------
    counts : str, Path or mapping
        A counts file, or its content; see docs/reference/files.md. Paths of meshes in a mapping
        are relative to the current folder.
    points : int, optional
        Number of points of the first round, and twice that of each further one; 64 for one or two
        conditions, and 16 more for each further condition.
    drops : int, optional
        Number of drops of each part at each point; 4 for each counted one, but at least 100 and at
        most 1000.
    rounds : int
        Maximum number of times that points are added where the posterior lies.
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
    >>> result = ra.calibrate(counts, points=8, drops=25, rounds=0)
    >>> [each.factor.name for each in result.estimates]
    ['restitution', 'friction']
    """
    given = given_counts(counts)
    check_seed(seed)
    further = max(0, len(given.factors) - 2)
    count = DEFAULT_POINTS + POINTS_PER_FACTOR * further if points is None else points
    _check_number('points', count, MIN_POINTS, MAX_POINTS)
    _check_number('rounds', rounds, 0, 100)
    if drops is not None:
        _check_number('drops', drops, 1, 1_000_000)
    per_point = [drops or drops_per_point(part) for part in given.parts]
    with (
        given_workers(workers) as pool,
        DropProgress(given.surface, sum(per_point) * count, shown=progress) as bar,
    ):
        simulate = Simulation(given, per_point, seed, pool, bar.update, stopped)

        def expect(fit: Fit) -> None:
            # The number of effective points grows about as that of all points.
            needed = len(fit.points) * EFFECTIVE / fit.effective
            bar.expect(round(sum(per_point) * min(needed, count * (1 + rounds / 2))))

        fit = fit_surface(
            given,
            simulate,
            points=count,
            seed=seed,
            discrepancy=discrepancy,
            rounds=rounds,
            note=expect,
        )
        if fit is None:
            raise StoppedError('interrupted in the first round of drops: there is no result')
        bar.end(simulate.made)
    return summarise(fit, seed)


def summarise(fit: Fit, seed: int) -> CalibrationResult:
    """Return the result of a fit, with its checks."""
    rng = np.random.default_rng((seed, 1))
    estimates, predicted = tuple(find_estimates(fit, rng)), tuple(predict(fit, rng))
    left_out: tuple[Prediction, ...] = ()
    tested = GTest(math.nan, math.nan)
    with analysis('the check without each of the parts'):
        left_out = tuple(predict(fit, rng, left_out=True))
    with analysis('the G test'):
        tested = g_test(fit, rng)
    return CalibrationResult(fit, estimates, predicted, left_out, tested, seed)


def given_counts(counts: str | Path | Mapping[str, Any]) -> SurfaceCounts:
    """Return the counts of a file or a mapping."""
    if isinstance(counts, Mapping):
        return make_surface_counts(counts, Path())
    return read_surface_counts(Path(counts))


def drops_per_point(part: CountedPart) -> int:
    """Return the number of simulated drops of a part at each point, if none is given."""
    return min(max(PER_COUNTED * part.drops, MIN_DROPS), MAX_DROPS)


def _check_number(name: str, value: Any, low: int, high: int) -> None:
    if type(value) is not int or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )


class Simulation:
    """Drops the counted parts at points; the drops of a point do not depend on the others.

    Parameters
    ----------
    per_point : sequence of int
        Number of drops of each part at each point.
    progress : callable
        Called with the number of all drops made so far.
    """

    def __init__(
        self,
        given: SurfaceCounts,
        per_point: Sequence[int],
        seed: int,
        workers: Workers,
        progress: Callable[[int], None] = lambda _: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._given, self._per_point, self._seed = given, per_point, seed
        self._workers, self._progress, self._stopped = workers, progress, stopped
        self._landscapes = [Landscape(each.part) for each in given.parts]
        self.made = 0

    def __call__(self, points: Array) -> list[Counts] | None:
        """Return the counts (m, g) of each part at points (m, d); None if it was stopped.

        Drops that ended in no aspect are left out. Raises InvalidValueError if a part cannot be
        dropped at one of the points.
        """
        counts = []
        for k, part in enumerate(self._given.parts):
            found = drop_points(
                part.part,
                self._given.conditions(points, part),
                self._per_point[k],
                self._seed,
                workers=self._workers,
                progress=lambda done: self._progress(self.made + done),
                stopped=self._stopped,
                landscape=self._landscapes[k],
            )
            if found.skipped:
                raise InvalidValueError(
                    f'{part.name}: {next(iter(found.skipped.values()))}; expected ranges in which '
                    'all parts can be dropped'
                )
            self.made += int(found.drops.sum())
            counts.append(part.grouped(found.counts))
        return None if self._stopped() else counts
