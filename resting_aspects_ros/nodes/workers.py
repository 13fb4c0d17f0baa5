"""The worker processes of a node that drops, and how their chunks are awaited."""

from collections.abc import AsyncGenerator
from concurrent.futures import Future as PoolFuture
from concurrent.futures.process import BrokenProcessPool

from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.campaign import make_pool, stop_pool, submit_drops
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.run import RunDescription

# Workers that die are replaced, until so many died without a drop between.
MOST_DEATHS = 2


class Workers:
    """A pool of processes, shared by all goals of a node chunk by chunk; replaced if one dies.

    count : int
        How many processes.
    """

    def __init__(self, node: Node, count: int) -> None:
        self._node = node
        self.count = count
        self._pool = make_pool(count)

    def stop(self) -> None:
        """End the processes; what they are dropping is given up."""
        stop_pool(self._pool)

    async def chunks(
        self, job: DropJob, asked: RunDescription
    ) -> AsyncGenerator[RestingPoses, None]:
        """Chunks of drops in their order, from new workers if one dies; EngineError if all do."""
        first, deaths = asked.first_drop, 0
        while first < asked.end:
            pool = self._pool
            futures = submit_drops(job, first, asked.end - first, pool, 2 * self.count)
            try:
                for future in futures:
                    chunk = await self._chunk(future)
                    first, deaths = chunk.end, 0
                    yield chunk
            except BrokenProcessPool:
                # All that was submitted fails; the first goal to see it makes the new pool.
                if self._pool is pool:
                    self._pool = make_pool(self.count)
                deaths += 1
                self._node.get_logger().warning(f'a worker died near drop {first} of {asked.part}')
                if deaths == MOST_DEATHS:
                    raise EngineError(
                        f'{deaths} worker processes died in a row near drop {first} of '
                        f'{asked.part}; what was done until then is kept'
                    ) from None
            finally:
                futures.close()

    async def _chunk(self, future: 'PoolFuture[RestingPoses]') -> RestingPoses:
        """Wait for a worker without holding up the node."""
        done = Future(executor=self._node.executor)

        def wake(_: object) -> None:
            # From a thread of the pool; the node may be gone by then.
            if (executor := self._node.executor) is not None:
                done.set_result(None)
                executor.wake()

        future.add_done_callback(wake)
        await done
        return future.result()
