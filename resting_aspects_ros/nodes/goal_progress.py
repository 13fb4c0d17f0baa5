"""How far a drop_part goal is."""

import time

from rclpy.action.server import ServerGoalHandle
from resting_aspects_interfaces.action import DropPart

from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.drops.run import RunDescription


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
        self.rate = 0.0

    def begin(self, asked: RunDescription) -> None:
        """These drops are made from now on."""
        self._asked = asked
        self.result.run_id = asked.run_id
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
        feedback = DropPart.Feedback(done=result.drops, total=self._asked.drops)
        feedback.drops_per_second = self.rate
        self._handle.publish_feedback(feedback)

    @property
    def so_far(self) -> tuple[RunDescription, int] | None:
        """The drops that are asked for, and how many are made; None before it has begun."""
        return None if self._asked is None else (self._asked, self.result.drops)
