"""The node that turns resting poses into distributions over aspects, and answers for them."""

import math
import sys
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import PartDescription, PartSummary, RestingPoses, Status
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution, ListParts

from resting_aspects_ros.core.part import Part
from resting_aspects_ros.nodes.aspect_classifier.classify_pose import answer_pose
from resting_aspects_ros.nodes.aspect_classifier.distribution_store import (
    DistributionStore,
    RunCounts,
    newest_distribution,
)
from resting_aspects_ros.nodes.aspect_classifier.drop_part_requests import DropRequests
from resting_aspects_ros.nodes.aspect_classifier.get_distribution import DistributionService
from resting_aspects_ros.nodes.aspect_classifier.log_loader import LogLoader
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry, requested_part
from resting_aspects_ros.nodes.aspect_classifier.publishers import (
    PUBLISH_PERIOD,
    DistributionPublisher,
)
from resting_aspects_ros.nodes.run_tracking.health import RunHealth
from resting_aspects_ros.nodes.run_tracking.tracker import RunProgress, RunTracker
from resting_aspects_ros.ros.callbacks import guarded_task, steady_timer, subscribe
from resting_aspects_ros.ros.conversions import poses_from, status
from resting_aspects_ros.ros.default_conditions import DefaultConditionsSubscriber
from resting_aspects_ros.ros.diagnostics import Diagnosis, RateCounter, publish_diagnostics
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import (
    ASPECT_CLASSIFIER,
    CLASSIFY_POSE,
    GET_DISTRIBUTION,
    LIST_PARTS,
    PARTS,
    POSES,
    RESTING_POSES,
    SERVICES,
)
from resting_aspects_ros.ros.liveliness import DuplicateNodeDetector
from resting_aspects_ros.ros.parameters import FRAME_ID, Parameter, declare
from resting_aspects_ros.ros.spin import run_node
from resting_aspects_ros.ros.status import NotAvailableError, status_from_errors
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.simulation.config_files import surfaces_file
from resting_aspects_ros.simulation.run_description import RunDescription
from resting_aspects_ros.simulation.surfaces import Surfaces

