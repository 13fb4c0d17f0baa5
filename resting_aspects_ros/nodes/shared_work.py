"""Work that several ask for at the same time, and that is done once."""

from collections.abc import Awaitable, Callable, Hashable
from typing import Generic, TypeVar

from rclpy.node import Node
from rclpy.task import Future

Outcome = TypeVar('Outcome')


class SharedWork(Generic[Outcome]):
    """Does work under a key; who asks for the same meanwhile gets the same outcome."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._under_way: dict[Hashable, Future] = {}

    async def do(self, key: Hashable, work: Callable[[], Awaitable[Outcome]]) -> Outcome:
        """The outcome of the work, or of that which was under way; raises what the work raises.

        What was begun for another and failed, or was canceled, is begun anew.
        """
        while key in self._under_way:
            done, outcome = await self._under_way[key]
            if done:
                return outcome
        over = self._under_way[key] = Future(executor=self._node.executor)
        end: tuple[bool, Outcome | None] = (False, None)
        try:
            outcome = await work()
            end = (True, outcome)
        finally:
            del self._under_way[key]
            over.set_result(end)
        return outcome
