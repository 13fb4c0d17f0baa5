"""What a consumer of resting_poses has seen of each run, and how it gets what it missed."""

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from rclpy.action import ActionClient
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.ros.callbacks import guarded, steady_timer
from resting_aspects_ros.ros.conversions import conditions_msg, run_from
from resting_aspects_ros.ros.drop_part_client import drop_result
from resting_aspects_ros.ros.formatting import count_text, progress_text
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    DROP_PART,
    DROP_SIMULATOR,
    LOG_REPLAYER,
)
from resting_aspects_ros.ros.liveliness import LivelinessMonitor
from resting_aspects_ros.simulation.index_ranges import IndexRanges
from resting_aspects_ros.simulation.run_description import RunDescription

# Missing drops are asked for so many times in a row without getting any, then they are lost.
MAX_REPAIRS = 3
# Batches of a simulator that is gone may still be read for this long after it is noticed, s.
GRACE = 2.0
# How often gaps, and runs whose simulator is gone, are looked for, s.
CHECK_PERIOD = 1.0
# Runs that are remembered, so that drops published again for others are not taken for new.
RUNS_KEPT = 10_000


@dataclass
class RunProgress:
    """The drops of one run that have been seen.

    end : index after its last drop; until ``ended`` the one that was asked for
    abandoned : its simulator was gone before the last batch
    """

    run: RunDescription
    end: int
    ended: bool = False
    abandoned: bool = False
    seen: IndexRanges = field(default_factory=IndexRanges)
    repairs: int = 0
    repairing: bool = False
    closed: bool = False
    heard: float = 0.0

    def take(self, first: int, end: int) -> list[tuple[int, int]]:
        """Note drops as seen; the ranges of them that are new."""
        new = self.seen.add(first, end) if first < end else []
        if new:
            self.repairs = 0
        return new

    def missing(self) -> list[tuple[int, int]]:
        """Ranges that have been published and were not seen."""
        return self.seen.missing(self.run.first_drop, self.end if self.ended else self.seen.end)

    @property
    def complete(self) -> bool:
        """Nothing is missing and no more is to come."""
        return self.ended and not self.missing()

    @property
    def lost(self) -> bool:
        """Something is missing and cannot be had."""
        given_up = self.repairs >= MAX_REPAIRS and not self.repairing
        return (self.abandoned or given_up) and bool(self.missing())

    @property
    def broken_off(self) -> bool:
        """What has been seen of it are its first drops, to the last one without a gap."""
        return bool(self.seen.ranges) and not self.seen.missing(self.run.first_drop, self.seen.end)

    @property
    def loss(self) -> str:
        """What of it is lost, in words."""
        name = f'run {self.run.run_id} of {self.run.part}'
        if self.abandoned:
            return f'{name} was broken off: {progress_text(self.run, len(self.seen))}'
        lost = sum(end - first for first, end in self.missing())
        total = count_text(self.end - self.run.first_drop, 'drop', 'drops')
        return f'{name} has lost {lost} of {total}, which could not be recovered'


class RunTracker:
    """Follows runs through their batches; asks the simulator again for drops that were lost.

    A run that is not over when its simulator ends is broken off.

    Parameters
    ----------
    over : called once for each run when it is complete, lost or known, and then marked closed
    known : whether all drops of a run are known already, so that those that are missing here are
        not asked for; None while that is not clear

    problem : what the newest run lost that is lost, in words, until a run is complete; else empty
    lost : runs that are lost
    simulators, replayers : those that are alive in the namespace
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
            node, CHECK_PERIOD, guarded(node, 'lost drops are not looked for', self._check)
        )

    def destroy(self) -> None:
        """End the action client."""
        self._client.destroy()

    def missing(self) -> int:
        """Drops that were published and have not been seen, of all runs that are not over."""
        return sum(end - first for each in self._open() for first, end in each.missing())

    def under_way(self) -> list[tuple[RunDescription, int]]:
        """The runs that are not over, and how many drops of each have been seen."""
        return [(progress.run, len(progress.seen)) for progress in self._open()]

    def accept(self, batch: RestingPosesMsg) -> tuple[RunProgress, list[tuple[int, int]]] | None:
        """Return the run of a batch, and the ranges of its drops that are new; None if it is over.

        Raises InvalidValueError if the batch contradicts an earlier one of its run.
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
        """After a batch was dealt with: end the run, or ask for what is missing."""
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

    def _open(self) -> list[RunProgress]:
        return [progress for progress in self._runs.values() if not progress.closed]

    def _find(self, run: RunDescription) -> RunProgress:
        known = self._runs.get(run.run_id)
        if known is None:
            known = self._runs[run.run_id] = RunProgress(run, run.end)
            while len(self._runs) > RUNS_KEPT:
                self._runs.popitem(last=False)
        elif known.run.sequence() != run.sequence():
            raise InvalidValueError(f'run {run.run_id} is not the run that it began as')
        return known

    def _check(self) -> None:
        for progress in self._open():
            if self._is_abandoned(progress.heard):
                progress.ended = progress.abandoned = True
            if progress.abandoned or not progress.repairing:
                self.settle(progress)

    def _is_abandoned(self, heard: float) -> bool:
        """Whether the simulator of a run that was heard of then is gone, or another one by now.

        Where there never was one, nor a replayer, the batches come from elsewhere.
        """
        alive = self.simulators.count
        was_seen = self.simulators.was_seen or self.replayers.was_seen
        if not was_seen or time.monotonic() - heard < GRACE:
            return False
        if not alive:
            return not self.replayers.count
        return alive == 1 and heard < self.simulators.replaced_at

    def _repair(self, progress: RunProgress) -> None:
        if progress.repairing or not self._client.server_is_ready():
            return  # _check comes back to it
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
        self._node.get_logger().warning(f'{_drops(goal)} were lost, asking again')
        executor = self._node.executor
        assert executor is not None  # this is called by it
        executor.create_task(self._ask_again, progress, goal)

    async def _ask_again(self, progress: RunProgress, goal: DropPart.Goal) -> None:
        """The last batch may still be on its way after it: _check looks what is missing."""
        try:
            answer = (await drop_result(self._node, self._client, goal)).status
            code, complaint = answer.code, answer.message
        except RestingAspectsError as error:
            code, complaint = Status.NOT_AVAILABLE, str(error)
        progress.repairing = False
        if code == Status.BUSY:
            progress.repairs = 0
        elif code not in (Status.OK, Status.CANCELED):
            self._node.get_logger().error(f'{_drops(goal)} are not available: {complaint}')


def _drops(goal: DropPart.Goal) -> str:
    last = goal.first_drop + goal.drops - 1
    return f'drops {goal.first_drop} to {last} of run {goal.run_id} ({goal.part})'
