"""Drops that several goals ask for at the same time, and that are made once."""

from collections.abc import Awaitable, Callable, Hashable

from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.nodes.goal_progress import GoalProgress
from resting_aspects_ros.nodes.waiting import wait_for

# How often a goal that follows another one looks how far that is, s.
FOLLOW_PERIOD = 0.5


class SharedDrops:
    """Makes drops under a key; who asks for the same meanwhile follows the goal that does."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._makers: dict[Hashable, tuple[GoalProgress, Future]] = {}

    async def make(
        self, key: Hashable, progress: GoalProgress, make: Callable[[], Awaitable[None]]
    ) -> None:
        """Fill the progress of a goal, by its own drops or by those that are under way.

        Raises what ``make`` raises, and CanceledError if the goal is canceled; the one that it
        follows goes on. What was begun for another and failed, or was canceled, is begun anew.
        """
        while key in self._makers:
            maker, over = self._makers[key]
            while not await wait_for(self._node, over, FOLLOW_PERIOD):
                progress.check_wanted()
                progress.follow(maker)
            if over.result():
                progress.follow(maker)
                return
            progress.check_wanted()
        over = Future(executor=self._node.executor)
        self._makers[key] = progress, over
        made = False
        try:
            await make()
            made = True
        finally:
            del self._makers[key]
            over.set_result(made)
