"""What a request means that names no surface: the simulator's parameter, published latched."""

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg

from resting_aspects_ros.ros.callbacks import advertise, subscribe, wait_for
from resting_aspects_ros.ros.conversions import conditions_from, conditions_msg
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, LATCHED
from resting_aspects_ros.ros.parameters import Parameter, on_change
from resting_aspects_ros.ros.status import NotAvailableError
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.surfaces import DEFAULT_SURFACE, Surfaces

SURFACE = Parameter(
    'surface',
    DEFAULT_SURFACE,
    'surface of requests that name none',
    allowed='a name in surfaces_file',
    changeable=True,
)
# The latched message of a simulator that has been discovered comes within this, s.
HEAR_TIMEOUT = 10.0


class DefaultConditionsPublisher:
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


class DefaultConditionsSubscriber:
    """What the simulator of a namespace published last as default_conditions."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._conditions: DropConditions | None = None
        self._heard = Future()  # done with the first message of a simulator
        subscribe(node, DropConditionsMsg, DEFAULT_CONDITIONS, self._hear, LATCHED)

    @property
    def is_heard(self) -> bool:
        """Whether a simulator has published it."""
        return self._conditions is not None

    async def conditions(self) -> DropConditions:
        """Return those of a request that names no surface; a simulator that exists is heard first.

        Raises NotAvailableError if no simulator was heard yet.
        """
        if self._node.count_publishers(DEFAULT_CONDITIONS):
            await wait_for(self._node, self._heard, HEAR_TIMEOUT)
        if self._conditions is None:
            raise NotAvailableError(
                'no drop_simulator has published its default surface yet: name a surface, or '
                'start drop_simulator'
            )
        return self._conditions

    def _hear(self, message: DropConditionsMsg) -> None:
        self._conditions = conditions_from(message)
        if not self._heard.done():
            self._heard.set_result(None)
