"""The node that turns resting poses into distributions over aspects, and answers for them."""

import sys
from functools import partial
from pathlib import Path

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import PartDescription, PartSummary, RestingPoses, Status
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution, ListParts

from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.drops.surfaces import Surfaces
from resting_aspects_ros.nodes.callbacks import subscribe
from resting_aspects_ros.nodes.convert import (
    check_description,
    part_from,
    poses_from,
    status,
)
from resting_aspects_ros.nodes.default_conditions import SURFACE, FollowedDefault
from resting_aspects_ros.nodes.diagnostics import Diagnosis, Meter, publish_diagnostics
from resting_aspects_ros.nodes.distribution_answers import DistributionAnswers
from resting_aspects_ros.nodes.distribution_outputs import PUBLISH_PERIOD, DistributionOutputs
from resting_aspects_ros.nodes.drop_requests import DropRequests, DropSpec
from resting_aspects_ros.nodes.earlier_runs import EarlierRuns
from resting_aspects_ros.nodes.interface import (
    ASPECT_CLASSIFIER,
    CLASSIFY_POSE,
    GET_DISTRIBUTION,
    LIST_PARTS,
    PARTS,
    POSES,
    RESTING_POSES,
    SERVICES,
)
from resting_aspects_ros.nodes.known_parts import KnownParts
from resting_aspects_ros.nodes.memory import Memory
from resting_aspects_ros.nodes.parameters import Parameter, declare
from resting_aspects_ros.nodes.part_lookup import PartLookup
from resting_aspects_ros.nodes.pose_answers import answer_pose
from resting_aspects_ros.nodes.presence import Alone
from resting_aspects_ros.nodes.requests import (
    answering,
)
from resting_aspects_ros.nodes.run_accounts import (
    KnownDistributions,
    RunAccount,
    find_under_way,
    newest_distribution,
)
from resting_aspects_ros.nodes.run_health import RunHealth
from resting_aspects_ros.nodes.run_tracker import RunProgress, RunTracker
from resting_aspects_ros.nodes.spin import run_node
from resting_aspects_ros.nodes.topic_watch import TopicWatch

PARAMETERS = (
    Parameter('surfaces_file', '', 'YAML file of named conditions; empty: the one of the suite'),
    SURFACE,
    PUBLISH_PERIOD,
    Parameter(
        'log_folder',
        'out/logs',
        'folder of the logs in which earlier runs are looked for; empty: none are',
    ),
)
# While parts come in, one that is asked for is looked for this often, s.
PARTS_PERIOD = 0.1
# Ends of so many runs are remembered, for requests that wait for them.
RUNS_KEPT = 10_000


