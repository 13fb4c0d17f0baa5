"""The service get_distribution: known distributions, new drops, and estimators."""

from collections.abc import Mapping
from functools import lru_cache

from builtin_interfaces.msg import Time
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import AspectDistribution
from resting_aspects_interfaces.srv import GetDistribution

from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.nodes.aspect_classifier.distribution_store import DistributionStore
from resting_aspects_ros.nodes.aspect_classifier.drop_part_requests import DropRequests
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry, requested_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import conditions_msg
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


class DistributionService:
    """Finds the distribution for a request."""

    def __init__(
        self,
        node: Node,
        surfaces: Surfaces,
        surroundings: RequestedSurroundings,
        default: DefaultConditionsSubscriber,
        known: DistributionStore,
        requests: DropRequests,
        parts: PartRegistry,
    ) -> None:
        self._node = node
        self._surfaces = surfaces
        self._surroundings = surroundings
        self._default = default
        self._known = known
        self._requests = requests
        self._parts = parts
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
        known = self._known.find(sha, conditions, drops, request.precision, seed)
        if known is not None:
            return self._message(*known)
        if request.only_known:
            if parts and not sha:
                requested_part(parts, request.part)
            raise self._not_known(request, sha)
        await self._wait_for_simulator(request, sha)
        seed = DEFAULT_SEED if seed is None else seed
        goal = DropPart.Goal(
            part=request.part,
            surface=conditions.surface,
            conditions=[conditions_msg(conditions)],
            drops=drops,
            precision=request.precision,
            seed=seed,
        )
        counts = await self._requests.drop(goal)
        return self._message(counts.run, counts.counted)

    async def _usable(self, name: str) -> dict[str, Part]:
        return await self._parts.usable(name, self._requests.simulator_is_ready)

    async def _wait_for_simulator(self, request: GetDistribution.Request, sha: str) -> None:
        try:
            await self._requests.wait_for_simulator()
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
        if self._requests.simulator_is_ready():
            return ''
        return self._known.sha_of(name) or ''

    def _message(self, run: RunDescription, distribution: Distribution) -> AspectDistribution:
        message = _message(run, distribution, self._frame)
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
        known = self._known.describe(request.part, sha, seed)
        if not known:
            return ''
        more = ', ...' if len(known) > MAX_LISTED else ''
        return f'; known distributions: {", ".join(known[:MAX_LISTED])}{more}'


@lru_cache(MAX_MESSAGES)
def _message(run: RunDescription, distribution: Distribution, frame: str) -> AspectDistribution:
    return distribution_msg(distribution, run, Time(), True, frame)
