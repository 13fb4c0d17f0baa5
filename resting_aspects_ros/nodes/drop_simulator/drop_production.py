"""Production of drops: the workers of a node, and the batches that it publishes."""

from collections.abc import AsyncGenerator, Callable
from concurrent.futures import Future as PoolFuture
from contextlib import aclosing, closing

from rclpy.node import Node
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg

from resting_aspects_ros.api.conditions import aspects_in
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.nodes.drop_simulator.shared_drops import CANCEL_PERIOD, GoalDrops
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.batching import PoseBatches
from resting_aspects_ros.ros.callbacks import advertise, ros_future, wait_for
from resting_aspects_ros.ros.conversions import poses_msg
from resting_aspects_ros.ros.diagnostics import RateCounter
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.formatting import progress_text
from resting_aspects_ros.ros.interface import POSES, RESTING_POSES, batch_size
from resting_aspects_ros.ros.status import CanceledError
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.workers import LocalWorkers, drop_chunks
from resting_aspects_ros.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.statistics.poses import RestingPoses


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
        self,
        job: DropJob,
        requested: RunDescription,
        stopped: Callable[[], bool] = lambda: False,
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


class DropProducer:
    """Makes the drops of goals and publishes them on resting_poses.

    drops : counter of all drops made

    Parameters
    ----------
    files : finds the aspects of parts
    frame : frame of the published poses
    """

    def __init__(self, node: Node, workers: AsyncWorkers, files: FileWorker, frame: str) -> None:
        self._node = node
        self._workers = workers
        self._files = files
        self._frame = frame
        self._aspects = AspectSet('', ())  # of the part that stopped at a precision last
        self._publisher = advertise(node, RestingPosesMsg, RESTING_POSES, POSES)
        self.drops = RateCounter()

    async def produce(
        self, drops: GoalDrops, part: Part, job: DropJob, run: RunDescription, *, is_new: bool
    ) -> None:
        """Make and publish drops of a run.

        is_new : whether the last of them ends the run; drops that fill a gap of a run do not
        """
        requested = drops.requested
        batches = PoseBatches(batch_size(requested.drops))
        try:
            total = None
            if requested.precision:
                total = no_drops(aspects_in(job.scene, await self._find_aspects(part)))
            async with aclosing(self._workers.chunks(job, requested)) as chunks:
                async for chunk in chunks:
                    self.drops.add(len(chunk))
                    for batch in batches.add(chunk):
                        self._publish(batch, run, last=False)
                    drops.add(chunk)
                    if total is not None:
                        total += count_poses(total.aspects, chunk)
                        if total.stops(requested.precision, requested.drops):
                            break
                    done = drops.result.drops
                    if not drops.wanted and done < requested.drops:
                        raise CanceledError(
                            f'canceled after {progress_text(requested, done)}; these are kept'
                        )
        except EngineError as error:
            raise EngineError(f'{error}; the drops made before are kept') from error
        finally:
            self._publish(batches.remaining(requested.first_drop), run, last=is_new)

    async def _find_aspects(self, part: Part) -> AspectSet:
        """Return the aspects of a part; cached, since a large mesh takes seconds."""
        if self._aspects.part_sha256 != part.part_sha256:
            self._aspects = await self._files.run(find_aspects, part)
        return self._aspects

    def _publish(self, batch: RestingPoses, run: RunDescription, last: bool) -> None:
        stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(poses_msg(batch, run, stamp, last, self._frame))
