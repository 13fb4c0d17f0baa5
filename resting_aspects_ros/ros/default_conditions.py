"""Default conditions of requests without a surface: a simulator parameter, published latched."""

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg

from resting_aspects_ros.ros.callbacks import advertise, subscribe, wait_for
from resting_aspects_ros.ros.conversions import conditions_from, conditions_msg
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, LATCHED
from resting_aspects_ros.ros.parameters import Parameter, on_change
from resting_aspects_ros.ros.status import NotAvailableError
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions, Surfaces

SURFACE = Parameter(
    'surface',
    DEFAULT_SURFACE,
    'surface of requests that do not name one',
    allowed='a name in surfaces_file',
    changeable=True,
)
# Timeout for the latched message of a discovered simulator, s.
RECEIVE_TIMEOUT = 10.0


class DefaultConditionsPublisher:
    """Publishes the conditions of the parameter `surface` as default_conditions."""

    def __init__(self, node: Node, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._publisher = advertise(node, DropConditionsMsg, DEFAULT_CONDITIONS, LATCHED)
        on_change(node, SURFACE.name, surfaces.get, self._publish)
        self._publish(node.get_parameter(SURFACE.name).value)

    @property
    def conditions(self) -> DropConditions:
        """The conditions of a request that does not name a surface."""
        return self._conditions

    def _publish(self, name: str) -> None:
        self._conditions = self._surfaces.get(name)
        self._publisher.publish(conditions_msg(self._conditions))


class DefaultConditionsSubscriber:
    """Receives default_conditions of the simulator in the namespace of a node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._conditions: DropConditions | None = None
        self._received = Future()  # done with the first message
        subscribe(node, DropConditionsMsg, DEFAULT_CONDITIONS, self._receive, LATCHED)

    @property
    def is_received(self) -> bool:
        """Whether a simulator has published its default conditions."""
        return self._conditions is not None

    async def conditions(self) -> DropConditions:
        """Return the conditions of a request that does not name a surface.

        Waits for the message of a discovered simulator. Raises NotAvailableError if no simulator
        has published the conditions yet.
        """
        if self._node.count_publishers(DEFAULT_CONDITIONS):
            await wait_for(self._node, self._received, RECEIVE_TIMEOUT)
        if self._conditions is None:
            raise NotAvailableError(
                'no drop_simulator has published its default surface yet: name a surface, or '
                'start drop_simulator'
            )
        return self._conditions

    def _receive(self, message: DropConditionsMsg) -> None:
        self._conditions = conditions_from(message)
        if not self._received.done():
            self._received.set_result(None)
