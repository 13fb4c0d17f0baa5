"""The runs that a simulator published before this node began: they come in after it has begun."""

import time

from action_msgs.msg import GoalStatusArray
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future

from resting_aspects_ros.nodes.callbacks import subscribe
from resting_aspects_ros.nodes.interface import DROP_PART
from resting_aspects_ros.nodes.waiting import wait_for

# Nothing has come so long after the node began: nothing will, s.
NOTHING = 5.0
# They come one after another: so long after the last one all are there, s.
QUIET = 0.5
# A run that is under way goes on with batches: what was before it is there by then, s.
LONGEST = 3.0
PERIOD = 0.1


class EarlierRuns:
    """Who asks for drops at once would get some again that were made, or are under way."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._begun = time.monotonic()
        self._first = self._last = 0.0
        self._had_goals = False
        # Latched, and there long before the poses, which can be many.
        status = f'{DROP_PART}/_action/status'
        subscribe(node, GoalStatusArray, status, self._goals, qos_profile_action_status_default)

    def hear(self) -> None:
        """A batch has come."""
        self._last = time.monotonic()
        self._first = self._first or self._last

    async def wait(self) -> None:
        """Wait while some may be on their way."""
        never = Future(executor=self._node.executor)
        while self._may_come(time.monotonic()):
            await wait_for(self._node, never, PERIOD)

    def _goals(self, message: GoalStatusArray) -> None:
        self._had_goals = self._had_goals or bool(message.status_list)

    def _may_come(self, now: float) -> bool:
        if not self._had_goals:
            return False
        if not self._first:
            return now < self._begun + NOTHING
        return now < min(self._first + LONGEST, self._last + QUIET)
