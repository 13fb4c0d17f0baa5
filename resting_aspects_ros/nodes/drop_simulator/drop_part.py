"""The action drop_part: drops parts, and publishes their resting poses."""

import time
import uuid
from collections import OrderedDict
from contextlib import aclosing
from functools import partial
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg

from resting_aspects_ros.api.conditions import aspects_in
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import EngineError, InvalidValueError
from resting_aspects_ros.nodes.drop_simulator.goals import GoalServer
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.conversions import MAX_POSES, poses_msgs
from resting_aspects_ros.ros.diagnostics import (
    RateCounter,
    active_runs_text,
    progress_text,
    run_values,
    truncated,
)
from resting_aspects_ros.ros.interface import DROP_PART, POSES, RESTING_POSES
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError
from resting_aspects_ros.simulation.conditions import MAX_DROPS
from resting_aspects_ros.simulation.job import DropJob, RunDescription, check_run_id, plan_run
from resting_aspects_ros.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.statistics.intervals import max_drops
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# Time for which drops wait until the message with them has MAX_POSES drops, s.
PUBLISH_PERIOD = 0.5
# Maximum number of runs whose descriptions are kept, to publish drops of them again.
MAX_RUNS = 10_000


class GoalDrops:
    """The drops of an active goal: sends feedback and accumulates the result.

    requested : the drops that the goal requests
    result : current counts
    rate : drops per second, from the start to the most recent chunk
    """

    def __init__(self, handle: ServerGoalHandle, requested: RunDescription) -> None:
        self.requested = requested
        self.result = DropPart.Result(run_id=requested.run_id)
        self.rate = 0.0
        self._handle = handle
        self._start = time.monotonic()

    def canceled(self) -> bool:
        """Return whether the goal was canceled."""
        return bool(self._handle.is_cancel_requested)

    @property
    def end(self) -> int:
        """Index after the last drop that was made."""
        return self.requested.first_drop + int(self.result.drops)

    def add(self, chunk: RestingPoses) -> None:
        """Count the drops of a chunk and send feedback."""
        result = self.result
        result.drops += len(chunk)
        for name in ('settled', 'unsettled', 'failed', 'lost', 'sliding'):
            number = int((chunk.status == RestStatus[name.upper()]).sum())
            setattr(result, name, getattr(result, name) + number)
        seconds = time.monotonic() - self._start
        self.rate = result.drops / seconds if seconds > 0 else 0.0
        feedback = DropPart.Feedback(done=result.drops, total=self.requested.drops)
        feedback.drops_per_second = self.rate
        self._handle.publish_feedback(feedback)


