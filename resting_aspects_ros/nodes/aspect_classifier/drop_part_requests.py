"""How the classifier gets a part dropped for a client of its service."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.ros.callbacks import sleep_for, wait_for
from resting_aspects_ros.ros.drop_part_client import drop_result
from resting_aspects_ros.ros.interface import ACTION_SERVICES, DROP_PART
from resting_aspects_ros.ros.liveliness import LivelinessMonitor
from resting_aspects_ros.ros.status import NotAvailableError, status_error

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.aspect_classifier.distribution_store import RunCounts

# A simulator that is started together with the node may be ready this long after it, s. Later it
# exists, or nobody has started it: it is discovered within DISCOVERY, s.
STARTING = 10.0
DISCOVERY = 2.0
SERVER_PERIOD = 0.1
# All batches were sent before the goal's result; so long they have to arrive, or to be asked
# for again, s.
BATCHES_TIMEOUT = 120.0


class DropRequests:
    """Sends drop_part goals and waits until their poses have been counted.

    Parameters
    ----------
    simulators : those that are ready
    over : gives for a run id the future of its account, done when the run is over
    """

    def __init__(
        self, node: Node, simulators: LivelinessMonitor, over: Callable[[str], Future]
    ) -> None:
        self._node = node
        self._simulators = simulators
        self._over = over
        self._client = ActionClient(node, DropPart, DROP_PART, **ACTION_SERVICES)
        self._begun = time.monotonic()

    def destroy(self) -> None:
        """End the action client."""
        self._client.destroy()

    def simulator_is_there(self) -> bool:
        """Whether a goal can be sent now."""
        return bool(self._simulators.count and self._client.server_is_ready())

    async def drop(self, goal: DropPart.Goal) -> 'RunCounts':
        """Return the account of a run of these drops; raises what the simulator answers."""
        await self.simulator()
        result = await drop_result(self._node, self._client, goal)
        if result.status.code != Status.OK:
            raise status_error(result.status)
        over = self._over(result.run_id)
        if not await wait_for(self._node, over, BATCHES_TIMEOUT):
            raise EngineError(f'the poses of run {result.run_id} did not arrive')
        account: RunCounts = over.result()
        if account.problem:
            raise EngineError(account.problem)
        return account

    async def simulator(self) -> None:
        """Wait until a simulator is ready; NotAvailableError if none is."""
        asked = time.monotonic()
        end = max(asked + DISCOVERY, self._begun + STARTING)
        while not self.simulator_is_there():
            if time.monotonic() >= end:
                raise NotAvailableError(
                    f'no drop_simulator answers on {self._node.resolve_service_name(DROP_PART)}, '
                    f'waited {end - asked:.0f} s: start drop_simulator'
                )
            await sleep_for(self._node, SERVER_PERIOD)
