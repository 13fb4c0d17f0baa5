"""Model ranges of the known distributions, which are found in a process of their own."""

import dataclasses

from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.api.model_range import missing_in, model_range_of
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.nodes.aspect_classifier.counting import Tally
from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.simulation.conditions import Surfaces


class ModelRanges:
    """Adds the model range to distributions; a failure is logged, and the range is then missing.

    Parameters
    ----------
    surfaces : with the uncertainty of their conditions, which no message has
    worker : makes the drops over this uncertainty
    """

    def __init__(
        self, node: Node, parts: PartRegistry, surfaces: Surfaces, worker: FileWorker
    ) -> None:
        self._node = node
        self._parts = parts
        self._surfaces = surfaces
        self._worker = worker
        self._active: dict[int, Future] = {}  # by the id of the distribution

    async def add(self, tally: Tally) -> None:
        """Add the range of the drops that are counted now, unless it is known."""
        given, run = tally.counted, tally.run
        missing = given.model is None and given.drops and not missing_in(run, self._surfaces)
        if not missing or self._parts.aspects(run.part_sha256) is None:
            return
        if (active := self._active.get(id(given))) is not None:
            await active
            return
        finished = self._active[id(given)] = Future(executor=self._node.executor)
        try:
            part, _ = self._parts.version(run.part_sha256)
            found = await self._worker.run(model_range_of, given, part, run, self._surfaces)
        except RestingAspectsError as error:
            self._node.get_logger().warning(
                f'the model range of run {run.run_id} is missing: {error}'
            )
            return
        finally:
            del self._active[id(given)]
            finished.set_result(None)
        if tally.distribution is given:
            # Only the range: the worker has copies of the aspects.
            tally.distribution = dataclasses.replace(given, model=found.model)
