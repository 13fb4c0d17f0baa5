"""Counting of runs: the resting poses of active runs become distributions."""

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import RestingPoses

from resting_aspects_ros.nodes.aspect_classifier.distribution_store import (
    DistributionStore,
    RunCounts,
    newest_distribution,
)
from resting_aspects_ros.nodes.aspect_classifier.log_loader import LogLoader
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.nodes.aspect_classifier.publishers import DistributionPublisher
from resting_aspects_ros.nodes.run_tracking.run_progress import RunProgress
from resting_aspects_ros.nodes.run_tracking.tracker import RunTracker
from resting_aspects_ros.ros.callbacks import subscribe
from resting_aspects_ros.ros.conversions import poses_from
from resting_aspects_ros.ros.diagnostics import RateCounter
from resting_aspects_ros.ros.interface import POSES, RESTING_POSES
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution

# Maximum number of finished runs that are remembered for requests that wait for them.
MAX_FINISHED = 10_000


class RunCounter:
    """Subscribes to resting_poses and counts the drops of each run by aspect.

    tracker : follows the runs and requests lost drops again
    drops : counter of the received drops

    Parameters
    ----------
    known : receives the distributions of finished runs
    outputs : publishes the distributions
    logs : loads the distributions of earlier runs into ``known``
    """

    def __init__(
        self,
        node: Node,
        parts: PartRegistry,
        known: DistributionStore,
        outputs: DistributionPublisher,
        logs: LogLoader,
    ) -> None:
        self._node = node
        self._parts = parts
        self._known = known
        self._outputs = outputs
        self._logs = logs
        self._active: dict[str, RunCounts] = {}  # by run id
        self._finished: dict[str, Future] = {}  # by run id; done when the run is finished
        self.drops = RateCounter()
        self.tracker = RunTracker(node, self._finish_run, self._is_known)
        subscribe(node, RestingPoses, RESTING_POSES, self._take_batch, POSES)

    def finished(self, run_id: str) -> Future:
        """Return the future of the counts of a run, which is done when the run is finished."""
        while len(self._finished) > MAX_FINISHED:
            self._finished.pop(next(iter(self._finished)))
        return self._finished.setdefault(run_id, Future())

    def newest(self, part_sha256: str) -> Distribution | None:
        """Return the newest distribution of a part, from finished or active runs."""
        return newest_distribution(self._known, self._active.values(), part_sha256)

    def pending_drops(self) -> int:
        """Return the number of received drops that are not counted yet."""
        return sum(len(poses) for counts in self._active.values() for poses in counts.pending)

    def part_changed(self, name: str) -> None:
        """Count the pending drops of a part after its description was read."""
        for counts in list(self._active.values()):
            if counts.run.part == name:
                self._update(counts)

    def part_rejected(self, part_sha256: str) -> None:
        """Drop the pending drops of a version of a part that cannot be used."""
        for counts in list(self._active.values()):
            if counts.run.part_sha256 == part_sha256:
                self._update(counts)

    def _take_batch(self, message: RestingPoses) -> None:
        poses = poses_from(message)
        accepted = self.tracker.accept(message)
        self._outputs.poses.take(message.run.run_id, poses, message.header.stamp)
        if accepted is None:
            return
        progress, new = accepted
        counts = self._active.setdefault(progress.run.run_id, RunCounts(progress.run))
        counts.pending.extend(poses.between(first, end) for first, end in new)
        self.drops.add(sum(end - first for first, end in new))
        self._update(counts)
        self.tracker.settle(progress)

    def _is_known(self, run: RunDescription) -> bool | None:
        """Whether all drops of a run are known from its log; None while logs are being read."""
        return self._known.has_all(run) if self._logs.ready else None

    def _finish_run(self, progress: RunProgress) -> None:
        counts = self._active.get(progress.run.run_id)
        if counts is None:
            return
        if not (progress.complete or progress.lost):
            del self._active[progress.run.run_id]  # known from its log, and no request waits
            return
        counts.finished = True
        if progress.lost:
            counts.problem, counts.has_gap = progress.loss, not progress.has_no_gap
        self._update(counts)

    def _update(self, counts: RunCounts) -> None:
        """Count the pending drops of a run; publish and store its result if it is finished."""
        run = counts.run
        if self._parts.aspects(run.part_sha256) is None:
            self._update_uncountable(counts)
            return
        counts.count(*self._parts.version(run.part_sha256))
        self._outputs.change(counts)
        if counts.finished:
            if not counts.has_gap:  # the first m of n drops are the run of m
                self._known.add(run, counts.counted)
            self._outputs.publish()
            self._end(counts)

    def _update_uncountable(self, counts: RunCounts) -> None:
        """Drop the pending drops of a run whose part version cannot be used or is outdated."""
        run = counts.run
        problem = self._parts.why_not(run.part_sha256)
        if counts.finished and not problem and self._parts.get(run.part) is not None:
            # The latched description is of another version; this one will not be published again.
            problem = f'ignored run {run.run_id}: it is of another version of {run.part}'
        if problem:
            counts.pending.clear()
            counts.problem = problem
        if problem and counts.finished:
            self._node.get_logger().warning(problem)
            self._end(counts)

    def _end(self, counts: RunCounts) -> None:
        """Pass the counts of a finished run to the requests that wait for them."""
        del self._active[counts.run.run_id]
        self.finished(counts.run.run_id).set_result(counts)