class DropServer(GoalServer):
    """Serves drop_part, and publishes resting_poses.

    Parameters
    ----------
    node, shared : as for GoalServer

    drops : counter of all drops made
    """

    def __init__(self, node: Node, *shared: Any) -> None:
        super().__init__(DropPart, DROP_PART, node, *shared)
        self._aspects = AspectSet('', ())  # of the part that stopped at a precision last
        self._active: list[GoalDrops] = []
        self._runs: OrderedDict[str, RunDescription] = OrderedDict()  # by run id
        self._publisher = advertise(node, RestingPosesMsg, RESTING_POSES, POSES)
        self.drops = RateCounter()

    @property
    def state(self) -> str:
        """The progress of the active goals; empty if there are none."""
        return active_runs_text(self._progress())

    def values(self) -> dict[str, object]:
        """Return values for the diagnostics."""
        # Drops come in chunks: for a slow part, there is no chunk in most seconds.
        rates = {
            f'drops per second of run {k}': f'{drops.rate:.1f}'
            for k, drops in enumerate(self._active, 1)
        }
        return {
            'drops made': self.drops.total,
            'drops per second': self.drops.rate(),
            **run_values(self._progress()),
            **truncated(rates),
        }

    def _progress(self) -> list[tuple[RunDescription, int]]:
        return [(drops.requested, int(drops.result.drops)) for drops in self._active]

    async def _answer(self, handle: ServerGoalHandle) -> tuple[DropPart.Result, Exception | None]:
        goal = handle.request
        check_run_id(goal.run_id)
        part = await self._parts.get(goal.part)
        if handle.is_cancel_requested:
            raise CanceledError('canceled before the first drop')
        job, requested = await self._plan(goal, part)
        run = self._published(requested) if goal.run_id else requested
        self._check_number(self._active)
        drops = GoalDrops(handle, requested)
        self._active.append(drops)
        error: Exception | None = None
        try:
            await self._make(drops, part, job, run)
        except (CanceledError, EngineError) as raised:  # the drops made before are kept
            error = raised
        finally:
            self._active.remove(drops)
        return drops.result, error

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

    def _published(self, requested: RunDescription) -> RunDescription:
        """Return the run whose drops are requested again.

        Raises NotAvailableError if this simulator did not start the run, and InvalidValueError if
        the requested drops do not belong to it.
        """
        run = self._runs.get(requested.run_id)
        if run is None:
            raise NotAvailableError(
                f'run {requested.run_id} was not made by this simulator, which may have been '
                'restarted since'
            )
        if run.sequence() != requested.sequence():
            raise InvalidValueError(
                f'invalid request for drops of run {run.run_id}: expected its part {run.part}, '
                'in the same version, its conditions and its seed'
            )
        return run

    def _begin(self, run: RunDescription, job: DropJob) -> None:
        """Remember a new run, and publish its surroundings."""
        self._runs[run.run_id] = run
        while len(self._runs) > MAX_RUNS:
            self._runs.popitem(last=False)
        self._surroundings.publish(run, job.scene)

    async def _make(self, drops: GoalDrops, part: Part, job: DropJob, run: RunDescription) -> None:
        """Make and publish the drops of a goal; raises CanceledError and EngineError.

        The last message ends the run, unless its drops are published again. It is not empty: the
        newest chunk waits until another one follows, because some readers of logs cannot read a
        message with empty columns.
        """
        requested = drops.requested
        is_new = run is requested
        if is_new:
            self._begin(run, job)
        total = None
        if requested.precision:
            total = no_drops(aspects_in(job.scene, await self._find_aspects(part)))
        waiting: list[RestingPoses] = []
        since = 0.0
        try:
            chunks = self._workers.chunks(job, requested, drops.canceled)
            async with aclosing(chunks):
                async for chunk in chunks:
                    self.drops.add(len(chunk))
                    drops.add(chunk)
                    since = since if waiting else time.monotonic()
                    waiting.append(chunk)
                    if total is not None:
                        total += count_poses(total.aspects, chunk)
                        if total.stops(requested.precision, requested.drops):
                            return
                    is_full = sum(map(len, waiting)) > MAX_POSES
                    is_due = is_full or time.monotonic() - since >= PUBLISH_PERIOD
                    if is_due and waiting[1:]:
                        self._publish(RestingPoses.join(waiting[:-1]), run, last=False)
                        waiting, since = [chunk], time.monotonic()
        except EngineError as error:
            raise EngineError(f'{error}; the drops made before are kept') from error
        finally:
            if waiting:
                self._publish(RestingPoses.join(waiting), run, last=is_new)
            else:
                drops.result.run_id = ''  # there is no run
        if drops.end < requested.end:
            progress = progress_text(requested, int(drops.result.drops))
            raise CanceledError(f'canceled after {progress}; these are kept')

    async def _find_aspects(self, part: Part) -> AspectSet:
        """Return the aspects of a part; cached, since a large mesh takes seconds."""
        if self._aspects.part_sha256 != part.part_sha256:
            self._aspects = await self._files.run(find_aspects, part)
        return self._aspects

    def _publish(self, poses: RestingPoses, run: RunDescription, *, last: bool) -> None:
        stamp = self._node.get_clock().now().to_msg()
        for message in poses_msgs(poses, run, stamp, last=last, frame=self._frame):
            self._publisher.publish(message)
