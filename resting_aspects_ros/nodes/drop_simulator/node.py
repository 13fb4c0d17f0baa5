"""The node that drops parts: it offers them, drops them, and publishes where they rest."""

import sys
import time
import uuid
from contextlib import aclosing
from functools import partial
from pathlib import Path

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.core.input_file import is_folder
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.core.statistics.stopping import max_drops
from resting_aspects_ros.nodes.drop_simulator.async_workers import AsyncWorkers
from resting_aspects_ros.nodes.drop_simulator.part_publisher import PartPublisher
from resting_aspects_ros.nodes.drop_simulator.shared_drops import (
    GoalDrops,
    PublishedRuns,
    SharedDrops,
)
from resting_aspects_ros.ros.batching import PoseBatches
from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.conversions import poses_msg, status
from resting_aspects_ros.ros.default_conditions import SURFACE, DefaultConditionsPublisher
from resting_aspects_ros.ros.diagnostics import Diagnosis, RateCounter, publish_diagnostics
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.formatting import (
    active_runs_text,
    count_text,
    progress_text,
    run_values,
    truncated,
)
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    DROP_PART,
    DROP_SIMULATOR,
    POSES,
    RESTING_POSES,
    batch_size,
)
from resting_aspects_ros.ros.liveliness import DuplicateNodeDetector
from resting_aspects_ros.ros.parameters import FRAME_ID, Parameter, check_frame, declare
from resting_aspects_ros.ros.spin import run_node
from resting_aspects_ros.ros.status import (
    BusyError,
    CanceledError,
    error_status,
    requested_conditions,
)
from resting_aspects_ros.simulation.config_files import parts_folder, surfaces_file
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.plan import plan_run
from resting_aspects_ros.simulation.process_workers import MAX_WORKERS, default_workers
from resting_aspects_ros.simulation.run_description import MAX_DROPS, RunDescription, check_run_id
from resting_aspects_ros.simulation.surfaces import Surfaces

PARAMETERS = (
    Parameter('parts_folder', '', 'folder of meshes that can be asked for; empty: the examples'),
    Parameter('surfaces_file', '', 'YAML file of named conditions; empty: the one of the suite'),
    SURFACE,
    FRAME_ID,
    Parameter('workers', 0, 'processes that drop; 0: one per core', (0, MAX_WORKERS)),
)
# Goals that are worked on at the same time; they share the workers chunk by chunk.
MAX_GOALS = 16
# A result is kept so long for a client that asks late, s.
RESULT_TIMEOUT = 300


