"""Calibrate a surface to counts, for the Python interface and the command line."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.output_files import make_folder
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.core.errors import InvalidValueError, analysis, shown
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED, check_seed
from resting_aspects_ros.studies.calibration.checks import (
    GTest,
    Prediction,
    g_test,
    leave_one_out,
    predict,
)
from resting_aspects_ros.studies.calibration.counts_file import (
    SurfaceCounts,
    make_surface_counts,
    read_surface_counts,
)
from resting_aspects_ros.studies.calibration.fit import MAX_ROUNDS, Fit, fit_surface
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studies.calibration.simulated_drops import SimulatedDrops
from resting_aspects_ros.studies.calibration.summary import estimates

DEFAULT_POINTS = 64
# In each dimension above two, the model of the shares has more coefficients.
POINTS_PER_FACTOR = 16
DEFAULT_DROPS = 250
MIN_POINTS, MAX_POINTS = 8, 4096
MAX_DROPS = 1_000_000
DROPS_FILE = 'drops.json'


def calibrate(
    counts: str | Path | Mapping[str, Any],
    *,
    points: int | None = None,
    drops: int = DEFAULT_DROPS,
    rounds: int = MAX_ROUNDS,
    discrepancy: bool = True,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    folder: str | Path | None = None,
    progress: bool = False,
    note: Callable[[str], None] = lambda _: None,
) -> CalibrationResult:
    """Find the restitution and the friction of a surface from parts that were counted on it.

    Parts are dropped in the simulation at points that fill the ranges of the conditions. A smooth
    model of the shares is fitted to these drops, and gives the probability of the counts under
    any conditions in the ranges. Where these are probable, more drops are made.

    Parameters
    ----------
    counts : str, Path or mapping
        A counts file, or its content; see docs/reference/files.md. Paths of meshes in a mapping
        are relative to the current folder.
    points : int, optional
        Number of points of the first design; 64 for one or two conditions, and 16 more for each
        further one.
    drops : int
        Number of drops of each part at each point.
    rounds : int
        Maximum number of times that drops are added where the posterior lies.
    discrepancy : bool
        Whether real parts may deviate from the simulation beyond sampling. False only for counts
        that were simulated.
    seed : int
        Of the drops, and of all random numbers.
    workers : int or Workers, optional
        Number of workers, one for each core by default; or workers to use.
    folder : str or Path, optional
        Counts of the drops are saved in the file drops.json there, and not repeated.
    progress : bool
        Show progress on standard error.
    note : callable
        Called with a line about each round of drops.

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
        Worker processes of Bullet died repeatedly.

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
    count = default_points(len(given.factors)) if points is None else points
    check_number('points', count, MIN_POINTS, MAX_POINTS)
    check_number('drops', drops, 1, MAX_DROPS)
    check_number('rounds', rounds, 0, 100)
    file = drops_file(folder)
    total = len(given.parts) * count * drops
    with given_workers(workers) as pool, DropProgress(given.surface, total, shown=progress) as bar:
        simulated = SimulatedDrops(pool, seed, bar.update, file)
        fit = fit_surface(
            given,
            simulated,
            points=count,
            per_point=drops,
            seed=seed,
            discrepancy=discrepancy,
            rounds=rounds,
            note=note,
        )
        bar.end(simulated.made)
    return summarise(fit, seed)


def summarise(fit: Fit, seed: int) -> CalibrationResult:
    """Return the result of a fit, with its checks."""
    rng = np.random.default_rng((seed, 1))
    predicted = tuple(predict(fit, rng))
    left_out: tuple[Prediction, ...] = ()
    tested = GTest(math.nan, math.nan)
    with analysis('the check without each of the parts'):
        left_out = tuple(leave_one_out(fit, rng))
    with analysis('the G test'):
        tested = g_test(fit, rng)
    return CalibrationResult(fit, tuple(estimates(fit)), predicted, left_out, tested, seed)


def given_counts(counts: str | Path | Mapping[str, Any]) -> SurfaceCounts:
    """Return the counts of a file or a mapping."""
    if isinstance(counts, Mapping):
        return make_surface_counts(counts, Path())
    return read_surface_counts(Path(counts))


def drops_file(folder: str | Path | None) -> Path | None:
    """Return the file in which drops are saved, in a folder that is made; None without one."""
    if folder is None:
        return None
    make_folder('folder', Path(folder))
    return Path(folder) / DROPS_FILE


def default_points(factors: int) -> int:
    """Return the number of points of the first design for this number of fitted conditions."""
    return DEFAULT_POINTS + POINTS_PER_FACTOR * max(0, factors - 2)


def check_number(name: str, value: Any, low: int, high: int) -> None:
    """Raise InvalidValueError unless the value is an integer within the bounds."""
    if type(value) is not int or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )
