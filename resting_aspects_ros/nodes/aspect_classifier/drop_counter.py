"""Counting of drops: the messages on resting_poses become distributions."""

import time

from rclpy.node import Node
from resting_aspects_interfaces.msg import RestingPoses

from resting_aspects_ros.nodes.aspect_classifier.log_loader import LogLoader
from resting_aspects_ros.nodes.aspect_classifier.model_ranges import ModelRanges
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.nodes.aspect_classifier.publishers import DistributionPublisher
from resting_aspects_ros.nodes.aspect_classifier.tallies import Tallies, Tally
from resting_aspects_ros.nodes.drop_client import DropClient, goal_of_run
from resting_aspects_ros.ros.callbacks import guarded_task, sleep_for, subscribe
from resting_aspects_ros.ros.conversions import poses_from, run_from
from resting_aspects_ros.ros.diagnostics import RateCounter
from resting_aspects_ros.ros.formatting import active_runs_text, count_text, run_values
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, POSES, RESTING_POSES
from resting_aspects_ros.simulation.job import RunDescription

# Time without a message after which a run no longer counts as active, s.
IDLE = 60.0
# Interval of checks whether the logs have been read, s.
LOGS_PERIOD = 0.5


class DropCounter:
    """Subscribes to resting_poses and counts the drops by aspect.

    When the last message of a run has arrived and drops are missing, they are requested again.

    drops : counter of the received drops

    Parameters
    ----------
    tallies : receives the drops
    outputs : publishes the distributions
    logs : of earlier runs, which may have drops whose messages were too old to arrive
    client : requests drops that are missing
    ranges : adds the model range at the end of a run
    """

    def __init__(
        self,
        node: Node,
        parts: PartRegistry,
        tallies: Tallies,
        outputs: DistributionPublisher,
        logs: LogLoader,
        client: DropClient,
        ranges: ModelRanges,
    ) -> None:
        self._node = node
        self._parts = parts
        self._tallies = tallies
        self._outputs = outputs
        self._logs = logs
        self._client = client
        self._ranges = ranges
        self._request = guarded_task(node, 'missing drops are not requested', self._request_again)
        self._add_range = guarded_task(node, 'model range is missing', self._add_range_now)
        self._gone = False  # whether it was logged that the source of active runs is gone
        self.drops = RateCounter()
        subscribe(node, RestingPoses, RESTING_POSES, self._receive, POSES)

    def part_changed(self, part_sha256: str) -> None:
        """Count the waiting drops of a part after its description was read."""
        for tally in self._tallies:
            if tally.run.part_sha256 == part_sha256 and tally.waiting:
                self._update(tally)

    def _receive(self, message: RestingPoses) -> None:
        poses, run = poses_from(message), run_from(message.run)
        self._outputs.poses.take(run.run_id, poses, message.header.stamp)
        tally = self._tallies.of_run(run)
        self.drops.add(tally.add(run, poses, last=message.last))
        self._update(tally)
        if message.last and tally.missing():
            assert self._node.executor is not None  # it calls this
            self._node.executor.create_task(self._request, tally, run)

    def _update(self, tally: Tally) -> None:
        """Count the waiting drops of a tally, if the aspects of its part are known."""
        if self._parts.aspects(tally.run.part_sha256) is None:
            return
        tally.count(*self._parts.version(tally.run.part_sha256))
        self._outputs.change(tally)
        if tally.complete:
            self._outputs.publish()
            assert self._node.executor is not None  # it calls this
            self._node.executor.create_task(self._add_range, tally)

    async def _add_range_now(self, tally: Tally) -> None:
        """Publish the distribution of a run that has ended again, with its model range."""
        if await self._ranges.add(tally):
            self._outputs.change(tally)
            self._outputs.publish()

    async def _request_again(self, tally: Tally, run: RunDescription) -> None:
        while not self._logs.ready:
            await sleep_for(self._node, LOGS_PERIOD)
        if not await self._client.request_again(goal_of_run(run), tally.missing):
            lost = sum(end - first for first, end in tally.missing())
            drops = count_text(lost, 'drop', 'drops')
            self._node.get_logger().warning(f'run {run.run_id} of {run.part} is missing {drops}')

    # Diagnostics

    @property
    def state(self) -> str:
        """The progress of the active runs as text; empty if there are none."""
        return active_runs_text(self._active())

    def _active(self) -> list[tuple[RunDescription, int]]:
        begin = time.monotonic() - IDLE
        return [(t.run, t.drops) for t in self._tallies if not t.ended and t.heard > begin]

    def _missing(self) -> int:
        return sum(end - first for tally in self._tallies for first, end in tally.missing())

    def values(self) -> dict[str, object]:
        """Return values for the diagnostics."""
        waiting = sum(len(poses) for tally in self._tallies for poses in tally.waiting)
        return {
            'drops received': self.drops.total,
            'drops per second': self.drops.rate(),
            'drops not counted yet': waiting,
            'missing drops': self._missing(),
            'drop_simulators': self._client.simulators.count,
            **run_values(self._active()),
        }

    def warnings(self) -> list[str]:
        """Return the current problems; logs once if the simulator disappears during a run."""
        gone = self._client.simulators.was_seen and self._client.source_is_gone
        if gone and self.state and not self._gone:
            self._node.get_logger().warning(f'{DROP_SIMULATOR} disappeared: {self.state}')
        self._gone = gone
        missing = self._missing()
        text = count_text(missing, 'drop is missing', 'drops are missing')
        return [f'no {DROP_SIMULATOR}'] * gone + [text] * bool(missing)
