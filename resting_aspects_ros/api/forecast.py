"""Forecast the parts per minute of a feeder: its setup, the fixed cycle, and the controller."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.forecast_result import ForecastResult, divided_class_texts
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.api.reorient import PlannedReorient, ReorientResult, plan_reorient
from resting_aspects_ros.api.runner import Progress, Runner, make_runner, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.errors import InvalidValueError, StoppedError, warn
from resting_aspects_ros.feeding.footprint import Footprint, Tray, check_fit, free_shares
from resting_aspects_ros.feeding.forecast import FeederModel, check_minutes, check_number
from resting_aspects_ros.feeding.forecast import forecast as forecast_rate
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.forecast import NamedForecast
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.counted_parts import LiveCounts

if TYPE_CHECKING:
    from resting_aspects_ros.feeding.grasps import Grasp
    from resting_aspects_ros.feeding.tray_simulation import ControlledRuns
    from resting_aspects_ros.vision.location import Placement

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


def footprints_of(
    part: Part,
    aspects: AspectSet,
    rows: Sequence[tuple[Aspect, ...]],
    grasps: Sequence['Grasp'] = (),
) -> tuple[Footprint, ...]:
    """Return the rectangle, or the disc, around the outline of each row, with the grips of it."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.feeding.grasps import grips_of

    placements = placements_of(part, aspects)
    found = []
    for row in rows:
        placement = placements[row[0].symmetry_class - 1]
        seen, own = placement.outline, grips_of(grasps, placement) if grasps else ()
        if seen.yaw_symmetry == 0:
            found.append(Footprint(0.0, 0.0, seen.length / 2, own))
        else:
            found.append(Footprint(seen.length, seen.width, 0.0, own))
    return tuple(found)


def placements_of(part: Part, aspects: AspectSet) -> tuple['Placement', ...]:
    """Return how the part lies in each symmetry class, with its outline."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.vision.location import Placement
    from resting_aspects_ros.vision.outline import find_outlines

    return tuple(Placement(part, aspects, each) for each in find_outlines(part, aspects))


def check_tray(part: Part, aspects: AspectSet, tray: Tray, number: int | None) -> None:
    """Raise InvalidValueError if the part, or the number of parts, does not fit on the tray."""
    footprints = footprints_of(part, aspects, aspects.classes())
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
    grasps: Sequence['Grasp'] = (),
    parts_on_tray: int | None = None,
    max_picks: int | None = None,
    minutes: float = 60.0,
    action: str | Action | NamedAction = DEFAULT_ACTION,
    controller: bool = False,
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
        Ids of the aspects in which the robot can pick the part.
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
    grasps : sequence of Grasp
        Grasps of the part, see `load_grasps`: instead of ``gripper``, a part can be picked if no
        other part is in the footprint of one of them.
    parts_on_tray : int, optional
        By default the number with the highest rate.
    max_picks : int, optional
        Maximum number of picks after one image.
    minutes : float
        Duration of a run, for the prediction interval.
    action : str, Action or NamedAction
        What the feeder does to the parts before each image.
    controller : bool
        Also simulate runs in which feeder_controller decides; see `forecast_controlled`.
    workers, progress, stopped
        As for `drop`.
    **simulation
        ``per_aspect`` (by default 200), ``drops``, ``surface``, ``seed``, ``confidence`` and
        conditions, as for `reorient`.

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
    >>> result = ra.forecast('tetrahedron', [1, 2], drops=50, per_aspect=20, seed=1)
    >>> result.limited_by
    'robot'
    """
    if (pickable is None) == (pickable_classes is None):
        raise InvalidValueError(
            'invalid pickable aspects: expected either pickable or pickable_classes'
        )
    return forecast_each(
        [(part, [(pickable, pickable_classes)])],
        robot=robot,
        vibrate=vibrate,
        settle=settle,
        image=image,
        supply=supply,
        overlap=overlap,
        place=place,
        tray=tray,
        clearance=clearance,
        gripper=gripper,
        grasps=grasps,
        parts_on_tray=parts_on_tray,
        max_picks=max_picks,
        minutes=minutes,
        action=action,
        controller=controller,
        workers=workers,
        progress=progress,
        stopped=stopped,
        **simulation,
    )[0]


# Ids of pickable aspects, or numbers of pickable symmetry classes.
Pickable = tuple[Sequence[int] | None, Sequence[int] | None]


def forecast_each(
    requests: Sequence[tuple[Part | str | Path | ReorientResult, Sequence[Pickable]]],
    *,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **options: Any,
) -> list[ForecastResult]:
    """Forecast as `forecast` does for each part and each of its sets of pickable aspects.

    All input is checked before the first simulation, and each part is simulated once. ``options``
    are the other arguments of `forecast`.
    """
    planned = [plan_forecasts(part, sets, **options) for part, sets in requests]
    with make_runner(workers, progress, stopped) as runner:
        return [result for make in planned for result in make(runner)]


