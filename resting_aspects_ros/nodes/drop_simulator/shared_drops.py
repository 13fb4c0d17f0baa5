"""Drops that several goals ask for at the same time, and runs of which drops are asked again."""

import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from copy import copy

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.ros.callbacks import wait_for
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError
from resting_aspects_ros.simulation.run_description import RunDescription

# How often a goal looks whether it was canceled while others want the same drops, s.
CANCEL_PERIOD = 0.5
# Descriptions of so many runs are kept, to publish drops of them again.
RUNS_KEPT = 10_000


class GoalDrops:
    """The drops of one or more goals while they are made: their result so far, and feedback.

    asked : the drops that the goals ask for
    result : what the goals will end with
    rate : drops per second, from the begin to the last drops that came
    """

    def __init__(self, asked: RunDescription) -> None:
        self.asked = asked
        self.result = DropPart.Result(run_id=asked.run_id)
        self.rate = 0.0
        self._begun = time.monotonic()
        self._goals: list[ServerGoalHandle] = []

    @property
    def wanted(self) -> bool:
        """Whether any goal has not been canceled."""
        return any(not goal.is_cancel_requested for goal in self._goals)

    def join(self, goal: ServerGoalHandle) -> None:
        """Send feedback to this goal, too."""
        self._goals.append(goal)
        if self.result.drops:
            self._feed_back([goal])

    def leave(self, goal: ServerGoalHandle) -> None:
        """The goal ends."""
        self._goals.remove(goal)

    def add(self, chunk: RestingPoses) -> None:
        """Count drops, and send feedback."""
        result = self.result
        result.drops += len(chunk)
        result.settled += int((chunk.status == RestStatus.SETTLED).sum())
        result.unsettled += int((chunk.status == RestStatus.UNSETTLED).sum())
        result.failed += int((chunk.status == RestStatus.FAILED).sum())
        seconds = time.monotonic() - self._begun
        self.rate = result.drops / seconds if seconds > 0 else 0.0
        self._feed_back(self._goals)

    def _feed_back(self, goals: list[ServerGoalHandle]) -> None:
        feedback = DropPart.Feedback(done=self.result.drops, total=self.asked.drops)
        feedback.drops_per_second = self.rate
        for goal in goals:
            goal.publish_feedback(feedback)


class SharedDrops:
    """Makes drops once for all goals that ask for the same ones at the same time."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._made: dict[Hashable, tuple[GoalDrops, Future]] = {}

    def under_way(self) -> list[GoalDrops]:
        """All drops that are being made."""
        return [drops for drops, _ in self._made.values()]

    def has(self, key: Hashable) -> bool:
        """Whether the drops with this key are being made."""
        return key in self._made

    async def make(
        self,
        key: Hashable,
        goal: ServerGoalHandle,
        asked: RunDescription,
        make: Callable[[GoalDrops], Awaitable[None]],
    ) -> tuple[DropPart.Result, Exception | None]:
        """Return the result of a goal, and the error with which its drops ended, if any.

        The drops with a key are made while at least one goal wants them.
        """
        if key not in self._made:
            self._made[key] = GoalDrops(asked), Future(executor=self._node.executor)
            assert self._node.executor is not None  # this is called by it
            self._node.executor.create_task(self._make, key, make)
        drops, over = self._made[key]
        drops.join(goal)
        try:
            while not await wait_for(self._node, over, CANCEL_PERIOD):
                if goal.is_cancel_requested and drops.wanted:
                    error = CanceledError('canceled; its drops are made on for another goal')
                    return copy(drops.result), error
        finally:
            drops.leave(goal)
        error = over.result()
        if isinstance(error, CanceledError) and not goal.is_cancel_requested:
            return await self.make(key, goal, asked, make)  # it came when the others had gone
        return copy(drops.result), error

    async def _make(self, key: Hashable, make: Callable[[GoalDrops], Awaitable[None]]) -> None:
        drops, over = self._made[key]
        error: Exception | None = None
        try:
            await make(drops)
        except Exception as raised:  # noqa: BLE001 - given to the goals
            error = raised
        finally:
            del self._made[key]
            over.set_result(error)


class PublishedRuns:
    """The runs that a simulator has begun, so that it can publish drops of them again."""

    def __init__(self) -> None:
        self._runs: OrderedDict[str, RunDescription] = OrderedDict()

    def begin(self, run: RunDescription) -> None:
        """Keep the description of a run."""
        self._runs[run.run_id] = run
        while len(self._runs) > RUNS_KEPT:
            self._runs.popitem(last=False)

    def find(self, asked: RunDescription) -> RunDescription:
        """Return the run of which drops are asked for again.

        Raises NotAvailableError if this simulator has not begun it, InvalidValueError if the drops
        are not of that run.
        """
        run = self._runs.get(asked.run_id)
        if run is None:
            raise NotAvailableError(
                f'run {asked.run_id} was not made by this simulator, which was perhaps started '
                'again since'
            )
        if run.sequence() != asked.sequence():
            raise InvalidValueError(
                f'run {run.run_id} is of {run.part} under other conditions, of another seed or '
                'of another version of the part: only its own drops can be published again'
            )
        return run