PARAMETERS = (
    Parameter('surfaces_file', '', 'YAML file of named conditions; empty: the one of the suite'),
    FRAME_ID,
    PUBLISH_PERIOD,
    Parameter(
        'log_folder',
        'out/logs',
        'folder of the logs in which earlier runs are looked for; empty: none are',
    ),
)
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
        self._files = FileWorker(self)
        self._parts = PartRegistry(self, self._files, self._part_known, self._part_rejected)
        self._known = DistributionStore(self._parts.aspects)
        self._accounts: dict[str, RunCounts] = {}  # of runs that are not over
        self._over: dict[str, Future] = {}  # run id -> done when the run is over
        self._outputs = DistributionPublisher(self, self._parts)
        self._tracker = RunTracker(self, self._run_over, self._is_known)
        self._health = RunHealth(self, self._tracker)
        self._requests = DropRequests(self, self._tracker.simulators, self._over_future)
        self._answers = DistributionService(
            self,
            surfaces,
            DefaultConditionsSubscriber(self),
            self._known,
            self._requests,
            self._parts,
        )
        self._drops = RateCounter()
        self._watch = TopicDiscovery(
            self, PARTS, PartDescription, self._part_described, gone=self._parts.remove, raw=True
        )
        subscribe(self, RestingPoses, RESTING_POSES, self._batch, POSES)
        # In the node's own group a request that waits would hold up everything it waits for.
        serve = partial(
            self.create_service, qos_profile=SERVICES, callback_group=ReentrantCallbackGroup()
        )
        serve(GetDistribution, GET_DISTRIBUTION, self._get_distribution)
        serve(ClassifyPose, CLASSIFY_POSE, self._classify_pose)
        self.create_service(ListParts, LIST_PARTS, self._list_parts, qos_profile=SERVICES)
        folder = Path(values['log_folder']) if values['log_folder'] else None
        self._logs = LogLoader(self, folder, self._files, self._known)
        self._start = steady_timer(self, 0.0, self._load)

    def destroy_node(self) -> None:
        """Also ends its action clients, and the process that reads files."""
        self._files.stop()
        self._tracker.destroy()
        self._requests.destroy()
        super().destroy_node()

    # Start

    def _load(self) -> None:
        """Read the logs of earlier runs."""
        self.destroy_timer(self._start)
        self._execute(self._logs.load, self._announce)

    def _announce(self) -> None:
        """All logs have been read."""
        for _, part_sha256 in self._parts.offered():
            self._show_known(part_sha256)
        publish_diagnostics(self, self._diagnose, DuplicateNodeDetector(self, ASPECT_CLASSIFIER))
        self.get_logger().info('ready')

    def _check_ready(self) -> None:
        """Raises NotAvailableError while logs are read, which may hold the answer."""
        if not self._logs.ready:
            raise NotAvailableError(self._logs.state)

    def _execute(self, task: Callable[..., Awaitable[None]], *given: Any) -> None:
        assert self.executor is not None  # this is called by it
        self.executor.create_task(task, *given)

    # Topics

    def _part_described(self, name: str, data: bytes) -> None:
        describe = guarded_task(
            self, f'the description of {name} is not used', self._parts.describe
        )
        self._execute(describe, name, data)

    def _part_known(self, part: Part) -> None:
        for run in self._known.check(part.part_sha256):
            self.get_logger().warning(
                f'the log of run {run.run_id} is not used: it counts other aspects than '
                f'{part.name} has'
            )
        self._outputs.offer(part.name)  # before the first run, so that all of it is heard
        self._show_known(part.part_sha256)
        for account in list(self._accounts.values()):
            if account.run.part == part.name:
                self._advance(account)

    def _part_rejected(self, part_sha256: str, _: str) -> None:
        for account in list(self._accounts.values()):
            if account.run.part_sha256 == part_sha256:
                self._advance(account)

    def _show_known(self, part_sha256: str) -> None:
        """Publish what an earlier run found, unless something newer was."""
        known = self._known.newest(part_sha256)
        if known is not None and self._logs.ready:
            self._outputs.restore(*known)

    def _batch(self, message: RestingPoses) -> None:
        poses = poses_from(message)
        arrived = self._tracker.accept(message)
        self._outputs.poses.take(message.run.run_id, poses, message.header.stamp)
        if arrived is None:
            return
        progress, new = arrived
        account = self._accounts.setdefault(progress.run.run_id, RunCounts(progress.run))
        account.waiting.extend(poses.between(first, end) for first, end in new)
        self._drops.add(sum(end - first for first, end in new))
        self._advance(account)
        self._tracker.settle(progress)

    def _is_known(self, run: RunDescription) -> bool | None:
        """Whether all of a run is known from its log; None while the logs are read."""
        return self._known.has_all(run) if self._logs.ready else None

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

    def _advance(self, account: RunCounts) -> None:
        """Count what can be counted; end the account if its run is over."""
        run = account.run
        aspects = self._parts.aspects(run.part_sha256)
        if aspects is None:
            problem = self._parts.why_not(run.part_sha256)
            if account.over and not problem and self._parts.get(run.part) is not None:
                # The description that is latched is of another version: this one is gone.
                problem = f'run {run.run_id} is of another version of {run.part}, ignored'
            if problem:
                account.waiting.clear()
                account.problem = problem
            if problem and account.over:
                self.get_logger().warning(problem)
                self._end(account)
            return
        account.count(aspects)
        self._outputs.change(account)
        if account.over:
            if not account.gap:  # the first m of n drops are the run of m
                self._known.add(run, account.counted)
            self._outputs.publish()
            self._end(account)

    def _end(self, account: RunCounts) -> None:
        """Tell those who wait for it that a run is over."""
        del self._accounts[account.run.run_id]
        self._over_future(account.run.run_id).set_result(account)

    def _over_future(self, run_id: str) -> Future:
        while len(self._over) > RUNS_KEPT:
            self._over.pop(next(iter(self._over)))
        return self._over.setdefault(run_id, Future())

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
        with status_from_errors(GET_DISTRIBUTION, response, self.get_logger().error):
            self._check_ready()
            response.distribution = await self._answers.answer(request)
            response.status = status(Status.OK)
        return response

    async def _classify_pose(
        self, request: ClassifyPose.Request, response: ClassifyPose.Response
    ) -> ClassifyPose.Response:
        response.probability = response.angle = math.nan
        with status_from_errors(CLASSIFY_POSE, response, self.get_logger().error):
            self._check_ready()
            parts = await self._parts.usable(request.part, self._requests.simulator_is_there)
            part = requested_part(parts, request.part)
            aspects = self._parts.version(part.part_sha256)[1]
            newest = newest_distribution(self._known, self._accounts.values(), part.part_sha256)
            answer_pose(request, response, aspects, newest)
        return response

    def _list_parts(
        self, _: ListParts.Request, response: ListParts.Response
    ) -> ListParts.Response:
        with status_from_errors(LIST_PARTS, response, self.get_logger().error):
            self._check_ready()
            for name, sha in self._parts.offered():
                summary = PartSummary(name=name, part_sha256=sha, known=self._known.has(sha))
                response.parts.append(summary)
            response.status = status(Status.OK)
        return response


def main() -> int:
    """Run the node alone in this process."""
    return run_node(AspectClassifier, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
