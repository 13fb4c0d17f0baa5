"""Plan drops of a part, also from given states, and actions on parts at rest in its aspects."""

import math
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.conditions import aspects_in, contacts_in, scene_of, shipped_actions
from resting_aspects_ros.api.runner import DropTally, TransitionTally
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, located, warn
from resting_aspects_ros.input_files import CsvTable, open_text
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import LENGTH_TOLERANCE
from resting_aspects_ros.simulation.actions import KINDS, NamedAction
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    MAX_DROPS,
    DropConditions,
    Noise,
    check_integer,
)
from resting_aspects_ros.simulation.job import DropJob, RunDescription, plan_run
from resting_aspects_ros.simulation.scene import Scene, depth_of, in_scene_axes
from resting_aspects_ros.simulation.starts import (
    Action,
    GivenStarts,
    GivenStates,
    Starts,
    starts_of,
)
from resting_aspects_ros.statistics.distribution import ContactCounts, no_drops
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    check_confidence,
    check_interval_method,
    check_precision,
    max_drops,
)
from resting_aspects_ros.statistics.poses import RestingPoses
from resting_aspects_ros.statistics.transitions import OUTCOMES, no_actions

# -- Given initial states -------------------------------------------------------------------------


DEFAULT_REPLICATES = 1
# A part may reach into a plane of surroundings by this, R; the engine moves it out.
MAX_OVERLAP = 0.01
# States that are checked together.
_BLOCK = 1000
# Columns of a file of states.
COLUMNS = ('x_m', 'y_m', 'z_com_m', 'qx', 'qy', 'qz', 'qw', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz')
NEEDED = COLUMNS[2:7]
# 100,000 states.
MAX_BYTES = 1 << 25


def given_starts(
    part: Part, given: GivenStates, noise: Noise, conditions: DropConditions, replicates: int
) -> tuple[GivenStarts, int]:
    """Return the starts of a run and its number of drops; raises InvalidValueError."""
    check_integer('replicates', replicates, 1, MAX_DROPS // len(given))
    scene = scene_of(part, conditions)
    if not scene.level:
        _check_outside(part, scene, given)
    starts = GivenStarts(given, noise, conditions.gravity, part.hull_radius)
    return starts, replicates * len(given)


def _check_outside(part: Part, scene: Scene, given: GivenStates) -> None:
    """Raise InvalidValueError if a part begins inside a half-space of the surroundings."""
    corners = part.hull_vertices - part.centre_of_mass
    for first in range(0, len(given), _BLOCK):
        rows = slice(first, first + _BLOCK)
        position = scene.in_scene(given.position[rows])
        orientation = in_scene_axes(scene, given.orientation[rows])
        for plane in scene.half_spaces:
            reach = depth_of(orientation, corners, -plane.normal)
            gap = (position * plane.normal).sum(axis=1) - plane.offset - reach
            worst = int(gap.argmin())
            if gap[worst] < -MAX_OVERLAP * part.hull_radius:
                raise InvalidValueError(
                    f'invalid initial state {first + worst}: the part is '
                    f'{-1000 * gap[worst]:.4g} mm inside the {plane.name.replace("_", " ")}; '
                    'expected outside of the surroundings'
                )


def read_state_csv(path: Path) -> GivenStates:
    """Read a CSV with the columns NEEDED, any of COLUMNS, and others, which are not read.

    Position of the centre of mass in the tray frame, m (x and y are 0 without a column);
    quaternion x y z w, tray from part; velocity vx, vy, vz of the centre of mass in tray axes,
    m/s, and spin wx, wy, wz in part axes, rad/s, both 0 without columns. Raises InvalidValueError,
    which names file, line and column.
    """
    rows: list[list[float]] = []
    with open_text(path, 'file of initial states', MAX_BYTES) as file:
        table = CsvTable(path, file)
        others = f'the columns are {", ".join(COLUMNS)}, of which {", ".join(NEEDED)} are needed'
        columns = [
            table.column(name, others) if name in (*NEEDED, *table.names) else None
            for name in COLUMNS
        ]
        for line, row in table.rows():
            rows.append([0.0 if k is None else table.number(line, row, k) for k in columns])
            length = math.hypot(*rows[-1][3:7])
            if not abs(length - 1) <= LENGTH_TOLERANCE:
                raise table.wrong(
                    line, row, columns[3] or 0, f'a quaternion of length 1; it is {length:.6g}'
                )
    values = np.array(rows, dtype=np.float64).reshape(-1, len(COLUMNS))
    with located(repr(str(path))):
        return GivenStates(values[:, :3], values[:, 3:7], values[:, 7:10], values[:, 10:])


# -- Drops ----------------------------------------------------------------------------------------


# A height of more than both, in hull radii and in m, is probably a mistake of the unit.
MAX_RADII, MAX_HEIGHT = 500, 1.0
DEFAULT_ACTION = 'tap'
# 385 actions give intervals of about +-0.05 in the worst case.
DEFAULT_PER_ASPECT = 400
# An action that lifts a part by more than this number of hull radii is probably a mistake of the
# unit, and its simulation takes minutes.
MAX_LIFT = 200
# Number of jets on each aspect that are used to check whether jets meet the part.
JETS = 20


def new_run() -> dict[str, Any]:
    """Return the id and the time of the start of a new run."""
    return {'run_id': uuid.uuid4().hex[:12], 'started': time.time_ns()}


def check_height(part: Part, height: float) -> None:
    """Raise InvalidValueError if a height, m, is probably in a wrong unit."""
    limit = max(MAX_HEIGHT, MAX_RADII * part.hull_radius)
    if height > limit:
        raise InvalidValueError(
            f'invalid height {height:g} m: expected at most {limit:.3g} m for the size of '
            f'{part.name}; values are in SI units unless they have a unit, such as {height:g}mm'
        )


@dataclass(frozen=True)
class PlannedDrops:
    """A run that is ready to be simulated; ``contacts`` is None without walls."""

    job: DropJob
    run: RunDescription
    tally: DropTally
    contacts: ContactCounts | None = None


def plan_drops(
    part: Part,
    conditions: DropConditions,
    *,
    drops: int,
    seed: int,
    first_drop: int = 0,
    precision: float = 0.0,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    starts: Starts | None = None,
    engine: str = '',
) -> PlannedDrops:
    """Find the aspects of a part and plan a run; raises InvalidValueError.

    See plan_run for ``starts`` and ``engine``.
    """
    _check_intervals(precision, interval, confidence)
    landscape = Landscape(part)
    scene = scene_of(part, conditions)
    aspects = aspects_in(scene, find_aspects(part, landscape))
    empty = no_drops(aspects, interval=interval, confidence=confidence, by_precision=precision > 0)
    count = max_drops(drops, precision, MAX_DROPS, len(aspects), interval, confidence)
    job, run = plan_run(
        part,
        conditions,
        seed=seed,
        drops=count,
        first_drop=first_drop,
        precision=precision,
        **new_run(),
        landscape=landscape,
        starts=starts,
        engine=engine,
    )
    tally = DropTally(empty, run.drops, precision)
    return PlannedDrops(job, run, tally, contacts_in(scene, part, aspects))


@dataclass(frozen=True)
class PlannedActions:
    """Actions that are ready to be simulated."""

    action: NamedAction
    job: DropJob
    run: RunDescription
    tally: TransitionTally


def plan_actions(
    part: Part,
    action: NamedAction,
    conditions: DropConditions,
    *,
    per_aspect: int = DEFAULT_PER_ASPECT,
    precision: float = 0.0,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    landscape: Landscape | None = None,
    rests: RestingPoses | None = None,
    engine: str = '',
) -> PlannedActions:
    """Find the aspects of a part and plan an action from each; raises InvalidValueError.

    With a precision, ``per_aspect`` is the maximum number of actions; 0: as many as needed.
    ``rests`` are resting poses in the surroundings, from which the actions start there. See
    plan_run for ``engine``.
    """
    landscape = Landscape(part) if landscape is None else landscape
    scene, aspects, per_aspect = check_actions(
        part,
        action,
        conditions,
        per_aspect=per_aspect,
        precision=precision,
        interval=interval,
        confidence=confidence,
        landscape=landscape,
    )
    starts = starts_of(part, aspects, action.action, scene, conditions, rests)
    ids = starts.ids
    _warn_if_missing(aspects, ids, rests)
    job, run = plan_run(
        part,
        conditions,
        seed=seed,
        drops=per_aspect * len(ids),
        precision=precision,
        **new_run(),
        landscape=landscape,
        starts=starts,
        engine=engine,
    )
    check_speed(part, action, job)
    _warn_if_missed(action, job, ids)
    empty = no_actions(
        aspects, interval=interval, confidence=confidence, by_precision=precision > 0
    )
    return PlannedActions(action, job, run, TransitionTally(empty, run.drops, precision, ids))


def check_actions(
    part: Part,
    action: NamedAction,
    conditions: DropConditions,
    *,
    per_aspect: int,
    precision: float = 0.0,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    landscape: Landscape | None = None,
) -> tuple[Scene, AspectSet, int]:
    """Return the surroundings, the aspects counted in them, and the number of actions from each.

    Raises InvalidValueError. Actions in surroundings are checked before the drops from which they
    start; see plan_actions for the parameters.
    """
    _check_intervals(precision, interval, confidence)
    scene = scene_of(part, conditions)
    action.action.check(action.name, scene)
    aspects = aspects_in(scene, find_aspects(part, landscape))
    if not len(aspects):
        raise InvalidValueError(f'invalid part {part.name}: expected a part with an aspect')
    limit = MAX_DROPS // len(aspects)
    columns = len(aspects) + len(OUTCOMES)
    per_aspect = max_drops(per_aspect, precision, limit, columns, interval, confidence)
    check_integer('number of actions per aspect', per_aspect, 1, limit)
    return scene, aspects, per_aspect


def _check_intervals(precision: float, interval: str, confidence: float) -> None:
    check_interval_method(interval)
    check_confidence(confidence)
    if precision:
        check_precision(precision)


def check_speed(part: Part, action: NamedAction, job: DropJob) -> None:
    """Raise InvalidValueError if the action is so strong that it is probably a mistake."""
    limit = math.sqrt(2 * job.conditions.gravity * MAX_LIFT * part.hull_radius)
    if job.impact_speed > limit:
        raise InvalidValueError(
            f'invalid action {action.name}: it moves {part.name} with up to '
            f'{job.impact_speed:.3g} m/s; expected at most {limit:.3g} m/s, which lifts it by '
            f'{MAX_LIFT} times its radius; all values are in SI units unless they have a unit'
        )


def _warn_if_missing(aspects: AspectSet, ids: tuple[int, ...], rests: RestingPoses | None) -> None:
    """Warn of aspects that do not occur in surroundings, from which no action can start."""
    missing = [str(a.id) for a in aspects if a.id not in ids]
    if missing and rests is not None:
        warn(
            f'no part came to rest in aspect {", ".join(missing)} in {len(rests)} drops in these '
            'surroundings: no action starts there, the row has no counts, and the long run is not '
            'known'
        )


def _warn_if_missed(action: NamedAction, job: DropJob, ids: tuple[int, ...]) -> None:
    """Warn of aspects in which an action never meets the part."""
    if not (action.action.can_miss and action.action.has_effect):
        return
    assert job.starts is not None
    index = np.arange(JETS * len(ids))
    states = job.starts.states(index, np.random.default_rng(job.seed))
    met = (states.velocity != 0).any(axis=1).reshape(JETS, len(ids)).any(axis=0)
    if not met.all():
        missed = ', '.join(str(ids[k]) for k in np.flatnonzero(~met).tolist())
        where = 'every aspect: it' if not met.any() else f'aspect {missed}, where it'
        warn(f'the jet of {action.name} misses the part in {where} has no effect')


def named_action(action: str | Action | NamedAction) -> NamedAction:
    """Return an action with its name; raises InvalidValueError if the name is not known."""
    if isinstance(action, NamedAction):
        return action
    if isinstance(action, str):
        return shipped_actions().get(action)
    if not isinstance(action, tuple(KINDS.values())):
        raise InvalidValueError(
            f'invalid action {action!r}: expected a name or one of {", ".join(KINDS)}'
        )
    return NamedAction(action.kind, action)
