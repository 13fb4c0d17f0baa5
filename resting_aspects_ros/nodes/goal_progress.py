"""How far a drop_part goal is."""

import time
from copy import copy

from rclpy.action.server import ServerGoalHandle
from resting_aspects_interfaces.action import DropPart

from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.nodes.requests import CanceledError


class GoalProgress:
    """Fills the result of a goal while its drops are made, and feeds back.

    result : what the goal will end with
    rate : drops per second, from its begin to the last drops that came
    """

    def __init__(self, handle: ServerGoalHandle) -> None:
        self.result = DropPart.Result()
        self._handle = handle
        self._asked: RunDescription | None = None
        self._begun = 0.0
        self._told = 0
        self.rate = 0.0

    def begin(self, asked: RunDescription) -> None:
        """These drops are made from now on."""
        self._asked = asked
        self.result = DropPart.Result(run_id=asked.run_id)
        self._begun = time.monotonic()

    def add(self, chunk: RestingPoses) -> None:
        """Count drops, and tell who waits."""
        assert self._asked is not None
        result = self.result
        result.drops += len(chunk)
        result.settled += int((chunk.status == RestStatus.SETTLED).sum())
        result.unsettled += int((chunk.status == RestStatus.UNSETTLED).sum())
        result.failed += int((chunk.status == RestStatus.FAILED).sum())
        seconds = time.monotonic() - self._begun
        self.rate = result.drops / seconds if seconds > 0 else 0.0
        self._feed_back(self._asked)

    def follow(self, maker: 'GoalProgress') -> None:
        """Be as far as another goal, which makes the same drops."""
        self.result, self.rate = copy(maker.result), maker.rate
        if maker.so_far is not None:
            self._feed_back(maker.so_far[0])

    def check_wanted(self) -> None:
        """CanceledError if the goal, of which no drop is made yet, was canceled."""
        if not self._handle.is_cancel_requested:
            return
        followed, self.result = self.result.drops, DropPart.Result(run_id=self.result.run_id)
        raise CanceledError(
            'canceled; its drops were under way for another goal'
            if followed
            else 'canceled before the first drop'
        )

    def _feed_back(self, asked: RunDescription) -> None:
        if self.result.drops <= self._told:
            return  # they are begun anew after the goal that made them was canceled
        self._told = self.result.drops
        feedback = DropPart.Feedback(done=self._told, total=asked.drops)
        feedback.drops_per_second = self.rate
        self._handle.publish_feedback(feedback)

    @property
    def so_far(self) -> tuple[RunDescription, int] | None:
        """The drops that are asked for, and how many are made; None before it has begun."""
        return None if self._asked is None else (self._asked, self.result.drops)
