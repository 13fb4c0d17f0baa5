"""Forecast the parts per minute of a feeder: its setup, the fixed cycle, and the controller."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.api.reorient import ReorientResult, reorient
from resting_aspects_ros.api.runner import Progress, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, StoppedError, warn
from resting_aspects_ros.feeding.footprint import Footprint, Tray, check_fit, free_shares
from resting_aspects_ros.feeding.forecast import FeederModel, check_minutes, check_number
from resting_aspects_ros.feeding.forecast import forecast as forecast_rate
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.forecast import NamedForecast
from resting_aspects_ros.report.format import ids_text
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.counted_parts import LiveCounts

if TYPE_CHECKING:
    from resting_aspects_ros.feeding.tray_simulation import ControlledRuns

DEFAULT_ACTION = 'flip'
# Assumed: a pick and place of a small robot, an image with its evaluation, a tray of a small
# flexible feeder, and the fingers of a gripper.
ROBOT, IMAGE = 1.2, 0.2
TRAY, CLEARANCE = (0.2, 0.2), 0.005
# With this number of actions from each aspect, the interval is about +-5 % for l_bracket and
# +-0.5 % for hex_nut, which is less than the systematic error of the simulation can be.
PER_ASPECT = 200


def cycle_times(
    action: NamedAction,
    *,
    robot: float = ROBOT,
    vibrate: float | None = None,
    settle: float | None = None,
    image: float = IMAGE,
    supply: float = 0.0,
    overlap: bool = False,
    place: float | None = None,
) -> CycleTimes:
    """Return the times of a cycle, with those of the action where none are given.

    The time of a vibration is divided into its duration and the time until the parts are at rest;
    that of any other action is all vibration time. Raises InvalidValueError.
    """
    if place is not None and not overlap:
        raise InvalidValueError(f'invalid place time {place!r} s: expected only with overlap')
    lasts = action.moving_time
    times = CycleTimes(
        robot=robot,
        vibrate=lasts if vibrate is None else vibrate,
        settle=action.time - lasts if settle is None else settle,
        image=image,
        supply=supply,
    )
    if not overlap:
        return times
    away = times.robot / 2 if place is None else place
    return dataclasses.replace(times, place=away)


def footprints_of(part: Part, aspects: AspectSet) -> tuple[Footprint, ...]:
    """Return the rectangle, or the disc, around the outline of each symmetry class."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.vision.outline import find_outlines

    found = []
    for seen in find_outlines(part, aspects):
        if seen.yaw_symmetry == 0:
            found.append(Footprint(0.0, 0.0, seen.length / 2))
        else:
            found.append(Footprint(seen.length, seen.width))
    return tuple(found)


def check_tray(part: Part, aspects: AspectSet, tray: Tray, number: int | None) -> None:
    """Raise InvalidValueError if the part, or the number of parts, does not fit on the tray."""
    footprints = footprints_of(part, aspects)
    check_fit(tray, footprints)
    if number is not None:
        check_number('number of parts on the tray', number)
        free_shares(tray, footprints, np.ones(len(footprints)), 1, number).at(number)


