"""Forecast the parts per minute of a feeder with feeder_controller, by simulated runs."""

from functools import partial

from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.forecast_setup import placements_of
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.feeding.controlled_runs import ControlledRuns, forecast_controller
from resting_aspects_ros.core.feeding.controller_model import controller_model
from resting_aspects_ros.core.vision.outline_places import OutlinePlaces


def forecast_controlled(result: ForecastResult, minutes: float | None = None) -> ControlledRuns:
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
