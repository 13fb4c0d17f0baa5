"""What a request means that names no surface: what the simulator says, and all who hear it.

The nodes have a parameter each, and it would be easy to set one of them only. So the simulator
publishes what it means, latched, and the classifier goes by that as soon as it hears it.
"""

from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.surfaces import DEFAULT_SURFACE, Surfaces
from resting_aspects_ros.nodes.callbacks import advertise, subscribe
from resting_aspects_ros.nodes.convert import conditions_from, conditions_msg
from resting_aspects_ros.nodes.interface import DEFAULT_CONDITIONS, LATCHED
from resting_aspects_ros.nodes.parameters import Parameter, on_change
from resting_aspects_ros.nodes.waiting import wait_for

SURFACE = Parameter(
    'surface',
    DEFAULT_SURFACE,
    'surface of requests that name none',
    allowed='a name in surfaces_file',
    changeable=True,
)
# What is latched by a simulator that has been found comes within this, s.
HEAR_TIMEOUT = 10.0


class OfferedDefault:
    """The simulator's: its parameter `surface`, published as default_conditions."""

    def __init__(self, node: Node, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._publisher = advertise(node, DropConditionsMsg, DEFAULT_CONDITIONS, LATCHED)
        on_change(node, SURFACE.name, surfaces.get, self._take)
        self._take(node.get_parameter(SURFACE.name).value)

    @property
    def conditions(self) -> DropConditions:
        """Those of a request that names no surface."""
        return self._conditions

    def _take(self, name: str) -> None:
        self._conditions = self._surfaces.get(name)
        self._publisher.publish(conditions_msg(self._conditions))


class FollowedDefault:
    """The classifier's: what the simulator says, and until it is heard its own `surface`.

    The parameter is set to what is heard, and is not to be set otherwise while there is a
    simulator.
    """

    def __init__(self, node: Node, surfaces: Surfaces) -> None:
        self._node = node
        self._surfaces = surfaces
        self._conditions = surfaces.get(node.get_parameter(SURFACE.name).value)
        on_change(node, SURFACE.name, self._check, self._take)
        self._heard = Future()  # done with the first word of a simulator
        subscribe(node, DropConditionsMsg, DEFAULT_CONDITIONS, self._hear, LATCHED)

    @property
    def is_heard(self) -> bool:
        """Whether a simulator has said it."""
        return bool(self._heard.done())

    async def conditions(self) -> DropConditions:
        """Those of a request that names no surface; a simulator that is there is heard first."""
        if self._simulator_is_there():
            await wait_for(self._node, self._heard, HEAR_TIMEOUT)
        return self._conditions

    def _simulator_is_there(self) -> bool:
        return bool(self._node.count_publishers(DEFAULT_CONDITIONS))

    def _hear(self, message: DropConditionsMsg) -> None:
        conditions = conditions_from(message)
        if conditions.surface != self._conditions.surface:
            self._node.get_logger().info(
                f'surface is {conditions.surface!r}, as the simulator says; '
                f'it was {self._conditions.surface!r}'
            )
        self._conditions = conditions
        self._node.set_parameters([RosParameter(SURFACE.name, value=conditions.surface)])
        if not self.is_heard:
            self._heard.set_result(None)

    def _check(self, name: str) -> None:
        if name == self._conditions.surface:
            return  # the simulator may know names that this node does not
        self._surfaces.get(name)
        if self._simulator_is_there():
            raise InvalidValueError(
                f'surface is {name!r}, allowed is {self._conditions.surface!r} while '
                'drop_simulator is there, which says so: set it there'
            )

    def _take(self, name: str) -> None:
        if name != self._conditions.surface:
            self._conditions = self._surfaces.get(name)
