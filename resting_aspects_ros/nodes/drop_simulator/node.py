"""The drop_simulator node: offers parts, drops them and publishes their resting poses."""

import sys
import time
import uuid
from functools import partial
from pathlib import Path

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart, ReorientPart

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import is_folder
from resting_aspects_ros.nodes.drop_simulator.drop_production import AsyncWorkers, DropProducer
from resting_aspects_ros.nodes.drop_simulator.goal_execution import (
    MAX_GOALS,
    RESULT_TIMEOUT,
    execute_goal,
)
from resting_aspects_ros.nodes.drop_simulator.part_publisher import PartPublisher
from resting_aspects_ros.nodes.drop_simulator.reorientation import ReorientServer
from resting_aspects_ros.nodes.drop_simulator.shared_drops import (
    GoalDrops,
    PublishedRuns,
    SharedDrops,
)
from resting_aspects_ros.nodes.drop_simulator.surroundings_publisher import (
    SurroundingsPublisher,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.default_conditions import SURFACE, DefaultConditionsPublisher
from resting_aspects_ros.ros.diagnostics import Diagnosis, publish_diagnostics
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.formatting import (
    active_runs_text,
    count_text,
    run_values,
    truncated,
)
from resting_aspects_ros.ros.interface import ACTION_SERVICES, DROP_PART, DROP_SIMULATOR
from resting_aspects_ros.ros.liveliness import DuplicateNodeDetector
from resting_aspects_ros.ros.parameters import FRAME_ID, Parameter, check_frame, declare
from resting_aspects_ros.ros.requested_surroundings import (
    SURROUNDINGS_FOLDER,
    RequestedSurroundings,
)
from resting_aspects_ros.ros.spin import run_node
from resting_aspects_ros.ros.status import BusyError, CanceledError
from resting_aspects_ros.simulation.conditions import DropConditions, all_surfaces, parts_folder
from resting_aspects_ros.simulation.job import (
    MAX_DROPS,
    DropJob,
    RunDescription,
    check_run_id,
    plan_run,
)
from resting_aspects_ros.simulation.workers import MAX_WORKERS, default_workers
from resting_aspects_ros.statistics.intervals import max_drops

PARAMETERS = (
    Parameter('parts_folder', '', 'folder of meshes that are offered; empty: the examples'),
    Parameter('surfaces_file', '', 'YAML file of surfaces beside those of the suite'),
    SURROUNDINGS_FOLDER,
    SURFACE,
    FRAME_ID,
    Parameter('workers', 0, 'threads, or processes of Bullet; 0: one per core', (0, MAX_WORKERS)),
)


class DropSimulator(Node):
    """Serves drop_part and reorient_part.

    Publishes parts/<part>, surroundings/<part>, resting_poses, transitions/<part> and
    default_conditions.
    """

    def __init__(self) -> None:
        super().__init__(DROP_SIMULATOR)
        values = declare(self, PARAMETERS)
        folder = _folder(values['parts_folder'] or parts_folder())
        self._surfaces = all_surfaces(values['surfaces_file'])
        frame = check_frame(values[FRAME_ID.name])
        self._default = DefaultConditionsPublisher(self, self._surfaces)
        self._workers = AsyncWorkers(self, values['workers'] or default_workers())
        self._files = FileWorker(self)
        self._surroundings = RequestedSurroundings(
            self, values[SURROUNDINGS_FOLDER.name], self._files
        )
        self._descriptions = SurroundingsPublisher(self, frame)
        self._runs = PublishedRuns()
        self._shared = SharedDrops(self)
        self._producer = DropProducer(self, self._workers, self._files, frame)
        self._parts = PartPublisher(self, folder, self._files)
        self._server = ActionServer(
            self,
            DropPart,
            DROP_PART,
            self._execute,
            # By default, rclpy rejects every cancel request.
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            **ACTION_SERVICES,
        )
        self._reorient = ReorientServer(
            self,
            self._parts,
            self._workers,
            self._files,
            self._conditions,
            self._descriptions,
            frame,
        )
        self._parts.ready.add_done_callback(self._on_parts_read)

    def close(self) -> None:
        """End the workers, and abandon their drops."""
        self._workers.stop()
        self._files.stop()
        self._server.destroy()
        self._reorient.destroy()

    def _on_parts_read(self, _: Future) -> None:
        """Publish diagnostics and log that the node is ready."""
        publish_diagnostics(self, self._diagnose, DuplicateNodeDetector(self, DROP_SIMULATOR))
        parts = count_text(len(self._parts), 'part', 'parts')
        workers = count_text(self._workers.count, 'worker', 'workers')
        self.get_logger().info(f'ready: {parts}, {workers}')

    async def _execute(self, handle: ServerGoalHandle) -> DropPart.Result:
        nothing = DropPart.Result(run_id=handle.request.run_id)
        return await execute_goal(self, DROP_PART, handle, nothing, self._drop)

    async def _drop(self, handle: ServerGoalHandle) -> tuple[DropPart.Result, Exception | None]:
        """Return the result of a goal; concurrent goals for the same drops share them."""
        goal = handle.request
        check_run_id(goal.run_id)
        part = await self._parts.get(goal.part)
        if handle.is_cancel_requested:
            raise CanceledError('canceled before the first drop')
        job, requested = await self._plan(goal, part)
        run = self._runs.find(requested) if goal.run_id else requested
        # Several subscribers often lose the same drops, and each of them requests these again.
        key = (
            goal.run_id,
            run.part,
            *run.sequence(),
            requested.first_drop,
            requested.end,
            requested.precision,
        )
        if not self._shared.has(key) and len(self._shared.active()) >= MAX_GOALS:
            raise BusyError(f'{MAX_GOALS} drop_part goals are active, try again later')
        make = partial(self._make, part=part, job=job, run=run, is_new=not goal.run_id)
        return await self._shared.make(key, handle, requested, make)

    async def _make(
        self,
        drops: GoalDrops,
        part: Part,
        job: DropJob,
        run: RunDescription,
        *,
        is_new: bool,
    ) -> None:
        if is_new:
            self._runs.add(run)
            self._descriptions.publish(run, job.scene)
        await self._producer.produce(drops, part, job, run, is_new=is_new)

    def _diagnose(self) -> Diagnosis:
        active = self._shared.active()
        runs = [(drops.requested, drops.result.drops) for drops in active]
        # Drops come in chunks: for a slow part, there is no chunk in most seconds.
        rates = {
            f'drops per second of run {k}': f'{drops.rate:.1f}'
            for k, drops in enumerate(active, 1)
        }
        not_offered = self._parts.not_offered
        values = {
            'drops made': self._producer.drops.total,
            'drops per second': self._producer.drops.rate(),
            'workers': self._workers.count,
            'workers that died': self._workers.deaths,
            'parts offered': len(self._parts),
            **run_values(runs),
            **truncated(rates),
            **self._reorient.values(),
            **truncated({f'not offered: {name}': why for name, why in not_offered.items()}),
        }
        warning = count_text(len(not_offered), 'mesh is not offered', 'meshes are not offered')
        state = active_runs_text(runs) or self._reorient.state
        return Diagnosis(state, values, [warning] if not_offered else [])

    async def _conditions(self, goal: DropPart.Goal | ReorientPart.Goal) -> DropConditions:
        """Return the conditions that a goal requests."""
        return await self._surroundings.conditions(self._surfaces, goal, self._default.conditions)

    async def _plan(self, goal: DropPart.Goal, part: Part) -> tuple[DropJob, RunDescription]:
        """Return the job and the requested drops of a goal."""
        conditions = await self._conditions(goal)
        plan = partial(
            plan_run,
            part,
            conditions,
            seed=goal.seed,
            drops=max_drops(goal.drops, goal.precision, MAX_DROPS),
            first_drop=goal.first_drop,
            precision=goal.precision,
            run_id=goal.run_id or uuid.uuid4().hex[:12],
            started=time.time_ns(),  # not ROS time, which may stand still
        )
        if conditions.surroundings is None:
            return plan()
        # A convex decomposition can take seconds.
        planned: tuple[DropJob, RunDescription] = await self._files.run(plan)
        return planned


def _folder(path: str | Path) -> Path:
    if not is_folder(Path(path)):
        raise InvalidValueError(f'invalid parts_folder {str(path)!r}: expected an existing folder')
    return Path(path)


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(DropSimulator, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