def plan_forecasts(
    part: Part | str | Path | ReorientResult,
    sets: Sequence[Pickable],
    *,
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
    grasps: Sequence['Grasp'] = (),
    parts_on_tray: int | None = None,
    max_picks: int | None = None,
    minutes: float = 60.0,
    action: str | Action | NamedAction = DEFAULT_ACTION,
    controller: bool = False,
    per_aspect: int = PER_ASPECT,
    **simulation: Any,
) -> Callable[[Runner], list[ForecastResult]]:
    """Check the forecasts of a part; see `forecast`. Returns what simulates and forecasts them.

    It raises StoppedError if the runner is stopped.
    """
    named = part.action if isinstance(part, ReorientResult) else named_action(action)
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
    reorientation: PlannedReorient | ReorientResult
    if isinstance(part, ReorientResult):
        if simulation or action != DEFAULT_ACTION or per_aspect != PER_ASPECT:
            raise InvalidValueError(
                'invalid action or conditions: expected none with the result of reorient, which '
                'has its own'
            )
        reorientation, aspects = part, part.matrix.aspects
    else:
        reorientation = plan_reorient(part, [named], per_aspect, **simulation)
        aspects = reorientation.aspects
    loaded = reorientation.part
    check_tray(loaded, aspects, cell, parts_on_tray)
    pickable = [aspects.chosen(*each, 'pickable') for each in sets]
    if grasps:
        # The import of shapely is only needed here.
        from resting_aspects_ros.feeding.grasps import check_grasps

        for each in pickable:
            check_grasps(grasps, placements_of(loaded, aspects), each)
    _check_divided(loaded, aspects, pickable, controller=controller)

    def make(runner: Runner) -> list[ForecastResult]:
        known = reorientation
        result = known if isinstance(known, ReorientResult) else known.make(runner)[0]
        found = []
        for ids in pickable:
            if runner.stopped():
                raise StoppedError('interrupted; there is no forecast')
            each = forecast_from(
                result,
                ids,
                cell,
                times,
                parts_on_tray=parts_on_tray,
                max_picks=max_picks,
                minutes=minutes,
                grasps=grasps,
            )
            if controller:
                each = dataclasses.replace(each, controlled=forecast_controlled(each))
            found.append(each)
        return found

    return make


def _check_divided(
    part: Part, aspects: AspectSet, pickable: Sequence[tuple[int, ...]], *, controller: bool
) -> None:
    """Warn of symmetry classes that are pickable in part; InvalidValueError for the controller."""
    divided = dict.fromkeys(text for ids in pickable for text in divided_class_texts(aspects, ids))
    if divided and controller:
        raise InvalidValueError(
            f'invalid pickable aspects {list(pickable[0])}: expected all aspects of a symmetry '
            'class, which a camera cannot tell apart, for runs in which the controller decides'
        )
    for text in divided:
        warn(f'{part.name}: {text}; pickable classes request whole classes')


def forecast_from(
    result: ReorientResult,
    pickable: Sequence[int],
    tray: Tray,
    times: CycleTimes,
    *,
    parts_on_tray: int | None = None,
    max_picks: int | None = None,
    minutes: float = 60.0,
    grasps: Sequence['Grasp'] = (),
) -> ForecastResult:
    """Forecast from simulated drops and actions; see `forecast`. ``pickable`` are ids.

    If whole symmetry classes are pickable, the forecast uses the counts by class.
    """
    aspects = result.matrix.aspects
    ids = set(aspects.chosen(pickable, None, 'pickable'))
    classes = aspects.classes()
    by_class = all(
        ids.issuperset(members) or ids.isdisjoint(members)
        for members in ({aspect.id for aspect in alike} for alike in classes)
    )
    if grasps:
        # The import of shapely is only needed here.
        from resting_aspects_ros.feeding.grasps import check_grasps

        check_grasps(grasps, placements_of(result.part, aspects), sorted(ids))
    rows = classes if by_class else [(aspect,) for aspect in aspects]
    view = result.by_class() if by_class else result
    model = FeederModel(
        drop=view.drop.counts,
        transitions=view.matrix.counts,
        pickable=np.array([row[0].id in ids for row in rows]),
        footprints=footprints_of(result.part, aspects, rows, grasps),
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
    named = NamedForecast(result.run.part, result.action.name, tuple(rows), model, found)
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
    about 10 s. Parts with grasps, or with a gripper, are represented by rectangles.

    Parameters
    ----------
    result : ForecastResult
        By symmetry class: whole classes are pickable.
    minutes : float, optional
        Duration of a run, which begins with an empty tray; by default that of the forecast.

    Raises
    ------
    InvalidValueError
        ``minutes`` is out of bounds, or only a part of a class is pickable.
    """
    # These imports are only needed here.
    from resting_aspects_ros.feeding.control import controller_model
    from resting_aspects_ros.feeding.tray_simulation import forecast_controller
    from resting_aspects_ros.vision.tray_image import OutlinePlaces

    named, found = result.named, result.named.forecast
    part, aspects = result.reorientation.part, result.reorientation.matrix.aspects
    if len(named.rows) != len(aspects.classes()):
        raise InvalidValueError(
            f'invalid pickable aspects {list(result.pickable)}: expected all aspects of a '
            'symmetry class, which a camera cannot tell apart'
        )
    seed = result.reorientation.run.seed
    model = controller_model(named.model, number=found.number, seed=seed)
    tray, footprints = named.model.tray, named.model.footprints
    places = None
    if tray.gripper is None and not any(each.grips for each in footprints):
        outlines = [each.outline for each in placements_of(part, aspects)]
        places = partial(OutlinePlaces, outlines, tray.size)
    return forecast_controller(
        model,
        found.minutes if minutes is None else minutes,
        places=places,
        confidence=result.reorientation.matrix.confidence,
        seed=seed,
    )
