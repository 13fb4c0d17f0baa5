"""Drops shared by concurrent goals, and runs whose drops can be requested again."""

import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from copy import copy

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros.callbacks import wait_for
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# Interval at which a goal that waits checks whether it was canceled, s.
CANCEL_PERIOD = 0.5
# Maximum number of runs whose descriptions are kept, to publish drops of them again.
MAX_RUNS = 10_000


class GoalDrops:
    """Drops in production for one or more goals: sends feedback and accumulates the result.

    requested : the drops that the goals request
    result : current counts; the result of the goals when all drops are made
    rate : drops per second, from the start to the most recent chunk
    """

    def __init__(self, requested: RunDescription) -> None:
        self.requested = requested
        self.result = DropPart.Result(run_id=requested.run_id)
        self.rate = 0.0
        self._start = time.monotonic()
        self._goals: list[ServerGoalHandle] = []

    @property
    def wanted(self) -> bool:
        """Whether at least one goal has not been canceled."""
        return any(not goal.is_cancel_requested for goal in self._goals)

    def join(self, goal: ServerGoalHandle) -> None:
        """Add a goal, which then receives feedback."""
        self._goals.append(goal)
        if self.result.drops:
            self._send_feedback([goal])

    def leave(self, goal: ServerGoalHandle) -> None:
        """Remove a goal that ends."""
        self._goals.remove(goal)

    def add(self, chunk: RestingPoses) -> None:
        """Count the drops of a chunk and send feedback."""
        result = self.result
        result.drops += len(chunk)
        result.settled += int((chunk.status == RestStatus.SETTLED).sum())
        result.unsettled += int((chunk.status == RestStatus.UNSETTLED).sum())
        result.failed += int((chunk.status == RestStatus.FAILED).sum())
        result.lost += int((chunk.status == RestStatus.LOST).sum())
        result.sliding += int((chunk.status == RestStatus.SLIDING).sum())
        seconds = time.monotonic() - self._start
        self.rate = result.drops / seconds if seconds > 0 else 0.0
        self._send_feedback(self._goals)

    def _send_feedback(self, goals: list[ServerGoalHandle]) -> None:
        feedback = DropPart.Feedback(done=self.result.drops, total=self.requested.drops)
        feedback.drops_per_second = self.rate
        for goal in goals:
            goal.publish_feedback(feedback)


class SharedDrops:
    """Makes drops once for all concurrent goals that request the same drops."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._active: dict[Hashable, tuple[GoalDrops, Future]] = {}

    def active(self) -> list[GoalDrops]:
        """Return all drops in production."""
        return [drops for drops, _ in self._active.values()]

    def has(self, key: Hashable) -> bool:
        """Return whether the drops with this key are in production."""
        return key in self._active

    async def make(
        self,
        key: Hashable,
        goal: ServerGoalHandle,
        requested: RunDescription,
        make: Callable[[GoalDrops], Awaitable[None]],
    ) -> tuple[DropPart.Result, Exception | None]:
        """Return the result of a goal, and the error that ended its drops, if any.

        The production of the drops with a key continues while at least one goal is not canceled.
        """
        if key not in self._active:
            self._active[key] = GoalDrops(requested), Future(executor=self._node.executor)
            assert self._node.executor is not None  # this is called by it
            self._node.executor.create_task(self._make, key, make)
        drops, finished = self._active[key]
        drops.join(goal)
        try:
            while not await wait_for(self._node, finished, CANCEL_PERIOD):
                if goal.is_cancel_requested and drops.wanted:
                    error = CanceledError('canceled; its drops continue for another goal')
                    return copy(drops.result), error
        finally:
            drops.leave(goal)
        error = finished.result()
        if isinstance(error, CanceledError) and not goal.is_cancel_requested:
            # The goal joined after all other goals had been canceled.
            return await self.make(key, goal, requested, make)
        return copy(drops.result), error

    async def _make(self, key: Hashable, make: Callable[[GoalDrops], Awaitable[None]]) -> None:
        drops, finished = self._active[key]
        error: Exception | None = None
        try:
            await make(drops)
        except Exception as raised:  # noqa: BLE001 - passed to the goals
            error = raised
        finally:
            del self._active[key]
            finished.set_result(error)


class PublishedRuns:
    """The runs that a simulator has started, so that it can publish drops of them again."""

    def __init__(self) -> None:
        self._runs: OrderedDict[str, RunDescription] = OrderedDict()

    def add(self, run: RunDescription) -> None:
        """Store the description of a run."""
        self._runs[run.run_id] = run
        while len(self._runs) > MAX_RUNS:
            self._runs.popitem(last=False)

    def find(self, requested: RunDescription) -> RunDescription:
        """Return the run whose drops are requested again.

        Raises NotAvailableError if this simulator did not start the run, and InvalidValueError if
        the requested drops do not belong to it.
        """
        run = self._runs.get(requested.run_id)
        if run is None:
            raise NotAvailableError(
                f'run {requested.run_id} was not made by this simulator, which may have been '
                'restarted since'
            )
        if run.sequence() != requested.sequence():
            raise InvalidValueError(
                f'invalid request for drops of run {run.run_id}: expected its part {run.part}, '
                'in the same version, its conditions and its seed'
            )
        return run
