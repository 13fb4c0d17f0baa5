"""The worker processes of a node, and the chunks of drops that they simulate."""

from collections.abc import AsyncGenerator
from concurrent.futures import Future as PoolFuture
from contextlib import closing, suppress

from rclpy.node import Node

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.ros.callbacks import await_future
from resting_aspects_ros.simulation.chunks import drop_chunks
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.process_workers import ProcessWorkers
from resting_aspects_ros.simulation.run_description import RunDescription


class AsyncWorkers:
    """Processes that are shared by all goals of a node, chunk by chunk.

    count : int
        How many processes.
    died : int
        How many were replaced because they died.
    """

    def __init__(self, node: Node, count: int) -> None:
        self._node = node
        self.count = count
        self.died = 0
        self._processes = ProcessWorkers(count)

    def stop(self) -> None:
        """End the processes; what they are dropping is given up."""
        self._processes.stop()

    async def chunks(
        self, job: DropJob, asked: RunDescription
    ) -> AsyncGenerator[RestingPoses, None]:
        """Chunks of drops in their order; EngineError if the workers fail or die."""
        try:
            with closing(drop_chunks(job, asked, self._processes, self._warn)) as steps:
                for step in steps:
                    if isinstance(step, PoolFuture):
                        await _done(self._node, step)
                    else:
                        yield step
        except EngineError as error:
            raise EngineError(f'{error}; what was done until then is kept') from error

    def _warn(self, death: str) -> None:
        self.died += 1
        self._node.get_logger().warning(death)


async def _done(node: Node, chunk: 'PoolFuture[RestingPoses]') -> None:
    """Wait for a worker; what it raises is for who takes the chunk."""
    with suppress(Exception):
        await await_future(node, chunk)
