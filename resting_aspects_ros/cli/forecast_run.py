"""What `resting_aspects forecast` is asked for, and the simulations that answer it."""

import argparse
import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from resting_aspects_ros.api.forecast import (
    DEFAULT_ACTION,
    IMAGE,
    ROBOT,
    check_tray,
    cycle_times,
    forecast_from,
    pickable_aspects,
)
from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.look_alike_notes import divided_class_texts
from resting_aspects_ros.api.plan_actions import PlannedActions, plan_actions
from resting_aspects_ros.api.reorient import drop_for_start, make_actions
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.cli.action_options import requested_actions
from resting_aspects_ros.cli.forecast_options import (
    parse_gripper,
    parse_numbers,
    parse_tray,
    requested_time,
)
from resting_aspects_ros.cli.options import requested_conditions
from resting_aspects_ros.cli.values import parse_quantity
from resting_aspects_ros.errors import InvalidValueError, warn
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.forecast import check_minutes, check_number
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import check_drops
from resting_aspects_ros.simulation.workers import Workers

if TYPE_CHECKING:
    from resting_aspects_ros.vision.grasp import Grasp


@dataclass(frozen=True)
class RequestedForecasts:
    """Forecasts that were requested.

    pickable : tuple
        For each part the sets of ids of pickable aspects.
    controller : bool
        Whether runs with feeder_controller are forecast, too.
    """

    parts: tuple[Part, ...]
    planned: tuple[PlannedActions, ...]
    pickable: tuple[tuple[tuple[int, ...], ...], ...]
    conditions: DropConditions
    drops: int
    seed: int
    tray: Tray
    times: CycleTimes
    parts_on_tray: int | None
    max_picks: int | None
    minutes: float
    grasps: 'tuple[Grasp, ...]'
    controller: bool


def requested_forecasts(arguments: argparse.Namespace, confidence: float) -> RequestedForecasts:
    """Return what the flags request; raises RestingAspectsError for wrong input."""
    arguments.action = arguments.action or DEFAULT_ACTION
    actions = requested_actions(arguments)
    if len(actions) > 1:
        raise InvalidValueError(f'invalid --action {arguments.action!r}: expected a single action')
    times = requested_times(arguments, actions[0])
    gripper = None if arguments.gripper is None else parse_gripper(arguments.gripper)
    clearance = parse_quantity('--clearance', arguments.clearance, 'm')
    tray = Tray(parse_tray(arguments.tray), clearance, gripper)
    minutes = parse_quantity('--minutes', arguments.minutes, '')
    check_minutes(minutes)
    if arguments.max_picks is not None:
        check_number('maximum number of picks', arguments.max_picks)
    check_drops(arguments.drops)
    conditions = requested_conditions(arguments)
    sets = _sets(arguments)
    grasps: tuple[Grasp, ...] = ()
    if arguments.grasps is not None:
        grasps = _grasps(arguments)
    parts, planned, pickable = [], [], []
    for number, name in enumerate(arguments.part):
        part = load_part(name, arguments.unit, arguments.parts, arguments.body)
        for warning in part.warnings:
            warn(warning)
        plan = plan_actions(
            part,
            actions[0],
            conditions,
            per_aspect=arguments.per_aspect,
            seed=arguments.seed,
            confidence=confidence,
            landscape=Landscape(part),
        )
        aspects = plan.counter.matrix.aspects
        check_tray(part, aspects, tray, arguments.parts_on_tray)
        ids = [pickable_aspects(aspects, *each) for each in sets[number]]
        if grasps:
            from resting_aspects_ros.api.forecast import placements_of
            from resting_aspects_ros.api.grasps import check_grasps

            for each in ids:
                check_grasps(grasps, placements_of(part, aspects), each)
        divided = dict.fromkeys(
            text for each in ids for text in divided_class_texts(aspects, each)
        )
        if divided and arguments.controller:
            raise InvalidValueError(
                'invalid --pickable: expected whole symmetry classes with --controller '
                '(--pickable-classes); the aspects of a class look the same to the camera'
            )
        for text in divided:
            warn(f'{part.name}: {text}; --pickable-classes requests whole classes')
        parts.append(part)
        planned.append(plan)
        pickable.append(tuple(ids))
    return RequestedForecasts(
        tuple(parts),
        tuple(planned),
        tuple(pickable),
        conditions,
        arguments.drops,
        arguments.seed,
        tray,
        times,
        arguments.parts_on_tray,
        arguments.max_picks,
        minutes,
        grasps,
        arguments.controller,
    )


def requested_times(arguments: argparse.Namespace, action: NamedAction) -> CycleTimes:
    """Return the times of a cycle with an action; raises InvalidValueError."""
    robot, image = (requested_time(arguments, name) for name in ('robot', 'image'))
    return cycle_times(
        action,
        robot=ROBOT if robot is None else robot,
        vibrate=requested_time(arguments, 'vibrate'),
        settle=requested_time(arguments, 'settle'),
        image=IMAGE if image is None else image,
        supply=requested_time(arguments, 'supply') or 0.0,
        overlap=arguments.overlap,
        place=requested_time(arguments, 'place'),
    )


def make_forecasts(
    requested: RequestedForecasts, workers: Workers, stopped: Callable[[], bool]
) -> list[ForecastResult]:
    """Simulate drops and actions, and return the forecasts; none if it was interrupted."""
    results = []
    for part, planned, sets in zip(
        requested.parts, requested.planned, requested.pickable, strict=True
    ):
        dropped, _ = drop_for_start(
            part,
            requested.conditions,
            requested.drops,
            requested.seed,
            workers,
            shown=True,
            stopped=stopped,
        )
        found = make_actions(
            planned, part, dropped, workers, check=False, shown=True, stopped=stopped
        )
        if stopped():
            return []
        made = [
            forecast_from(
                found,
                ids,
                requested.tray,
                requested.times,
                parts_on_tray=requested.parts_on_tray,
                max_picks=requested.max_picks,
                minutes=requested.minutes,
                grasps=requested.grasps,
            )
            for ids in sets
        ]
        for each in made:
            if stopped():
                return []
            if requested.controller:
                # The import of shapely is only needed here.
                from resting_aspects_ros.api.forecast import forecast_controlled

                results.append(dataclasses.replace(each, controlled=forecast_controlled(each)))
            else:
                results.append(each)
    return results


def _grasps(arguments: argparse.Namespace) -> 'tuple[Grasp, ...]':
    """Return the grasps of --grasps; raises InvalidValueError."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.api.grasps import load_grasps

    if arguments.gripper is not None:
        raise InvalidValueError('invalid --gripper: expected none with --grasps')
    if len(arguments.part) > 1:
        raise InvalidValueError('invalid --grasps: expected a single part')
    return load_grasps(arguments.grasps)


_Sets = list[tuple[tuple[int, ...] | None, tuple[int, ...] | None]]


def _sets(arguments: argparse.Namespace) -> list[_Sets]:
    """Return for each part the requested sets of ids or of numbers of classes."""
    by_id = arguments.pickable is not None
    flag = '--pickable' if by_id else '--pickable-classes'
    texts = arguments.pickable if by_id else arguments.pickable_classes
    numbers = [parse_numbers(flag, text) for text in texts]
    sets: _Sets = [(each, None) if by_id else (None, each) for each in numbers]
    parts = len(arguments.part)
    if parts == 1 or len(sets) == 1:
        return [sets] * parts
    if len(sets) != parts:
        raise InvalidValueError(
            f'invalid {flag}: {len(sets)} sets for {parts} parts: expected one set, or one for '
            'each part'
        )
    return [[each] for each in sets]
