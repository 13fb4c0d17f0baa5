"""The node that turns resting poses into distributions over aspects, and answers for them."""

import sys
from pathlib import Path

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    PartDescription,
    PartSummary,
    RestingPoses,
    Status,
)
from resting_aspects_interfaces.srv import GetDistribution, ListParts

from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.core.distribution import Distribution
from resting_aspects_ros.core.errors import RestingAspectsError, UnknownPartError
from resting_aspects_ros.core.stopping import drops_for
from resting_aspects_ros.drops.run import DEFAULT_SEED, MOST_DROPS, RunDescription, check_drops
from resting_aspects_ros.drops.surfaces import Surfaces
from resting_aspects_ros.nodes.convert import part_from, poses_from, status
from resting_aspects_ros.nodes.distribution_messages import distribution_msg
from resting_aspects_ros.nodes.drop_requests import DropRequests, DropSpec
from resting_aspects_ros.nodes.interface import (
    ASPECT_DISTRIBUTIONS,
    GET_DISTRIBUTION,
    LATCHED,
    LIST_PARTS,
    PARTS,
    POSES,
    RESTING_POSES,
    SERVICES,
)
from resting_aspects_ros.nodes.parameters import Parameter, declare
from resting_aspects_ros.nodes.requests import (
    NotAvailableError,
    asked_conditions,
    check_method,
    error_status,
)
from resting_aspects_ros.nodes.run_accounts import KnownDistributions, KnownParts, RunAccount
from resting_aspects_ros.nodes.run_tracker import RunProgress, RunTracker
from resting_aspects_ros.nodes.spin import run_node
from resting_aspects_ros.nodes.topic_watch import TopicWatch

PARAMETERS = (
    Parameter('surfaces_file', '', 'YAML file of named conditions; empty: the one of the suite'),
)
# Distributions of runs under way are published this often, s.
PUBLISH_PERIOD = 0.2
# Ends of so many runs are remembered, for requests that wait for them.
RUNS_KEPT = 10_000