class DropSimulator(Node):
    """Serves drop_part; publishes parts/<part>, resting_poses and default_conditions."""

    def __init__(self) -> None:
        super().__init__(DROP_SIMULATOR)
        values = declare(self, PARAMETERS)
        folder = _folder(values['parts_folder'] or parts_folder())
        self._surfaces = Surfaces.read(Path(values['surfaces_file'] or surfaces_file()))
        self._frame = check_frame(values[FRAME_ID.name])
        self._default = DefaultConditionsPublisher(self, self._surfaces)
        self._workers = AsyncWorkers(self, values['workers'] or default_workers())
        self._files = FileWorker(self)
        self._runs = PublishedRuns()
        self._shared = SharedDrops(self)
        self._counted_with = AspectSet('', ())
        self._drops = RateCounter()
        self._poses = advertise(self, RestingPosesMsg, RESTING_POSES, POSES)
        self._parts = PartPublisher(self, folder, self._files)
        self._server = ActionServer(
            self,
            DropPart,
            DROP_PART,
            self._execute,
            # By default every cancel is refused.
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            **ACTION_SERVICES,
        )
        self._parts.ready.add_done_callback(self._announce)

    def destroy_node(self) -> None:
        """Also ends the workers; what they are dropping is given up."""
        self._workers.stop()
        self._files.stop()
        self._server.destroy()
        super().destroy_node()

    def _announce(self, _: Future) -> None:
        """All parts have been read."""
        publish_diagnostics(self, self._diagnose, DuplicateNodeDetector(self, DROP_SIMULATOR))
        parts = count_text(len(self._parts), 'part', 'parts')
        workers = count_text(self._workers.count, 'worker', 'workers')
        self.get_logger().info(f'ready: {parts}, {workers}')

    async def _execute(self, handle: ServerGoalHandle) -> DropPart.Result:
        result = DropPart.Result(run_id=handle.request.run_id)
        try:
            result, error = await self._drop(handle)
            if error is not None:
                raise error
            result.status = status(Status.OK)
            handle.succeed()
        except CanceledError as error:
            result.status = error_status(error)
            handle.canceled()
        except RestingAspectsError as error:
            result.status = error_status(error)
            handle.abort()
        except InvalidHandle:
            result.status = status(Status.FAILED, 'the node has ended')  # nobody can be told
        except Exception as error:  # noqa: BLE001 - the edge: a defect must not look like an answer
            self.get_logger().error(f'drop_part failed: {error!r}')
            result.status = status(Status.FAILED, f'unexpected error {error!r}')
            handle.abort()
        return result

    async def _drop(self, handle: ServerGoalHandle) -> tuple[DropPart.Result, Exception | None]:
        """Make the drops of a goal and publish them, unless another goal has begun the same."""
        goal = handle.request
        check_run_id(goal.run_id)
        part = await self._parts.get(goal.part)
        if handle.is_cancel_requested:
            raise CanceledError('canceled before the first drop')
        job, asked = self._plan(goal, part)
        run = self._runs.find(asked) if goal.run_id else asked
        # What one consumer has lost others often have lost, too, and each asks for it.
        key = (
            goal.run_id,
            run.part,
            *run.sequence(),
            asked.first_drop,
            asked.end,
            asked.precision,
        )
        if not self._shared.has(key) and len(self._shared.under_way()) >= MAX_GOALS:
            raise BusyError(f'{MAX_GOALS} drop_part goals are under way, try again later')
        make = partial(self._make, part=part, job=job, run=run, is_new=not goal.run_id)
        return await self._shared.make(key, handle, asked, make)

    async def _make(
        self,
        drops: GoalDrops,
        part: Part,
        job: DropJob,
        run: RunDescription,
        *,
        is_new: bool,
    ) -> None:
        """Make drops of a run; drops that fill a gap do not end their run."""
        if is_new:
            self._runs.begin(run)
        asked = drops.asked
        batches = PoseBatches(batch_size(asked.drops))
        total = no_drops(await self._aspects(part)) if asked.precision else None
        try:
            async with aclosing(self._workers.chunks(job, asked)) as chunks:
                async for chunk in chunks:
                    self._drops.add(len(chunk))
                    for batch in batches.add(chunk):
                        self._publish(batch, run, last=False)
                    drops.add(chunk)
                    if total is not None:
                        total += count_poses(total.aspects, chunk)
                        if total.stops(asked.precision, asked.drops):
                            break
                    done = drops.result.drops
                    if not drops.wanted and done < asked.drops:
                        raise CanceledError(
                            f'canceled after {progress_text(asked, done)}; those are kept'
                        )
        finally:
            self._publish(batches.rest(asked.first_drop), run, last=is_new)

    def _diagnose(self) -> Diagnosis:
        under_way = self._shared.under_way()
        runs = [(drops.asked, drops.result.drops) for drops in under_way]
        # Drops come in chunks: of a part that takes long there is none in most seconds.
        rates = {
            f'drops per second of run {k}': f'{drops.rate:.1f}'
            for k, drops in enumerate(under_way, 1)
        }
        not_offered = self._parts.not_offered
        values = {
            'drops made': self._drops.total,
            'drops per second': self._drops.rate(),
            'workers': self._workers.count,
            'workers that died': self._workers.died,
            'parts offered': len(self._parts),
            **run_values(runs),
            **truncated(rates),
            **truncated({f'not offered: {name}': why for name, why in not_offered.items()}),
        }
        words = count_text(len(not_offered), 'mesh is not offered', 'meshes are not offered')
        return Diagnosis(active_runs_text(runs), values, [words] if not_offered else [])

    async def _aspects(self, part: Part) -> AspectSet:
        """Return the aspects of a part; kept, since a large mesh takes seconds."""
        if self._counted_with.part_sha256 != part.part_sha256:
            self._counted_with = await self._files.run(find_aspects, part)
        return self._counted_with

    def _plan(self, goal: DropPart.Goal, part: Part) -> tuple[DropJob, RunDescription]:
        """Return the job, and the drops that the goal asks for."""
        return plan_run(
            part,
            requested_conditions(
                self._surfaces, goal.surface, goal.conditions, self._default.conditions
            ),
            seed=goal.seed,
            drops=max_drops(goal.drops, goal.precision, MAX_DROPS),
            first_drop=goal.first_drop,
            precision=goal.precision,
            run_id=goal.run_id or uuid.uuid4().hex[:12],
            started=time.time_ns(),  # not ROS time, which may stand still
        )

    def _publish(self, batch: RestingPoses, run: RunDescription, last: bool) -> None:
        self._poses.publish(
            poses_msg(batch, run, self.get_clock().now().to_msg(), last, self._frame)
        )


def _folder(path: str | Path) -> Path:
    if not is_folder(Path(path)):
        raise InvalidValueError(f'parts_folder is {str(path)!r}, must be a folder that is there')
    return Path(path)


def main() -> int:
    """Run the node alone in this process."""
    return run_node(DropSimulator, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
