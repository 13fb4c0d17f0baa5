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
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.config_files import parts_folder, surfaces_file
from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import count_poses, no_drops
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.ceiling import most_drops
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.part_library import PartLibrary
from resting_aspects_ros.drops.plan import plan_run
from resting_aspects_ros.drops.run import RunDescription, check_run_id
from resting_aspects_ros.drops.surfaces import Surfaces
from resting_aspects_ros.drops.worker_pool import MAX_WORKERS, default_workers
from resting_aspects_ros.nodes.batches import Batches
from resting_aspects_ros.nodes.callbacks import advertise
from resting_aspects_ros.nodes.convert import poses_msg, status
from resting_aspects_ros.nodes.default_conditions import SURFACE, OfferedDefault
from resting_aspects_ros.nodes.diagnostics import Diagnosis, Meter, publish_diagnostics
from resting_aspects_ros.nodes.goal_progress import GoalProgress
from resting_aspects_ros.nodes.interface import (
    ACTION_SERVICES,
    DROP_PART,
    DROP_SIMULATOR,
    POSES,
    RESTING_POSES,
    batch_size,
)
from resting_aspects_ros.nodes.parameters import Parameter, declare
from resting_aspects_ros.nodes.part_offers import PartOffers
from resting_aspects_ros.nodes.presence import Alone
from resting_aspects_ros.nodes.recordings import Recordings
from resting_aspects_ros.nodes.requests import (
    BusyError,
    CanceledError,
    asked_conditions,
    error_status,
)
from resting_aspects_ros.nodes.shared_drops import SharedDrops
from resting_aspects_ros.nodes.simulated_runs import SimulatedRuns
from resting_aspects_ros.nodes.spin import run_node
from resting_aspects_ros.nodes.words import counted, listed, of_run, run_values, under_way
from resting_aspects_ros.nodes.workers import Workers

PARAMETERS = (
    Parameter('parts_folder', '', 'folder of meshes that can be asked for; empty: the examples'),
    Parameter('surfaces_file', '', 'YAML file of named conditions; empty: the one of the suite'),
    SURFACE,
    Parameter('workers', 0, 'processes that drop; 0: one per core', (0, MAX_WORKERS)),
)
# Goals that are worked on at the same time; they share the workers chunk by chunk.
MOST_GOALS = 16
# A result is kept so long for a client that asks late, s.
RESULT_TIMEOUT = 300