class AspectClassifier(Node):
    """Subscribes to resting_poses and parts/*; publishes aspect_distributions/<part>.

    Serves get_distribution and list_parts.
    """

    def __init__(self) -> None:
        super().__init__('aspect_classifier')
        values = declare(self, PARAMETERS)
        self._surfaces = Surfaces.read(Path(values['surfaces_file'] or surfaces_file()))
        self._parts = KnownParts()
        self._known = KnownDistributions()
        self._accounts: dict[str, RunAccount] = {}  # of runs that are not over
        self._over: dict[str, Future] = {}  # run id -> done when the run is over
        self._changed: dict[str, RunAccount] = {}  # by part, to be published
        self._outputs: dict[str, Publisher] = {}
        self._tracker = RunTracker(self, self._run_over)
        self._requests = DropRequests(self, self._over_future)
        self._watch = TopicWatch(
            self, PARTS, PartDescription, self._part_described, gone=self._parts.remove
        )
        self.create_subscription(RestingPoses, RESTING_POSES, self._batch, POSES)
        self.create_timer(PUBLISH_PERIOD, self._publish_changed)
        self.create_service(
            GetDistribution,
            GET_DISTRIBUTION,
            self._get_distribution,
            qos_profile=SERVICES,
            # In the node's own group a request that waits would hold up everything it waits for.
            callback_group=ReentrantCallbackGroup(),
        )
        self.create_service(ListParts, LIST_PARTS, self._list_parts, qos_profile=SERVICES)
        self.get_logger().info('ready')

    def destroy_node(self) -> None:
        """Also ends its action clients."""
        self._tracker.destroy()
        self._requests.destroy()
        super().destroy_node()

    # Topics

    def _part_described(self, name: str, message: PartDescription) -> None:
        try:
            part = part_from(message)
        except RestingAspectsError as error:
            self.get_logger().error(f'the description of {name} cannot be used: {error}')
            return
        self._parts.describe(part)
        self._output(name)  # before the first run, so that who listens hears all of it
        for account in list(self._accounts.values()):
            if account.run.part == name:
                self._advance(account)

    def _batch(self, message: RestingPoses) -> None:
        try:
            arrivals = self._tracker.accept(message)
        except RestingAspectsError as error:
            self.get_logger().error(f'a batch of resting poses cannot be used: {error}')
            return
        poses = poses_from(message)
        for progress, new in arrivals:
            account = self._accounts.setdefault(progress.run.run_id, RunAccount(progress.run))
            account.waiting.extend(poses.between(first, end) for first, end in new)
            self._advance(account)
            self._tracker.settle(progress)

    def _run_over(self, progress: RunProgress) -> None:
        account = self._accounts.get(progress.run.run_id)
        if account is None:
            return
        account.over = True
        if progress.lost:
            account.problem = f'drops of run {progress.run.run_id} were lost and are not to be had'
        self._advance(account)

    def _advance(self, account: RunAccount) -> None:
        """Count what can be counted; end the account if its run is over."""
        run = account.run
        aspects = self._parts.aspects(run.part_sha256)
        if aspects is None:
            part = self._parts.get(run.part)
            if account.over and part is not None:
                # The description that is latched is of another version: this one is gone.
                account.problem = f'run {run.run_id} is of another version of {run.part}, ignored'
                self._end(account)
            return
        account.count(aspects)
        self._changed[run.part] = account
        if account.over:
            if not account.problem:
                self._known.add(run, account.counted)
            self._publish_changed()
            self._end(account)

    def _end(self, account: RunAccount) -> None:
        """Tell those who wait for it that a run is over."""
        del self._accounts[account.run.run_id]
        if account.problem:
            self.get_logger().warning(account.problem)
        self._over_future(account.run.run_id).set_result(account)

    def _publish_changed(self) -> None:
        changed, self._changed = self._changed, {}
        for part, account in changed.items():
            message = self._message(account.run, account.counted, account.over)
            self._output(part).publish(message)

    def _output(self, part: str) -> Publisher:
        if part not in self._outputs:
            topic = f'{ASPECT_DISTRIBUTIONS}/{part}'
            self._outputs[part] = self.create_publisher(AspectDistribution, topic, LATCHED)
        return self._outputs[part]

    def _message(
        self, run: RunDescription, distribution: Distribution, complete: bool
    ) -> AspectDistribution:
        return distribution_msg(distribution, run, self.get_clock().now().to_msg(), complete)

    def _over_future(self, run_id: str) -> Future:
        while len(self._over) > RUNS_KEPT:
            self._over.pop(next(iter(self._over)))
        return self._over.setdefault(run_id, Future())

    # Services

    async def _get_distribution(
        self, request: GetDistribution.Request, response: GetDistribution.Response
    ) -> GetDistribution.Response:
        try:
            run, distribution = await self._find_or_drop(request)
            response.distribution = self._message(run, distribution, True)
            response.status = status(Status.OK)
        except RestingAspectsError as error:
            response.status = error_status(error)
        except Exception as error:  # noqa: BLE001 - the edge: a defect must not stop the node
            self.get_logger().error(f'get_distribution failed: {error!r}')
            response.status = status(Status.FAILED, f'unexpected: {error!r}')
        return response

    async def _find_or_drop(
        self, request: GetDistribution.Request
    ) -> tuple[RunDescription, Distribution]:
        check_method(request.method)
        drops = request.drops
        if request.precision != 0:
            drops = drops_for(request.precision, drops or MOST_DROPS)
        check_drops(drops)
        conditions = asked_conditions(self._surfaces, request.surface, request.conditions)
        seed = request.seed[0] if request.seed else None
        # Without a simulator no part is offered; what is known of it is known still.
        there = self._requests.simulator_is_there()
        part = self._parts.get(request.part) if there else self._parts.last(request.part)
        if part is not None:
            known = self._known.find(part.part_sha256, conditions, drops, request.precision, seed)
            if known is not None:
                return known
        if request.only_known:
            raise self._nothing_known(request)
        spec = DropSpec(
            request.part,
            conditions,
            drops,
            request.precision,
            DEFAULT_SEED if seed is None else seed,
        )
        account = await self._requests.drop(spec)
        return account.run, account.counted

    def _nothing_known(self, request: GetDistribution.Request) -> RestingAspectsError:
        names = self._parts.names()
        if names and request.part not in names:
            return UnknownPartError(
                f'part {request.part!r} is not known, known are {", ".join(names)}'
            )
        return NotAvailableError(
            f'no distribution of {request.part} under these conditions over at least '
            f'{request.drops} drops is known, and only_known was asked for'
        )

    def _list_parts(
        self, _: ListParts.Request, response: ListParts.Response
    ) -> ListParts.Response:
        response.status = status(Status.OK)
        for name, sha in self._parts.offered():
            summary = PartSummary(name=name, part_sha256=sha, known=self._known.has(sha))
            response.parts.append(summary)
        return response


def main() -> int:
    """Run the node alone in this process."""
    return run_node(AspectClassifier, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
