"""The services get_distribution, classify_pose and forecast."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import AspectDistribution, TransitionMatrix
from resting_aspects_interfaces.srv import ClassifyPose, FeederForecast, GetDistribution

from resting_aspects_ros import __version__
from resting_aspects_ros.api.forecast import (
    cycle_times,
    forecast_from,
    with_live_counts,
)
from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import POSE_ANGLE, AspectSet, unit_orientation
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.errors import EngineError, InvalidValueError
from resting_aspects_ros.feeding.footprint import Footprint, Tray
from resting_aspects_ros.nodes.aspect_classifier.counting import ModelRanges, Tallies, Tally
from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry, TransitionStore
from resting_aspects_ros.nodes.aspect_classifier.live import LiveMonitor
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import wait_for
from resting_aspects_ros.ros.conversions import run_from
from resting_aspects_ros.ros.distribution_conversions import (
    action_from,
    distribution_msg,
    estimate_msg,
    transition_matrix_from,
)
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.goal_client import DropClient, drop_goal
from resting_aspects_ros.ros.interface import FORECAST, GET_DISTRIBUTION
from resting_aspects_ros.ros.program import FRAME_ID, check_frame
from resting_aspects_ros.ros.requests import (
    BusyError,
    DefaultConditionsSubscriber,
    NotAvailableError,
    RequestedSurroundings,
    requested_estimator,
    serve,
    unknown_part,
)
from resting_aspects_ros.rotations import down_in_part
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    MAX_DROPS,
    DropConditions,
    Surfaces,
    check_drops,
)
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.counted_parts import LiveCounts
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import max_drops

# Number of cached messages: creating a message takes as long as sending it, and the same one is
# often requested again.
MAX_MESSAGES = 100
# Interval at which a request checks the drops that another one has requested, s.
CHECK_PERIOD = 0.05
# Timeouts for messages with drops to arrive after the result of their goal, and for the part to be
# read that they need, s.
ARRIVAL_TIMEOUT = 5.0
COUNT_TIMEOUT = 120.0


@dataclass(eq=False)
class DistributionService:
    """Serves get_distribution."""

    node: Node
    surfaces: Surfaces
    surroundings: RequestedSurroundings
    default: DefaultConditionsSubscriber
    tallies: Tallies
    client: DropClient
    parts: PartRegistry
    ranges: ModelRanges

    def __post_init__(self) -> None:
        self._active: dict[tuple[object, ...], Future] = {}  # done when its drops have arrived
        self._frame = check_frame(self.node.get_parameter(FRAME_ID.name).value)
        serve(self.node, GetDistribution, GET_DISTRIBUTION, self._answer)

    async def _answer(
        self, request: GetDistribution.Request, response: GetDistribution.Response
    ) -> None:
        stamp = self.node.get_clock().now().to_msg
        method = requested_estimator(request.method)
        if method is None:
            tally = await self._find_or_drop(request)
            found = _message(tally.run, tally.counted, tally.complete, self._frame)
            found.header.stamp = stamp()
            response.distribution = found
            return
        requested = await self.parts.requested(request.part)
        part, aspects = self.parts.version(requested.part_sha256)
        prediction = estimate(RestingShape(part, aspects), method)
        response.distribution = estimate_msg(prediction, part, stamp(), self._frame)

    async def _find_or_drop(self, request: GetDistribution.Request) -> Tally:
        """Return a tally that matches a request, dropped first if none is known."""
        drops = max_drops(request.drops, request.precision, MAX_DROPS)
        check_drops(drops)
        seed = request.seed[0] if request.seed else None
        parts = await self.parts.usable(request.part)
        sha = self._version(parts, request.part)
        conditions = await self._conditions(request)
        found = self.tallies.find(sha, conditions, drops, request.precision, seed)
        if found is None and request.only_known:
            if parts and not sha:
                raise unknown_part(request.part, parts)
            with_seed = '' if seed is None else f' with seed {seed}'
            is_other = self.tallies.sha_of(request.part) not in ('', sha)
            other = '; its last run was that of another version of the part' if is_other else ''
            raise NotAvailableError(
                f'no known distribution of {request.part} under these conditions{with_seed} has '
                f'at least {request.drops} drops{other}'
            )
        if found is None:
            await self.client.wait_until_ready()
            found = await self._extended(request, sha, conditions, drops)
        await self.ranges.add(found)
        return found

    async def _extended(
        self, request: GetDistribution.Request, sha: str, conditions: DropConditions, drops: int
    ) -> Tally:
        """Return a tally that matches a request, after the missing drops have been made.

        Only one goal of a part, conditions and seed is active: what another request has made
        meanwhile is extended.
        """
        seed = request.seed[0] if request.seed else DEFAULT_SEED
        key = request.part, conditions.key(), seed
        while (active := self._active.get(key)) is not None:
            await wait_for(self.node, active, CHECK_PERIOD)
            known = self.tallies.find(sha, conditions, drops, request.precision, seed)
            if known is not None:
                return known
        self._active[key] = finished = Future(executor=self.node.executor)
        try:
            first = 0
            known = self.tallies.find(sha, conditions, 1, 0.0, seed)
            if known and not request.precision and known.run.suite_version == __version__:
                first = known.end
            found = await self._drop(request, conditions, seed, drops, first)
            if not (request.precision or found.reaches(drops, 0.0)):
                # The simulator has another version, whose drops do not continue those known.
                found = await self._drop(request, conditions, seed, drops, 0)
            return found
        finally:
            del self._active[key]
            finished.set_result(None)

    async def _drop(
        self,
        request: GetDistribution.Request,
        conditions: DropConditions,
        seed: int,
        drops: int,
        first: int,
    ) -> Tally:
        """Return the tally with new drops, from the index ``first`` on, after they are counted."""
        goal = drop_goal(
            request.part,
            conditions,
            seed,
            first_drop=first,
            drops=drops - first,
            precision=request.precision,
        )
        result = await self.client.drop(goal)
        goal.run_id, end = result.run_id, first + result.drops

        def missing() -> list[tuple[int, int]]:
            tally = self.tallies.by_run(result.run_id)
            return [(first, end)] if tally is None else tally.seen.missing(first, end)

        if not await self.client.arrived(lambda: not missing(), ARRIVAL_TIMEOUT):
            await self.client.request_again(goal, missing)
        tally = self.tallies.by_run(result.run_id)
        if tally is not None and await self.client.arrived(
            lambda: tally.distribution is not None and tally.end >= end, COUNT_TIMEOUT
        ):
            return tally
        reason = self.parts.problem(request.part)
        raise EngineError(reason or f'the drops of run {result.run_id} could not be counted')

    async def _conditions(self, request: GetDistribution.Request) -> DropConditions:
        if request.surface or request.conditions:
            default = self.surfaces.get()  # not used
        else:
            if not self.default.is_received:
                await self.client.wait_until_ready()
            default = await self.default.conditions()
        return await self.surroundings.conditions(self.surfaces, request, default)

    def _version(self, parts: Mapping[str, Part], name: str) -> str:
        """Return the part_sha256 that is offered, else the one dropped last; empty if none."""
        if name in parts:
            return parts[name].part_sha256
        if self.client.is_ready():
            return ''
        return self.tallies.sha_of(name)


@lru_cache(MAX_MESSAGES)
def _message(
    run: RunDescription, distribution: Distribution, complete: bool, frame: str
) -> AspectDistribution:
    return distribution_msg(distribution, run, Time(), complete, frame)


def answer_pose(
    request: ClassifyPose.Request,
    response: ClassifyPose.Response,
    aspects: AspectSet,
    newest: Distribution | None,
) -> None:
    """Fill in the response; unknown values stay NaN.

    Raises InvalidValueError if the orientation is not a unit quaternion, and NotAvailableError if
    no aspect matches; the response then contains the angle to the nearest one.

    aspects : of the requested part
    newest : distribution that provides the probability
    """
    quaternion = request.orientation
    orientation = unit_orientation([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    ids, angles = aspects.locate(down_in_part(orientation[None]))
    response.angle = angle = float(angles[0])
    if not len(aspects):
        raise NotAvailableError(f'part {request.part!r} has no aspect')
    nearest = aspects[int(ids[0]) - 1]
    if not angle <= POSE_ANGLE:
        raise NotAvailableError(
            f'no aspect of {request.part} matches the orientation: the nearest is aspect '
            f'{nearest.id} at {np.degrees(angle):.6g} degrees, expected at most '
            f'{np.degrees(POSE_ANGLE):g}'
        )
    response.aspect = nearest.id
    response.symmetry_class = nearest.symmetry_class
    if newest is not None:
        response.probability = newest.intervals()[nearest.id - 1].probability


# Maximum number of requests that wait; each takes about a second.
MAX_WAITING = 20

Live = tuple[LiveCounts, Counts | None]


@dataclass(eq=False)
class ForecastService:
    """Serves forecast.

    worker : computes, so that a forecast does not block the node
    """

    node: Node
    parts: PartRegistry
    transitions: TransitionStore
    monitor: LiveMonitor
    worker: FileWorker

    def __post_init__(self) -> None:
        self._waiting = 0
        serve(self.node, FeederForecast, FORECAST, self._forecast)

    async def _forecast(
        self, request: FeederForecast.Request, response: FeederForecast.Response
    ) -> None:
        if self._waiting >= MAX_WAITING:
            raise BusyError(f'{MAX_WAITING} forecasts are being computed, try again soon')
        self._waiting += 1
        try:
            fields = await self._answer(request)
        finally:
            self._waiting -= 1
        for name, value in fields.items():
            setattr(response, name, value)

    async def _answer(self, request: FeederForecast.Request) -> dict[str, Any]:
        """Return the fields of the response; raises RestingAspectsError."""
        matrix = await self.transitions.newest(request.part, request.action)
        if self.parts.aspects(matrix.run.part_sha256) is None:
            raise NotAvailableError(
                f'the version of {request.part} whose transitions are known is not offered'
            )
        part, _ = self.parts.version(matrix.run.part_sha256)
        live: Live | None = None
        if request.use_counts:
            counted = self.monitor.counts(part)
            if counted is None:
                raise NotAvailableError(f'no counts of {request.part} have arrived')
            live = counted[0], counted[1].get(matrix.action.name)
        found = await self.worker.run(response_fields, request, part, matrix, live)
        return {**found, 'counted_parts': live[0].parts if live else 0}


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
    pickable = result.drop.aspects.chosen(ids or None, classes or None, 'pickable')
    if live is not None:
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