def forecast(
    part: Part | str | Path | ReorientResult,
    pickable: Sequence[int] | None = None,
    *,
    pickable_classes: Sequence[int] | None = None,
    robot: float = ROBOT,
    vibrate: float | None = None,
    settle: float | None = None,
    image: float = IMAGE,
    supply: float = 0.0,
    overlap: bool = False,
    place: float | None = None,
    tray: tuple[float, float] = TRAY,
    clearance: float = CLEARANCE,
    gripper: Footprint | None = None,
    parts_on_tray: int | None = None,
    max_picks: int | None = None,
    minutes: float = 60.0,
    action: str | Action | NamedAction = DEFAULT_ACTION,
    per_aspect: int = PER_ASPECT,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **simulation: Any,
) -> ForecastResult:
    """Forecast the parts per minute that a robot picks from a vibrating tray under a camera.

    The model is described in docs/explanation/feeding.md.

    Parameters
    ----------
    part : Part, str, Path or ReorientResult
        A part, or what `load_part` accepts; or the result of `reorient`, whose action and
        conditions then hold, and which is not simulated again.
    pickable : sequence of int, optional
        Ids of the aspects in which the robot can pick the part. Aspects of a symmetry class look
        the same: if one is pickable, all are.
    pickable_classes : sequence of int, optional
        Numbers of symmetry classes instead.
    robot : float
        Time from one pick to the next, s.
    vibrate, settle : float, optional
        Time of the vibration, and until the parts are at rest, s; by default those of the action.
    image : float
        Time of an image and its evaluation, s.
    supply : float
        Time to supply a part, s, for each supplied part.
    overlap : bool
        The next vibration, settling and image run while the robot places the last part.
    place : float, optional
        With overlap: time after the last pick in which the robot is away from the tray, s; by
        default half of ``robot``.
    tray : (float, float)
        Width and depth, m.
    clearance : float
        Minimum distance between a part that can be picked and any other, m.
    gripper : Footprint, optional
        What the gripper covers, centred on the part and turned with it; no other part may be in
        it.
    parts_on_tray : int, optional
        By default the number with the highest rate.
    max_picks : int, optional
        Maximum number of picks after one image.
    minutes : float
        Duration of a run, for the prediction interval.
    action : str, Action or NamedAction
        What the feeder does to the parts before each image.
    per_aspect : int
        Number of simulated actions from each aspect.
    workers, progress, stopped
        As for `drop`.
    **simulation
        ``drops``, ``surface``, ``seed``, ``confidence`` and conditions, as for `reorient`.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name or an id is not known, or the part does not fit the tray.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    StoppedError
        ``stopped`` returned True before the simulation was complete.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.forecast('tetrahedron', [1, 2, 3, 4], drops=50, per_aspect=20, seed=1)
    >>> result.limited_by
    'robot'
    """
    if (pickable is None) == (pickable_classes is None):
        raise InvalidValueError(
            'invalid pickable aspects: expected either pickable or pickable_classes'
        )
    if isinstance(part, ReorientResult):
        if simulation or action != DEFAULT_ACTION or per_aspect != PER_ASPECT:
            raise InvalidValueError(
                'invalid action or conditions: expected none with the result of reorient, which '
                'has its own'
            )
        named, loaded, aspects = part.action, part.part, part.matrix.aspects
    else:
        named, loaded = named_action(action), given_part(part)
        aspects = find_aspects(loaded)
    times = cycle_times(
        named,
        robot=robot,
        vibrate=vibrate,
        settle=settle,
        image=image,
        supply=supply,
        overlap=overlap,
        place=place,
    )
    cell = Tray(tray, clearance, gripper)
    check_minutes(minutes)
    if max_picks is not None:
        check_number('maximum number of picks', max_picks)
    check_tray(loaded, aspects, cell, parts_on_tray)
    ids = aspects.chosen(pickable, pickable_classes, 'pickable')
    for members in aspects.classes():
        if 0 < sum(aspect.id in ids for aspect in members) < len(members):
            warn(
                f'{loaded.name}: aspects {ids_text(members)} look the same, so all of them count '
                'as pickable'
            )
    if isinstance(part, ReorientResult):
        result = part
    else:
        result = reorient(
            loaded,
            named,
            per_aspect,
            workers=workers,
            progress=progress,
            stopped=stopped,
            **simulation,
        )
    if stopped():
        raise StoppedError('interrupted; there is no forecast')
    return forecast_from(
        result,
        ids,
        cell,
        times,
        parts_on_tray=parts_on_tray,
        max_picks=max_picks,
        minutes=minutes,
    )


