"""Requests of the classifier to the simulator, on behalf of the clients of its service."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.ros.callbacks import sleep_for, wait_for
from resting_aspects_ros.ros.goal_client import goal_result
from resting_aspects_ros.ros.interface import ACTION_SERVICES, DROP_PART
from resting_aspects_ros.ros.liveliness import LivelinessMonitor
from resting_aspects_ros.ros.status import NotAvailableError, status_error

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.aspect_classifier.distribution_store import RunCounts

# Time after the start of the node within which a simulator that was started together with it is
# ready, s. After that time, a running simulator is discovered within DISCOVERY_TIMEOUT, s.
STARTUP_TIMEOUT = 10.0
DISCOVERY_TIMEOUT = 2.0
SERVER_PERIOD = 0.1
# The simulator sends all batches before the result of the goal. Timeout for them to arrive, which
# includes requests for lost batches, s.
BATCHES_TIMEOUT = 120.0


class DropRequests:
    """Sends drop_part goals and waits until their poses are counted.

    Parameters
    ----------
    simulators : monitor of the simulators that are ready
    finished : returns the future of the counts of a run by its id, done when the run is finished
    """

    def __init__(
        self, node: Node, simulators: LivelinessMonitor, finished: Callable[[str], Future]
    ) -> None:
        self._node = node
        self._simulators = simulators
        self._finished = finished
        self._client = ActionClient(node, DropPart, DROP_PART, **ACTION_SERVICES)
        self._start = time.monotonic()

    def destroy(self) -> None:
        """Destroy the action client."""
        self._client.destroy()

    def simulator_is_ready(self) -> bool:
        """Return whether a goal can be sent now."""
        return bool(self._simulators.count and self._client.server_is_ready())

    async def drop(self, goal: DropPart.Goal) -> 'RunCounts':
        """Return the counts of a run of these drops; raises the error of the simulator."""
        await self.wait_for_simulator()
        result = await goal_result(self._node, self._client, goal)
        if result.status.code != Status.OK:
            raise status_error(result.status)
        finished = self._finished(result.run_id)
        if not await wait_for(self._node, finished, BATCHES_TIMEOUT):
            raise EngineError(
                f'the poses of run {result.run_id} did not arrive within {BATCHES_TIMEOUT:g} s'
            )
        counts: RunCounts = finished.result()
        if counts.problem:
            raise EngineError(counts.problem)
        return counts

    async def wait_for_simulator(self) -> None:
        """Wait until a simulator is ready; raises NotAvailableError after a timeout."""
        begin = time.monotonic()
        end = max(begin + DISCOVERY_TIMEOUT, self._start + STARTUP_TIMEOUT)
        while not self.simulator_is_ready():
            if time.monotonic() >= end:
                raise NotAvailableError(
                    f'no drop_simulator answers on {self._node.resolve_service_name(DROP_PART)}, '
                    f'waited {end - begin:.0f} s: start drop_simulator'
                )
            await sleep_for(self._node, SERVER_PERIOD)
