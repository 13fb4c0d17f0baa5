"""Forecast the parts per minute of a feeder with a camera and a robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.forecast_setup import (
    check_tray,
    cycle_times,
    footprints_of,
    pickable_aspects,
    placements_of,
)
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.plan_actions import named_action
from resting_aspects_ros.api.reorient import reorient
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.feeding.cycle import CycleTimes
from resting_aspects_ros.core.feeding.footprint import Footprint, Tray
from resting_aspects_ros.core.feeding.forecast import forecast as forecast_rate
from resting_aspects_ros.core.feeding.model import FeederModel
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.forecast_table import NamedForecast
from resting_aspects_ros.simulation.actions import Action, NamedAction

if TYPE_CHECKING:
    from resting_aspects_ros.core.vision.grasp import Grasp

DEFAULT_ACTION = 'flip'
# Assumed: a pick and place of a small robot, an image with its evaluation, a tray of a small
# flexible feeder, and the fingers of a gripper.
ROBOT, IMAGE = 1.2, 0.2
TRAY, CLEARANCE = (0.2, 0.2), 0.005
# With this number of actions from each aspect, the interval is about +-5 % for l_bracket and
# +-0.5 % for hex_nut, which is less than the systematic error of the simulation can be.
PER_ASPECT = 200


def forecast(
    part: Part | str | Path,
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
    **simulation: Any,
) -> ForecastResult:
    """Forecast the parts per minute that a robot picks from a vibrating tray under a camera.

    The model is described in docs/explanation/feeding.md.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
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
    action : str, Kick, Nozzle, Vibration, Step or NamedAction
        What the feeder does to the parts before each image.
    **simulation
        ``per_aspect`` (by default 200), ``drops``, ``surface``, ``seed``, ``confidence``,
        ``workers``, ``progress`` and conditions, as for `reorient`.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name or an id is not known, or the part does not fit the tray.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.

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
    named = named_action(action)
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
    loaded = given_part(part)
    aspects = find_aspects(loaded)
    ids = pickable_aspects(aspects, pickable, pickable_classes)
    check_tray(loaded, aspects, cell, parts_on_tray)
    return forecast_from(
        reorient(loaded, named, **{'per_aspect': PER_ASPECT, **simulation}),
        ids,
        cell,
        times,
        parts_on_tray=parts_on_tray,
        max_picks=max_picks,
        minutes=minutes,
        grasps=grasps,
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
    grasps: Sequence['Grasp'] = (),
) -> ForecastResult:
    """Forecast from simulated drops and actions; see `forecast`. ``pickable`` are ids.

    If whole symmetry classes are pickable, the forecast uses the counts by class.
    """
    aspects = result.matrix.aspects
    ids = set(pickable_aspects(aspects, pickable, None))
    classes = aspects.classes()
    by_class = all(
        ids.issuperset(members) or ids.isdisjoint(members)
        for members in ({aspect.id for aspect in alike} for alike in classes)
    )
    if grasps:
        # The import of shapely is only needed here.
        from resting_aspects_ros.api.grasps import check_grasps

        check_grasps(grasps, placements_of(result.part, aspects), sorted(ids))
    rows = classes if by_class else [(aspect,) for aspect in aspects.aspects]
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
