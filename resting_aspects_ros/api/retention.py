"""Retention curves: how strong a disturbance must be for a part to leave its aspect."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.conditions import given_conditions, surface_text
from resting_aspects_ros.api.plan import new_run
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import Progress, StartTally, keep_result, make_runner, never
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, aspect_fields
from resting_aspects_ros.report.transitions import retention_fields, retention_figure
from resting_aspects_ros.simulation.actions import MAX_LIFT, disturbance_starts
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    MAX_DROPS,
    DropConditions,
)
from resting_aspects_ros.simulation.job import RunDescription, plan_run
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.intervals import CONFIDENCE, check_confidence
from resting_aspects_ros.statistics.transitions import RetentionCurve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Page

# If none of 400 parts leaves, the 95 % interval of the probability ends at 0.95 %.
DEFAULT_PER_HEIGHT = 400
# Number of lift heights of each curve, and the lowest and by default the highest of them as
# multiples of the least barrier. No part leaves below the barrier, except for energy that the
# engine adds.
HEIGHTS = 13
LOWEST, HIGHEST = 0.9, 20.0
# Barrier, as a share of R, that is assumed for the heights of an aspect without another one.
NO_BARRIER = 0.1
# By default, heights are at most this multiple of R.
MAX_HEIGHT = 2.0


@dataclasses.dataclass(frozen=True, eq=False)
class RetentionResult(Result):
    """The retention curves of a part.

    Attributes
    ----------
    curves : tuple of RetentionCurve
        A curve for each aspect that was disturbed, by id.
    aspects : AspectSet
    run : RunDescription
    part : Part
    complete : bool
        Whether all disturbances are counted.
    """

    curves: tuple[RetentionCurve, ...]
    aspects: AspectSet
    run: RunDescription
    part: Part
    complete: bool

    @property
    def title(self) -> str:
        """Part, surface and seed in one line."""
        return f'{self.run.part}, {self.subtitle}'

    @property
    def subtitle(self) -> str:
        """Surface and seed."""
        return f'disturbed on {surface_text(self.run.conditions)}, seed {self.run.seed}'

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects retention --json` prints."""
        run = self.run.document()
        asked = run.pop('drops')
        del run['precision']
        return {
            'schema_version': SCHEMA_VERSION,
            **run,
            'mesh_sha256': self.part.mesh_sha256,
            'disturbances_asked': asked,
            'complete': self.complete,
            'aspects': [aspect_fields(each, self.part) for each in self.aspects],
            'curves': [retention_fields(curve) for curve in self.curves],
        }

    def page(self) -> 'Page':
        """Return a page with the curves and all numbers."""
        from resting_aspects_ros.api.pages import retention_page

        return retention_page(self)

    def figure(self) -> 'Figure':
        """Return the curves."""
        return retention_figure(self.curves, self.aspects, self.part, self.title)


def retention(
    part: Part | str | Path,
    per_height: int = DEFAULT_PER_HEIGHT,
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    max_lift: float | None = None,
    seed: int = DEFAULT_SEED,
    confidence: float = CONFIDENCE,
    engine: str = '',
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> RetentionResult:
    """Disturb a part at rest in each aspect with rising energy, and count how often it leaves.

    The energy of a disturbance is fixed, and its direction is uniform on the unit sphere of the
    six mass-weighted velocities, upwards; see docs/explanation/reorientation.md.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    per_height : int
        Number of disturbances at each of 13 energies.
    surface : str or DropConditions
        Named conditions, or conditions; height, speeds and spin at release have no effect.
    max_lift : float, optional
        Maximum energy as a lift height of the centre of mass, m; by default 20 times the barrier,
        but not more than twice the hull radius.
    seed, confidence, engine, workers, progress, stopped
        As for `drop`.
    **conditions : float
        Conditions that differ from the surface, in SI units, such as ``friction=0.3``.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or the part has no aspect.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.retention('tetrahedron', 20, seed=1)
    >>> [curve.aspect for curve in result.curves]
    [1, 2, 3, 4]
    """
    check_confidence(confidence)
    given = given_conditions(surface, conditions)
    loaded = given_part(part)
    landscape = Landscape(loaded)
    aspects = find_aspects(loaded, landscape)
    if not len(aspects):
        raise InvalidValueError(f'invalid part {loaded.name}: expected a part with an aspect')
    lift = lift_heights(aspects, loaded.hull_radius, max_lift)
    limit = MAX_DROPS // lift.size
    if not isinstance(per_height, int) or not 1 <= per_height <= limit:
        raise InvalidValueError(
            f'invalid per_height {shown(per_height)}: expected 1 to {limit} for {len(aspects)} '
            'aspects'
        )
    job, run = plan_run(
        loaded,
        given,
        seed=seed,
        drops=per_height * lift.size,
        **new_run(),
        landscape=landscape,
        starts=disturbance_starts(loaded, aspects, lift, given),
        engine=engine,
    )
    tally = StartTally(aspects, lift.size, run.drops)

    def result() -> RetentionResult:
        counts = tally.counts.reshape(*lift.shape, -1)
        curves = []
        for k, aspect in enumerate(aspects):
            parts = counts[k].sum(axis=1)
            made, left = parts > 0, parts - counts[k, :, k]
            barrier = aspect.min_barrier
            if made.any():
                here = lift[k, made], left[made], parts[made]
                curves.append(RetentionCurve(aspect.id, barrier, *here, confidence))
        return RetentionResult(tuple(curves), aspects, run, loaded, tally.complete)

    with keep_result(result), make_runner(workers, progress, stopped) as runner:
        runner.count(job, run, tally, label=f'{loaded.name}, disturbed', unit='parts')
    return result()


def lift_heights(aspects: AspectSet, radius: float, max_lift: float | None) -> Array:
    """Return the lift heights (a, m) of the curve of each aspect, m, ascending.

    They have equal ratios, from just below the least barrier to the maximum.
    """
    number = isinstance(max_lift, int | float)
    if max_lift is not None and not (number and 0 < max_lift <= MAX_LIFT):
        raise InvalidValueError(
            f'invalid maximum lift height {max_lift!r} m: expected more than 0 and at most '
            f'{MAX_LIFT:g} m'
        )
    rows = []
    for aspect in aspects:
        barrier = aspect.min_barrier if np.isfinite(aspect.min_barrier) else NO_BARRIER * radius
        limit = max_lift
        if limit is None:
            limit = min(HIGHEST * barrier, MAX_HEIGHT * radius, MAX_LIFT)
        above = limit > 2 * LOWEST * barrier
        rows.append(np.geomspace(LOWEST * barrier if above else limit / HEIGHTS, limit, HEIGHTS))
    return np.array(rows)
