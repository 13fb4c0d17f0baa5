"""The service get_distribution: known distributions, new drops, and estimators."""

from collections.abc import Mapping
from functools import lru_cache

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import AspectDistribution
from resting_aspects_interfaces.srv import GetDistribution

from resting_aspects_ros import __version__
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.nodes.aspect_classifier.model_ranges import ModelRanges
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry, requested_part
from resting_aspects_ros.nodes.aspect_classifier.tallies import Tallies, Tally
from resting_aspects_ros.nodes.drop_client import DropClient, drop_goal
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import wait_for
from resting_aspects_ros.ros.default_conditions import DefaultConditionsSubscriber
from resting_aspects_ros.ros.distribution_conversions import distribution_msg, estimate_msg
from resting_aspects_ros.ros.parameters import FRAME_ID, check_frame
from resting_aspects_ros.ros.requested_surroundings import RequestedSurroundings
from resting_aspects_ros.ros.status import NotAvailableError, requested_estimator
from resting_aspects_ros.simulation.conditions import DropConditions, Surfaces
from resting_aspects_ros.simulation.job import (
    DEFAULT_SEED,
    MAX_DROPS,
    RunDescription,
    check_drops,
)
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import max_drops

# Maximum number of known distributions that an error lists.
MAX_LISTED = 5
# Number of cached messages: creating a message takes as long as sending it, and the same one is
# often requested again.
MAX_MESSAGES = 100
# Interval at which a request checks the drops that another one has requested, s.
CHECK_PERIOD = 0.05
# Timeouts for messages with drops to arrive after the result of their goal, and for the part to be
# read that they need, s.
ARRIVAL_TIMEOUT = 5.0
COUNT_TIMEOUT = 120.0


class DistributionService:
    """Finds the distribution for a request."""

    def __init__(
        self,
        node: Node,
        surfaces: Surfaces,
        surroundings: RequestedSurroundings,
        default: DefaultConditionsSubscriber,
        tallies: Tallies,
        client: DropClient,
        parts: PartRegistry,
        ranges: ModelRanges,
    ) -> None:
        self._node = node
        self._ranges = ranges
        self._surfaces = surfaces
        self._surroundings = surroundings
        self._default = default
        self._tallies = tallies
        self._client = client
        self._parts = parts
        self._active: dict[tuple[object, ...], Future] = {}  # done when its drops have arrived
        self._frame = check_frame(node.get_parameter(FRAME_ID.name).value)

    async def answer(self, request: GetDistribution.Request) -> AspectDistribution:
        """Return the requested distribution; raises RestingAspectsError."""
        method = requested_estimator(request.method)
        if method is None:
            return await self._find_or_drop(request)
        offered = await self._usable(request.part)
        part, aspects = self._parts.version(requested_part(offered, request.part).part_sha256)
        prediction = estimate(RestingShape(part, aspects), method)
        return estimate_msg(prediction, part, self._node.get_clock().now().to_msg(), self._frame)

    async def _find_or_drop(self, request: GetDistribution.Request) -> AspectDistribution:
        drops = max_drops(request.drops, request.precision, MAX_DROPS)
        check_drops(drops)
        seed = request.seed[0] if request.seed else None
        parts = await self._usable(request.part)
        sha = self._version(parts, request.part)
        conditions = await self._conditions(request, sha)
        found = self._tallies.find(sha, conditions, drops, request.precision, seed)
        if found is None and request.only_known:
            if parts and not sha:
                requested_part(parts, request.part)
            raise self._not_known(request, sha)
        if found is None:
            await self._wait_for_simulator(request, sha)
            found = await self._extended(request, sha, conditions, drops)
        await self._ranges.add(found)
        return self._message(found)

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
            await wait_for(self._node, active, CHECK_PERIOD)
            known = self._tallies.find(sha, conditions, drops, request.precision, seed)
            if known is not None:
                return known
        self._active[key] = finished = Future(executor=self._node.executor)
        try:
            known = None
            if not request.precision:
                known = self._tallies.longest(sha, conditions, seed, __version__)
            found = await self._drop(request, conditions, seed, drops, known.end if known else 0)
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
        result = await self._client.drop(goal)
        goal.run_id, end = result.run_id, first + result.drops

        def missing() -> list[tuple[int, int]]:
            tally = self._tallies.by_run(result.run_id)
            return [(first, end)] if tally is None else tally.seen.missing(first, end)

        if not await self._client.arrived(lambda: not missing(), ARRIVAL_TIMEOUT):
            await self._client.request_again(goal, missing)
        tally = self._tallies.by_run(result.run_id)
        if tally is not None and await self._client.arrived(
            lambda: tally.distribution is not None and tally.end >= end, COUNT_TIMEOUT
        ):
            return tally
        reason = tally and self._parts.why_not(tally.run.part_sha256)
        raise EngineError(reason or f'the drops of run {result.run_id} could not be counted')

    async def _usable(self, name: str) -> dict[str, Part]:
        return await self._parts.usable(name, self._client.is_ready)

    async def _wait_for_simulator(self, request: GetDistribution.Request, sha: str) -> None:
        try:
            await self._client.wait_until_ready()
        except NotAvailableError as error:
            raise NotAvailableError(f'{error}{self._known_text(request, sha)}') from None

    async def _conditions(self, request: GetDistribution.Request, sha: str) -> DropConditions:
        if request.surface or request.conditions:
            default = self._surfaces.get()  # not used
        else:
            if not self._default.is_received:
                await self._wait_for_simulator(request, sha)
            default = await self._default.conditions()
        return await self._surroundings.conditions(self._surfaces, request, default)

    def _version(self, parts: Mapping[str, Part], name: str) -> str:
        """Return the part_sha256 that is offered, else the one dropped last; empty if none."""
        if name in parts:
            return parts[name].part_sha256
        if self._client.is_ready():
            return ''
        return self._tallies.sha_of(name) or ''

    def _message(self, tally: Tally) -> AspectDistribution:
        message = _message(tally.run, tally.counted, tally.complete, self._frame)
        message.header.stamp = self._node.get_clock().now().to_msg()
        return message

    def _not_known(self, request: GetDistribution.Request, sha: str) -> NotAvailableError:
        seed = request.seed[0] if request.seed else None
        with_seed = '' if seed is None else f' with seed {seed}'
        text = (
            f'no known distribution of {request.part} under these conditions{with_seed} has at '
            f'least {request.drops} drops'
        )
        return NotAvailableError(text + self._known_text(request, sha))

    def _known_text(self, request: GetDistribution.Request, sha: str) -> str:
        """Return the end of an error that lists the known distributions; empty without any."""
        seed = request.seed[0] if request.seed else None
        known = self._tallies.describe(request.part, sha, seed)
        if not known:
            return ''
        more = ', ...' if len(known) > MAX_LISTED else ''
        return f'; known distributions: {", ".join(known[:MAX_LISTED])}{more}'


@lru_cache(MAX_MESSAGES)
def _message(
    run: RunDescription, distribution: Distribution, complete: bool, frame: str
) -> AspectDistribution:
    return distribution_msg(distribution, run, Time(), complete, frame)