class AspectClassifier(Node):
    """Subscribes to resting_poses, parts/* and default_conditions.

    Publishes aspect_distributions/<part>, markers and current_poses.
    Serves get_distribution, classify_pose and list_parts.
    """

    def __init__(self) -> None:
        super().__init__(ASPECT_CLASSIFIER)
        values = declare(self, PARAMETERS)
        surfaces = Surfaces.read(Path(values['surfaces_file'] or surfaces_file()))
        self._parts = KnownParts()
        self._known = KnownDistributions(self._parts.aspects)
        self._accounts: dict[str, RunAccount] = {}  # of runs that are not over
        self._over: dict[str, Future] = {}  # run id -> done when the run is over
        self._outputs = DistributionOutputs(self, self._parts)
        self._tracker = RunTracker(self, self._run_over, self._is_known)
        self._health = RunHealth(self, self._tracker)
        self._earlier = EarlierRuns(self)
        self._requests = DropRequests(
            self,
            self._over_future,
            self._under_way,
            self._tracker.look_after,
            self._earlier,
        )
        self._memory = Memory(
            self,
            Path(values['log_folder']) if values['log_folder'] else None,
            self._known,
            self._remember,
        )
        self._lookup = PartLookup(self, self._parts, self._requests.simulator_is_there)
        self._answers = DistributionAnswers(
            self,
            surfaces,
            FollowedDefault(self, surfaces),
            self._known,
            self._memory,
            self._requests,
            self._lookup,
        )
        self._drops = Meter()
        self._watch = TopicWatch(
            self, PARTS, PartDescription, self._part_described, gone=self._parts.remove
        )
        subscribe(self, RestingPoses, RESTING_POSES, self._batch, POSES)
        # In the node's own group a request that waits would hold up everything it waits for.
        serve = partial(
            self.create_service, qos_profile=SERVICES, callback_group=ReentrantCallbackGroup()
        )
        serve(GetDistribution, GET_DISTRIBUTION, self._get_distribution)
        serve(ClassifyPose, CLASSIFY_POSE, self._classify_pose)
        self.create_service(ListParts, LIST_PARTS, self._list_parts, qos_profile=SERVICES)
        publish_diagnostics(self, self._diagnose, Alone(self, ASPECT_CLASSIFIER))
        self.get_logger().info('ready')

    def destroy_node(self) -> None:
        """Also ends its action clients."""
        self._tracker.destroy()
        self._requests.destroy()
        super().destroy_node()

    # Topics

    def _part_described(self, name: str, message: PartDescription) -> None:
        check_description(message, name)
        part = part_from(message)
        self._parts.describe(part)
        for run in self._known.check(part.part_sha256):
            self.get_logger().warning(
                f'the log of run {run.run_id} is not used: it counts other aspects than {name} has'
            )
        self._outputs.offer(name)  # before the first run, so that who listens hears all of it
        self._show_known(part.part_sha256)
        for account in list(self._accounts.values()):
            if account.run.part == name:
                self._advance(account)

    def _remember(self) -> None:
        """All logs of earlier runs are read."""
        for _, part_sha256 in self._parts.offered():
            self._show_known(part_sha256)

    def _show_known(self, part_sha256: str) -> None:
        """Publish what an earlier run found, unless something newer was."""
        known = self._known.newest(part_sha256)
        if known is not None and not self._memory.loading:
            self._outputs.restore(*known)

    def _batch(self, message: RestingPoses) -> None:
        poses = poses_from(message)
        self._earlier.hear()
        arrivals = self._tracker.accept(message)
        self._outputs.poses.take(message.run.run_id, poses, message.header.stamp)
        for progress, new in arrivals:
            account = self._accounts.setdefault(progress.run.run_id, RunAccount(progress.run))
            account.waiting.extend(poses.between(first, end) for first, end in new)
            self._drops.add(sum(end - first for first, end in new))
            self._advance(account)
            self._tracker.settle(progress)

    def _is_known(self, run: RunDescription) -> bool | None:
        """Whether all of a run is known from its log; None while the logs are read."""
        return None if self._memory.loading else self._known.has_all(run)

    def _run_over(self, progress: RunProgress) -> None:
        account = self._accounts.get(progress.run.run_id)
        if account is None:
            return
        if not (progress.complete or progress.lost):
            del self._accounts[progress.run.run_id]  # it is known, and nobody waits for it
            return
        account.over = True
        if progress.lost:
            account.problem, account.gap = progress.loss, not progress.broken_off
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
                self.get_logger().warning(account.problem)
                self._end(account)
            return
        account.count(aspects)
        self._outputs.change(account)
        if account.over:
            if not account.gap:  # the first m of n drops are the run of m
                self._known.add(run, account.counted)
            self._outputs.publish()
            self._end(account)

    def _end(self, account: RunAccount) -> None:
        """Tell those who wait for it that a run is over."""
        del self._accounts[account.run.run_id]
        self._over_future(account.run.run_id).set_result(account)

    def _over_future(self, run_id: str) -> Future:
        while len(self._over) > RUNS_KEPT:
            self._over.pop(next(iter(self._over)))
        return self._over.setdefault(run_id, Future())

    def _under_way(self, spec: DropSpec) -> RunAccount | None:
        part = self._parts.get(spec.part)
        if part is None:
            return None
        asked = (part.part_sha256, spec.conditions, spec.drops, spec.precision, spec.seed)
        return find_under_way(self._accounts.values(), *asked)

    def _diagnose(self) -> Diagnosis:
        accounts = self._accounts.values()
        values = {
            'drops received': self._drops.total,
            'drops per second': self._drops.rate(),
            'drops not counted yet': sum(len(p) for each in accounts for p in each.waiting),
            'distributions known': len(self._known),
            **self._health.values(),
        }
        return Diagnosis(self._health.state, values, self._health.warnings())

    # Services

    async def _get_distribution(
        self, request: GetDistribution.Request, response: GetDistribution.Response
    ) -> GetDistribution.Response:
        with answering(GET_DISTRIBUTION, response, self.get_logger().error):
            response.distribution, note = await self._answers.answer(request)
            response.status = status(Status.OK, note)
        return response

    async def _classify_pose(
        self, request: ClassifyPose.Request, response: ClassifyPose.Response
    ) -> ClassifyPose.Response:
        with answering(CLASSIFY_POSE, response, self.get_logger().error):
            part, aspects = await self._lookup.part(request.part)
            newest = newest_distribution(self._known, self._accounts.values(), part.part_sha256)
            answer_pose(request, response, aspects, newest)
        return response

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
