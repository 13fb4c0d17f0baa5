"""Find the part that a request names, also while parts come in."""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.nodes.known_parts import KnownParts, asked_part
from resting_aspects_ros.nodes.waiting import wait_for

# While parts come in, one that is asked for is looked for this often, s.
PERIOD = 0.1


class PartLookup:
    """The parts that can be asked about.

    simulator_is_there : tells whether what it offers now is what counts
    """

    def __init__(
        self, node: Node, parts: KnownParts, simulator_is_there: Callable[[], bool]
    ) -> None:
        self._node = node
        self._parts = parts
        self.simulator_is_there = simulator_is_there

    async def parts(self, name: str) -> dict[str, Part]:
        """All by name; waits for that one while parts come in."""
        never = Future(executor=self._node.executor)
        while True:
            parts = self._parts.usable(self.simulator_is_there())
            if name in parts or not self._parts.come_in():
                return parts
            await wait_for(self._node, never, PERIOD)

    async def part(self, name: str) -> tuple[Part, AspectSet]:
        """The part of a name and its aspects; raises UnknownPartError."""
        part = asked_part(await self.parts(name), name)
        return self._parts.version(part.part_sha256)
