"""Tracks the drops that a consumer of resting_poses received, and requests lost ones again."""

import time
from collections import OrderedDict
from collections.abc import Callable

from rclpy.action import ActionClient
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.nodes.run_tracking.run_progress import RunProgress
from resting_aspects_ros.ros.callbacks import guarded, steady_timer
from resting_aspects_ros.ros.conversions import conditions_msg, run_from
from resting_aspects_ros.ros.goal_client import goal_result
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    DROP_PART,
    DROP_SIMULATOR,
    LOG_REPLAYER,
)
from resting_aspects_ros.ros.liveliness import LivelinessMonitor
from resting_aspects_ros.simulation.job import RunDescription

# Time for which batches can still arrive after their simulator disappeared, s.
GRACE = 2.0
# Time after which a run without new batches belongs to a simulator that was replaced, s. Longer,
# because a simulator that was only suspended also counts as replaced.
REPLACED_GRACE = 10.0
# Time between two checks for missing drops and for runs whose simulator disappeared, s.
CHECK_PERIOD = 1.0
# Number of runs that are remembered, so that drops that are published again do not look new.
RUNS_KEPT = 10_000


class RunTracker:
    """Tracks runs by their batches, and requests lost drops again from the simulator.

    A run that has not ended when its simulator disappears is interrupted.

    Parameters
    ----------
    over : called once for each run when it is complete, lost or known; the run is then closed
    known : returns whether all drops of a run are known already, so that missing drops are not
        requested; None if that is not decided yet

    problem : which drops of the last lost run are lost; empty after the next complete run
    lost : number of lost runs
    simulators, replayers : nodes that are alive in the namespace
    """

    def __init__(
        self,
        node: Node,
        over: Callable[[RunProgress], None],
        known: Callable[[RunDescription], bool | None],
    ) -> None:
        self._node = node
        self._over = over
        self._known = known
        self.problem = ''
        self.lost = 0
        self.simulators = LivelinessMonitor(node, DROP_SIMULATOR)
        self.replayers = LivelinessMonitor(node, LOG_REPLAYER)
        self._client = ActionClient(node, DropPart, DROP_PART, **ACTION_SERVICES)
        self._runs: OrderedDict[str, RunProgress] = OrderedDict()
        steady_timer(
            node, CHECK_PERIOD, guarded(node, 'the check for lost drops failed', self._check)
        )

    def destroy(self) -> None:
        """Destroy the action client."""
        self._client.destroy()

    def missing(self) -> int:
        """Return the number of drops of active runs that were published and not received."""
        return sum(end - first for each in self._active() for first, end in each.missing())

    def active_runs(self) -> list[tuple[RunDescription, int]]:
        """Return the active runs and the number of received drops of each."""
        return [(progress.run, len(progress.seen)) for progress in self._active()]

    def accept(self, batch: RestingPosesMsg) -> tuple[RunProgress, list[tuple[int, int]]] | None:
        """Return the run of a batch and the ranges of its new drops; None if the run is closed.

        Raises InvalidValueError if the batch contradicts an earlier batch of its run.
        """
        first, end = batch.first_drop, batch.first_drop + len(batch.poses)
        progress = self._find(run_from(batch.run))
        if progress.closed:
            return None
        progress.heard = time.monotonic()
        new = progress.take(first, end)
        if batch.last:
            progress.ended, progress.end = True, max(end, progress.seen.end)
        return progress, new

    def settle(self, progress: RunProgress) -> None:
        """Close the run if it is finished, or request missing drops; called after each batch."""
        if progress.closed:
            return
        known = self._known(progress.run) if progress.missing() else False
        if progress.complete or progress.lost or known:
            progress.closed = True
            self.problem = progress.loss if progress.lost else ''
            if progress.lost:
                self.lost += 1
                self._node.get_logger().warning(self.problem)
            self._over(progress)
        elif progress.missing() and known is False:
            self._repair(progress)

    def _active(self) -> list[RunProgress]:
        return [progress for progress in self._runs.values() if not progress.closed]

    def _find(self, run: RunDescription) -> RunProgress:
        progress = self._runs.get(run.run_id)
        if progress is None:
            progress = self._runs[run.run_id] = RunProgress(run, run.end, time.monotonic())
            while len(self._runs) > RUNS_KEPT:
                self._runs.popitem(last=False)
        elif progress.run.sequence() != run.sequence():
            raise InvalidValueError(
                f'a batch of run {run.run_id} describes another run than its earlier batches'
            )
        return progress

    def _check(self) -> None:
        for progress in self._active():
            if self.is_abandoned(progress.began, progress.heard):
                progress.ended = progress.abandoned = True
            if progress.abandoned or not progress.repairing:
                self.settle(progress)

    def is_abandoned(self, began: float, heard: float) -> bool:
        """Return whether the simulator of a run is gone or replaced.

        If there never was a simulator or a replayer, the batches have another source.

        Parameters
        ----------
        began, heard : times of the first and of the last message, on the monotonic clock, s
        """
        alive, now = self.simulators.count, time.monotonic()
        was_seen = self.simulators.was_seen or self.replayers.was_seen
        if not was_seen or now - heard < GRACE:
            return False
        if not alive:
            return not self.replayers.count
        # Messages of the replaced simulator can arrive after its replacement appeared.
        replaced = self.simulators.replaced_at
        return alive == 1 and began < replaced and now - max(heard, replaced) >= REPLACED_GRACE

    def _repair(self, progress: RunProgress) -> None:
        if progress.repairing or not self._client.server_is_ready():
            return  # _check tries again
        run, (first, end) = progress.run, progress.missing()[0]
        progress.repairing = True
        progress.repairs += 1
        goal = DropPart.Goal(
            part=run.part,
            surface=run.conditions.surface,
            conditions=[conditions_msg(run.conditions)],
            drops=end - first,
            first_drop=first,
            seed=run.seed,
            run_id=run.run_id,
        )
        self._node.get_logger().warning(f'{_drops(goal)} were lost and are requested again')
        executor = self._node.executor
        assert executor is not None  # the executor calls this method
        executor.create_task(self._request_again, progress, goal)

    async def _request_again(self, progress: RunProgress, goal: DropPart.Goal) -> None:
        """Request drops again. The last batch can arrive later; _check then finds what is left."""
        try:
            answer = (await goal_result(self._node, self._client, goal)).status
            code, reason = answer.code, answer.message
        except RestingAspectsError as error:
            code, reason = Status.NOT_AVAILABLE, str(error)
        progress.repairing = False
        if code == Status.BUSY:
            progress.repairs = 0
        elif code not in (Status.OK, Status.CANCELED):
            self._node.get_logger().error(f'{_drops(goal)} are not available: {reason}')


def _drops(goal: DropPart.Goal) -> str:
    last = goal.first_drop + goal.drops - 1
    return f'drops {goal.first_drop} to {last} of run {goal.run_id} ({goal.part})'
