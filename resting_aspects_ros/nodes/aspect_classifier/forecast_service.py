"""The service forecast: parts per minute of a feeder, from known drops and transitions."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node
from resting_aspects_interfaces.msg import Status, TransitionMatrix
from resting_aspects_interfaces.srv import FeederForecast, GetTransitions

from resting_aspects_ros.api.forecast import (
    cycle_times,
    forecast_from,
    pickable_aspects,
    with_live_counts,
)
from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.footprint import Footprint, Tray
from resting_aspects_ros.nodes.aspect_classifier.live import LiveMonitor
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.nodes.aspect_classifier.transition_store import TransitionStore
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import serve
from resting_aspects_ros.ros.conversions import run_from, status
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import FORECAST
from resting_aspects_ros.ros.status import BusyError, NotAvailableError, status_from_errors
from resting_aspects_ros.ros.transition_conversions import action_from, transition_matrix_from
from resting_aspects_ros.statistics.counted_parts import LiveCounts
from resting_aspects_ros.statistics.distribution import Distribution

# Maximum number of requests that wait; each takes about a second.
MAX_WAITING = 20

Live = tuple[LiveCounts, Counts | None]


class ForecastService:
    """Serves forecast.

    Parameters
    ----------
    monitor : the parts counted on the machine
    worker : computes, so that a forecast does not block the node
    check_ready : raises NotAvailableError while the node is not ready
    simulator_is_ready : returns whether a simulator offers parts
    """

    def __init__(
        self,
        node: Node,
        parts: PartRegistry,
        transitions: TransitionStore,
        monitor: LiveMonitor,
        worker: FileWorker,
        check_ready: Callable[[], None],
        simulator_is_ready: Callable[[], bool],
    ) -> None:
        self._node = node
        self._parts = parts
        self._transitions = transitions
        self._monitor = monitor
        self._worker = worker
        self._check_ready = check_ready
        self._simulator_is_ready = simulator_is_ready
        self._waiting = 0
        serve(node, FeederForecast, FORECAST, self._forecast)

    async def _forecast(
        self, request: FeederForecast.Request, response: FeederForecast.Response
    ) -> FeederForecast.Response:
        for name, kind in response.get_fields_and_field_types().items():
            if kind == 'double':
                setattr(response, name, math.nan)
        with status_from_errors(FORECAST, response, self._node.get_logger().error):
            self._check_ready()
            if self._waiting >= MAX_WAITING:
                raise BusyError(f'{MAX_WAITING} forecasts are being computed, try again soon')
            self._waiting += 1
            try:
                fields = await self._answer(request)
            finally:
                self._waiting -= 1
            for name, value in fields.items():
                setattr(response, name, value)
            response.status = status(Status.OK)
        return response

    async def _answer(self, request: FeederForecast.Request) -> dict[str, Any]:
        """Return the fields of the response; raises RestingAspectsError."""
        asked = GetTransitions.Request(part=request.part, action=request.action)
        matrix = await self._transitions.answer(asked, self._simulator_is_ready)
        part_sha256 = matrix.run.part_sha256
        if self._parts.aspects(part_sha256) is None:
            raise NotAvailableError(
                f'the version of {request.part} whose transitions are known is not offered'
            )
        part, _ = self._parts.version(part_sha256)
        live = self._live(request, part_sha256, matrix) if request.use_counts else None
        found = await self._worker.run(response_fields, request, part, matrix, live)
        return {**found, 'counted_parts': live[0].parts if live else 0}

    def _live(
        self, request: FeederForecast.Request, part_sha256: str, matrix: TransitionMatrix
    ) -> Live:
        """Return the parts counted on the machine; raises NotAvailableError without any."""
        found = self._monitor.counts(request.part, part_sha256)
        if found is None:
            raise NotAvailableError(f'no counts of {request.part} have arrived')
        return found[0], found[1].get(matrix.action.name)


def response_fields(
    request: FeederForecast.Request, part: Part, matrix: TransitionMatrix, live: Live | None
) -> dict[str, Any]:
    """Return the fields of the response to a request; runs in a FileWorker.

    Raises InvalidValueError if a value of the request is invalid.
    """
    result = reorientation_from(matrix, part)
    ids, classes = list(request.aspects), list(request.classes)
    if bool(ids) == bool(classes):
        raise InvalidValueError('invalid pickable aspects: expected either aspects or classes')
    pickable = pickable_aspects(result.drop.aspects, ids or None, classes or None)
    if live is not None:
        for members in result.drop.aspects.classes():
            if 0 < len({each.id for each in members} & set(pickable)) < len(members):
                raise InvalidValueError(
                    f'invalid aspects {ids}: expected whole symmetry classes with use_counts, '
                    'because parts are counted by class'
                )
        result = with_live_counts(result, *live)
    times = cycle_times(
        result.action,
        robot=request.robot_time,
        vibrate=_given(request.vibrate_time),
        settle=_given(request.settle_time),
        image=request.image_time,
        supply=request.supply_time,
        overlap=request.overlap,
        place=_given(request.place_time),
    )
    width, depth = (float(side) for side in request.tray)
    found = forecast_from(
        result,
        pickable,
        Tray((width, depth), request.clearance, _gripper(list(request.gripper))),
        times,
        parts_on_tray=request.parts_on_tray or None,
        max_picks=request.max_picks or None,
        minutes=request.minutes,
    )
    return {**_fields(found), 'drops': matrix.drops, 'actions': sum(matrix.actions)}


def reorientation_from(message: TransitionMatrix, part: Part) -> ReorientResult:
    """Return the result in a message on transitions/<part>; raises InvalidValueError."""
    matrix = transition_matrix_from(message)
    counts = np.array([each.count for each in message.aspects], dtype=np.int64)
    others = message.drops - int(counts.sum())
    drop = Distribution(matrix.aspects, counts, others, 0, 0)
    action, run = action_from(message.action), run_from(message.run)
    return ReorientResult(matrix, action, run, part, drop, complete=message.complete)


def _fields(result: ForecastResult) -> dict[str, Any]:
    found, document = result.named.forecast, result.document()
    times = list(found.sensitivity)
    lower, upper = found.prediction
    same = (
        *('sentence', 'parts_per_minute', 'lower', 'upper', 'parts_on_tray', 'empty_cycles'),
        *('best_number_is_limit', 'picks_per_cycle', 'supplied_per_cycle', 'cycle_time'),
        'coverage',
    )
    return {
        **{name: document[name] for name in same},
        'prediction_lower': lower,
        'prediction_upper': upper,
        'best_number': found.best_number or 0,
        'flips_per_part': found.flips_per_part,
        'limited_by': found.limited_by or '',
        'times': times,
        'shorter': [found.sensitivity[name][0] for name in times],
        'longer': [found.sensitivity[name][1] for name in times],
        'run_id': result.reorientation.run.run_id,
    }


def _given(seconds: float) -> float | None:
    return None if seconds < 0 else seconds


def _gripper(sides: list[float]) -> Footprint | None:
    """Return the footprint of a gripper; raises InvalidValueError."""
    if not sides:
        return None
    if len(sides) > 2 or not all(0 < side < math.inf for side in sides):
        raise InvalidValueError(
            f'invalid gripper {sides}: expected length and width, or a diameter, m'
        )
    return Footprint(0.0, 0.0, sides[0] / 2) if len(sides) == 1 else Footprint(sides[0], sides[1])
