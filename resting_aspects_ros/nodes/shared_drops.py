"""Drops that several goals ask for at the same time, and that are made once."""

from collections.abc import Awaitable, Callable, Hashable

from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.nodes.goal_progress import GoalProgress
from resting_aspects_ros.nodes.requests import CanceledError
from resting_aspects_ros.nodes.waiting import wait_for

# How often a goal that follows another one looks how far that is, s.
FOLLOW_PERIOD = 0.5


class SharedDrops:
    """Makes drops under a key; who asks for the same meanwhile follows the goal that does."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._makers: dict[Hashable, tuple[GoalProgress, Future]] = {}

    async def make(
        self,
        key: Hashable,
        progress: GoalProgress,
        make: Callable[[], Awaitable[None]],
        *,
        new: bool,
    ) -> None:
        """Fill the progress of a goal, by its own drops or by those that are under way.

        Raises what ``make`` raises, and CanceledError if the goal is canceled; the one that it
        follows goes on. If a new run that it follows is canceled, so is it; other drops that were
        begun for another and failed, or were canceled, are begun anew.
        """
        while key in self._makers:
            maker, over = self._makers[key]
            while not await wait_for(self._node, over, FOLLOW_PERIOD):
                progress.check_wanted()
                progress.follow(maker)
            ended = over.result()
            if ended is True:
                progress.follow(maker)
                return
            progress.check_wanted()
            if new and isinstance(ended, CanceledError):
                progress.follow(maker)
                raise ended
        over = Future(executor=self._node.executor)
        self._makers[key] = progress, over
        outcome: object = False
        try:
            await make()
            outcome = True
        except CanceledError as error:
            outcome = CanceledError(str(error))
            raise
        finally:
            del self._makers[key]
            over.set_result(outcome)