class DropSimulator(Node):
    """Serves drop_part; publishes parts/<part>, resting_poses and default_conditions."""

    def __init__(self) -> None:
        super().__init__(DROP_SIMULATOR)
        values = declare(self, PARAMETERS)
        self._library = PartLibrary(_folder(values['parts_folder'] or parts_folder()))
        self._surfaces = Surfaces.read(Path(values['surfaces_file'] or surfaces_file()))
        self._default = OfferedDefault(self, self._surfaces)
        self._workers = Workers(self, values['workers'] or default_workers())
        self._goals: list[GoalProgress] = []
        self._runs = SimulatedRuns()
        self._shared = SharedDrops(self)
        self._counted_with = AspectSet('', ())
        self._drops = Meter()
        self._recordings = Recordings(self)
        self._poses = advertise(self, RestingPosesMsg, RESTING_POSES, POSES)
        self._parts = PartOffers(self, self._library)
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
        publish_diagnostics(self, self._diagnose, Alone(self, DROP_SIMULATOR))
        parts = counted(len(self._parts), 'part', 'parts')
        workers = counted(self._workers.count, 'worker', 'workers')
        self.get_logger().info(f'ready: {parts}, {workers}')

    def destroy_node(self) -> None:
        """Also ends the workers; what they are dropping is given up."""
        self._workers.stop()
        self._server.destroy()
        super().destroy_node()

    async def _execute(self, handle: ServerGoalHandle) -> DropPart.Result:
        progress = GoalProgress(handle)
        self._goals.append(progress)
        try:
            await self._drop_and_note(handle, progress)
            said = status(Status.OK)
            handle.succeed()
        except CanceledError as error:
            said = error_status(error)
            # Where the run of another goal was canceled, this goal was not.
            end = handle.canceled if handle.is_cancel_requested else handle.abort
            end()
        except RestingAspectsError as error:
            said = error_status(error)
            handle.abort()
        except InvalidHandle:
            said = status(Status.FAILED, 'the node has ended')  # nobody can be told
        except Exception as error:  # noqa: BLE001 - the edge: a defect must not look like an answer
            self.get_logger().error(f'drop_part failed: {error!r}')
            said = status(Status.FAILED, f'unexpected: {error!r}')
            handle.abort()
        finally:
            self._goals.remove(progress)
        progress.result.status = said
        return progress.result

    async def _drop_and_note(self, handle: ServerGoalHandle, progress: GoalProgress) -> None:
        try:
            await self._drop(handle, progress)
        finally:
            await self._recordings.note(progress.result)

    async def _drop(self, handle: ServerGoalHandle, progress: GoalProgress) -> None:
        """Make the drops of a goal and publish them; fills the result as it goes."""
        job, asked, run = self._plan(handle.request)
        progress.result.run_id = handle.request.run_id
        # What one consumer has lost others often have lost, too, and each asks for it.
        key = (
            handle.request.run_id,
            run.part,
            *run.sequence(),
            asked.first_drop,
            asked.end,
            asked.precision,
        )
        drop = partial(self._make, handle, progress, job, asked, run)
        await self._shared.make(key, progress, drop, new=not handle.request.run_id)

    async def _make(
        self,
        handle: ServerGoalHandle,
        progress: GoalProgress,
        job: DropJob,
        asked: RunDescription,
        run: RunDescription,
    ) -> None:
        if sum(each.so_far is not None for each in self._goals) >= MOST_GOALS:
            raise BusyError(f'{MOST_GOALS} drop_part goals are under way, try again later')
        progress.begin(asked)
        # Of a new run, or of one that is taken up again where another simulator left it.
        ends_run = asked.end == run.end
        batches = Batches(batch_size(asked.drops))
        counted = no_drops(self._aspects(asked)) if asked.precision else None
        try:
            if ends_run:
                self._runs.reached(run, asked.first_drop)
            async with aclosing(self._workers.chunks(job, asked)) as chunks:
                async for chunk in chunks:
                    self._drops.add(len(chunk))
                    for batch in batches.add(chunk):
                        self._publish(batch, run, last=False)
                        if ends_run:
                            self._runs.reached(run, batch.end)
                    progress.add(chunk)
                    if counted is not None:
                        counted += count_poses(counted.aspects, chunk)
                        if counted.stops(asked.precision, asked.drops):
                            break
                    done = progress.result.drops
                    if handle.is_cancel_requested and done < asked.drops:
                        raise CanceledError(
                            f'canceled after {of_run(asked, done)}; those are kept'
                        )
        finally:
            # Drops that fill a gap do not end their run.
            self._publish(batches.rest(asked.first_drop), run, last=ends_run)
            if ends_run:
                self._runs.over(run)

    def _diagnose(self) -> Diagnosis:
        begun = [(p.so_far, p.rate) for p in self._goals if p.so_far is not None]
        runs = [so_far for so_far, _ in begun]
        # Drops come in chunks: of a part that takes long there is none in most seconds.
        rates = {f'drops per second of run {k}': f'{r:.1f}' for k, (_, r) in enumerate(begun, 1)}
        not_offered = self._parts.not_offered
        values = {
            'drops made': self._drops.total,
            'drops per second': self._drops.rate(),
            'workers': self._workers.count,
            'workers that died': self._workers.died,
            'parts offered': len(self._parts),
            **run_values(runs),
            **listed(rates),
            **listed({f'not offered: {name}': why for name, why in not_offered.items()}),
        }
        words = counted(len(not_offered), 'mesh is not offered', 'meshes are not offered')
        return Diagnosis(under_way(runs), values, [words] if not_offered else [])

    def _aspects(self, run: RunDescription) -> AspectSet:
        """Those of the run's part; kept, since a large mesh takes seconds."""
        if self._counted_with.part_sha256 != run.part_sha256:
            self._counted_with = find_aspects(self._library.load(run.part))
        return self._counted_with

    def _plan(self, goal: DropPart.Goal) -> tuple[DropJob, RunDescription, RunDescription]:
        """The job, the drops that the goal asks for, and the run that they are part of."""
        check_run_id(goal.run_id)
        part = self._library.load(goal.part)
        job, asked = plan_run(
            part,
            asked_conditions(
                self._surfaces, goal.surface, goal.conditions, self._default.conditions
            ),
            seed=goal.seed,
            drops=most_drops(goal.drops, goal.precision),
            first_drop=goal.first_drop,
            precision=goal.precision,
            run_id=goal.run_id or uuid.uuid4().hex[:12],
            started=time.time_ns(),  # not ROS time, which may stand still
        )
        run = self._runs.find(goal, asked)
        self._parts.offer(part)
        return job, asked, run

    def _publish(self, batch: RestingPoses, run: RunDescription, last: bool) -> None:
        self._poses.publish(poses_msg(batch, run, self.get_clock().now().to_msg(), last))


def _folder(path: str | Path) -> Path:
    if not Path(path).is_dir():
        raise InvalidValueError(f'parts_folder is {str(path)!r}, must be a folder that is there')
    return Path(path)


def main() -> int:
    """Run the node alone in this process."""
    return run_node(DropSimulator, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