def forecast_from(
    result: ReorientResult,
    pickable: Sequence[int],
    tray: Tray,
    times: CycleTimes,
    *,
    parts_on_tray: int | None = None,
    max_picks: int | None = None,
    minutes: float = 60.0,
) -> ForecastResult:
    """Forecast from simulated drops and actions; see `forecast`.

    ``pickable`` are ids of aspects. The forecast is by symmetry class: all aspects of a class are
    pickable, or none.
    """
    aspects = result.matrix.aspects
    ids = set(aspects.chosen(pickable, None, 'pickable'))
    classes, view = aspects.classes(), result.by_class()
    mask = [any(aspect.id in ids for aspect in members) for members in classes]
    ids.update(
        a.id for members, wanted in zip(classes, mask, strict=True) if wanted for a in members
    )
    model = FeederModel(
        drop=view.drop.counts,
        transitions=view.matrix.counts,
        pickable=np.array(mask),
        footprints=footprints_of(result.part, aspects),
        tray=tray,
        times=times,
        max_picks=max_picks,
    )
    found = forecast_rate(
        model,
        parts_on_tray,
        minutes=minutes,
        confidence=result.matrix.confidence,
        seed=result.run.seed,
    )
    named = NamedForecast(result.run.part, result.action.name, tuple(classes), model, found)
    return ForecastResult(result, tuple(sorted(ids)), named)


def with_live_counts(
    result: ReorientResult, live: LiveCounts, moved: Counts | None = None
) -> ReorientResult:
    """Return a result in which drops and transitions are combined with counted parts.

    The simulation has the weight of ``live.prior_weight`` parts, for the drops and for each row of
    the matrix with counted parts; the other rows remain as simulated. Counts are by symmetry
    class, so they are those of the first aspect of each class: only the result by class is
    meaningful.

    Parameters
    ----------
    result : ReorientResult
        Simulated, by aspect.
    live : LiveCounts
        Newly supplied parts by symmetry class.
    moved : (c, c) int, optional
        Parts that were followed through the action, from class to class.
    """
    by_class = result.by_class()
    first = [members[0].id - 1 for members in result.drop.aspects.classes()]
    count, aspects = len(first), len(result.drop.counts)
    drops = np.zeros(aspects, dtype=np.int64)
    drops[first] = _integers(live.concentration)
    rows = by_class.matrix.counts.copy()
    machine = np.zeros((count, count), dtype=np.int64) if moved is None else moved
    for k in np.flatnonzero(machine.sum(axis=1)):
        total = int(rows[k].sum())
        both = rows[k] / max(total, 1) * min(live.weight, total)
        both[:count] += machine[k]
        rows[k] = _integers(both)
    matrix = np.zeros_like(result.matrix.counts)
    matrix[np.ix_(first, first)] = rows[:, :count]
    matrix[first, aspects:] = rows[:, count:]
    return dataclasses.replace(
        result,
        drop=dataclasses.replace(result.drop, counts=drops),
        matrix=dataclasses.replace(result.matrix, counts=matrix),
    )


def _integers(values: Array) -> Counts:
    """Return integers whose partial sums are those of the values, rounded."""
    ends = np.rint(np.cumsum(values)).astype(np.int64)
    return np.asarray(ends - np.concatenate([[0], ends[:-1]]))


def forecast_controlled(result: ForecastResult, minutes: float | None = None) -> 'ControlledRuns':
    """Forecast the parts per minute if feeder_controller decides, instead of the fixed cycle.

    Runs of the controller are simulated, with the outlines of the parts on the tray, which takes
    about 10 s.

    Parameters
    ----------
    result : ForecastResult
    minutes : float, optional
        Duration of a run, which begins with an empty tray; by default that of the forecast.

    Raises
    ------
    InvalidValueError
        ``minutes`` is out of bounds, or there is a gripper.
    """
    # These imports are only needed here.
    from resting_aspects_ros.feeding.control import controller_model
    from resting_aspects_ros.feeding.tray_simulation import forecast_controller
    from resting_aspects_ros.vision.outline import find_outlines
    from resting_aspects_ros.vision.tray_image import OutlinePlaces

    named, found = result.named, result.named.forecast
    part, aspects = result.reorientation.part, result.reorientation.matrix.aspects
    if named.model.tray.gripper is not None:
        raise InvalidValueError(
            f'invalid gripper {named.model.tray.gripper.text}: expected none, as '
            'feeder_controller only knows a clearance'
        )
    seed = result.reorientation.run.seed
    model = controller_model(named.model, number=found.number, seed=seed)
    places = partial(OutlinePlaces, find_outlines(part, aspects), model.feeder.tray.size)
    return forecast_controller(
        model,
        places,
        found.minutes if minutes is None else minutes,
        confidence=result.reorientation.matrix.confidence,
        seed=seed,
    )
