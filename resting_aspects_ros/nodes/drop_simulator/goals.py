"""What the actions of the simulator share: workers, goals, and the surroundings of runs."""

from collections.abc import AsyncGenerator, Awaitable, Callable, Sized
from concurrent.futures import Future as PoolFuture
from contextlib import closing
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import Status, SurroundingsDescription

from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.nodes.drop_simulator.part_publisher import PartPublisher
from resting_aspects_ros.ros.callbacks import advertise, ros_future, wait_for
from resting_aspects_ros.ros.conversions import description_msg, status
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import ACTION_SERVICES, SURROUNDINGS, SURROUNDINGS_QOS
from resting_aspects_ros.ros.status import BusyError, CanceledError, error_status
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.scene import Scene
from resting_aspects_ros.simulation.workers import LocalWorkers, drop_chunks
from resting_aspects_ros.statistics.poses import RestingPoses

# Maximum number of concurrent goals of an action; all goals share the workers chunk by chunk.
MAX_GOALS = 16
# Time for which a result is kept for a client that requests it late, s.
RESULT_TIMEOUT = 300
# Interval at which a goal that waits checks whether it was canceled, s.
CANCEL_PERIOD = 0.5


class AsyncWorkers:
    """Workers of this machine, which all goals of a node share chunk by chunk.

    count : int
        Number of workers.
    """

    def __init__(self, node: Node, count: int) -> None:
        self._node = node
        self.count = count
        self._workers = LocalWorkers(count)

    @property
    def deaths(self) -> int:
        """Number of processes that died and were replaced."""
        return self._workers.replaced

    def stop(self) -> None:
        """End the workers and abandon their chunks."""
        self._workers.stop()

    async def chunks(
        self, job: DropJob, requested: RunDescription, stopped: Callable[[], bool]
    ) -> AsyncGenerator[RestingPoses, None]:
        """Yield chunks of drops in order; raises EngineError if the workers fail or die.

        Ends early if ``stopped`` returns True, also while a chunk is simulated.
        """
        with closing(drop_chunks(job, requested, self._workers, self._warn)) as steps:
            for step in steps:
                if not isinstance(step, PoolFuture):
                    yield step
                    continue
                done = ros_future(self._node, step)  # drop_chunks handles its exception
                while not (stopped() or await wait_for(self._node, done, CANCEL_PERIOD)):
                    pass
                if stopped():
                    return

    def _warn(self, death: str) -> None:
        self._node.get_logger().warning(death)


class SurroundingsPublisher:
    """Publishes surroundings/<part> before the first drop of each run in surroundings.

    Parameters
    ----------
    frame : frame of the published poses
    """

    def __init__(self, node: Node, frame: str) -> None:
        self._node = node
        self._frame = frame
        self._publishers: dict[str, Publisher] = {}

    def publish(self, run: RunDescription, scene: Scene) -> None:
        """Publish the surroundings of a new run; nothing for the infinite level plane."""
        if scene.level:
            return
        if run.part not in self._publishers:
            topic = f'{SURROUNDINGS}/{run.part}'
            self._publishers[run.part] = advertise(
                self._node, SurroundingsDescription, topic, SURROUNDINGS_QOS
            )
        self._publishers[run.part].publish(description_msg(run, scene, self._frame))


class GoalServer:
    """Serves an action; goals of all actions share the workers chunk by chunk.

    Parameters
    ----------
    kind, name : type and name of the action
    files : computes what could block the node, such as the aspects of a large mesh
    conditions : returns the conditions that a goal requests
    surroundings : publishes those of new runs
    frame : frame of the published poses
    """

    def __init__(
        self,
        kind: Any,
        name: str,
        node: Node,
        parts: PartPublisher,
        workers: AsyncWorkers,
        files: FileWorker,
        conditions: Callable[[Any], Awaitable[DropConditions]],
        surroundings: SurroundingsPublisher,
        frame: str,
    ) -> None:
        self._kind, self._name = kind, name
        self._node = node
        self._parts = parts
        self._workers = workers
        self._files = files
        self._conditions = conditions
        self._surroundings = surroundings
        self._frame = frame
        self._server = ActionServer(
            node,
            kind,
            name,
            self._execute,
            # By default, rclpy rejects every cancel request.
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            **ACTION_SERVICES,
        )

    def destroy(self) -> None:
        """Destroy the action server."""
        self._server.destroy()

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Return the result of a goal with its status, and set the state of the goal."""
        result = self._kind.Result()
        try:
            result, error = await self._answer(handle)
            if error is not None:
                raise error
            handle.succeed()
        except CanceledError as error:
            result.status = error_status(error)
            handle.canceled()
        except RestingAspectsError as error:
            result.status = error_status(error)
            handle.abort()
        except InvalidHandle:
            result.status = status(Status.FAILED, 'the node has stopped')  # it cannot be sent
        except Exception as error:  # noqa: BLE001 - a defect must not look like an answer
            self._node.get_logger().error(f'{self._name} failed: {error!r}')
            result.status = status(Status.FAILED, f'unexpected error {error!r}')
            handle.abort()
        return result

    async def _answer(self, handle: ServerGoalHandle) -> tuple[Any, Exception | None]:
        """Return the result of a goal, and the error that ended it early, if any."""
        raise NotImplementedError

    def _check_number(self, active: Sized) -> None:
        """Raise BusyError if as many goals are active as the action allows."""
        if len(active) >= MAX_GOALS:
            raise BusyError(f'{MAX_GOALS} {self._name} goals are active, try again later')
