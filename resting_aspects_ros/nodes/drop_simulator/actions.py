"""The actions drop_part and reorient_part: they simulate, and publish poses and transitions."""

import time
import uuid
from collections import OrderedDict
from contextlib import aclosing
from functools import partial
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import FeederAction, TransitionMatrix
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg

from resting_aspects_ros.api.conditions import aspects_in, shipped_actions
from resting_aspects_ros.api.plan import (
    PlannedActions,
    PlannedDrops,
    check_actions,
    plan_actions,
    plan_drops,
)
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import EngineError, InvalidValueError, shown
from resting_aspects_ros.nodes.drop_simulator.goals import GoalServer
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import PartTopics, advertise
from resting_aspects_ros.ros.conversions import MAX_POSES, poses_msgs
from resting_aspects_ros.ros.diagnostics import (
    RateCounter,
    active_runs_text,
    progress_text,
    run_values,
    truncated,
)
from resting_aspects_ros.ros.distribution_conversions import (
    BoundedLongRun,
    action_from,
    transitions_msg,
)
from resting_aspects_ros.ros.file_worker import FileLimitError
from resting_aspects_ros.ros.interface import (
    DROP_PART,
    LATCHED,
    POSES,
    REORIENT_PART,
    RESTING_POSES,
    TRANSITIONS,
)
from resting_aspects_ros.ros.requests import CanceledError, NotAvailableError
from resting_aspects_ros.simulation.actions import KINDS, NamedAction
from resting_aspects_ros.simulation.conditions import MAX_DROPS, DropConditions
from resting_aspects_ros.simulation.job import DropJob, RunDescription, check_run_id, plan_run
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import max_drops
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# -- drop_part ------------------------------------------------------------------------------------


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
        self._runs[run.run_id] = run
        while len(self._runs) > MAX_RUNS:
            self._runs.popitem(last=False)
        self._publish_surroundings(run, job.scene)

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
            chunks = self._chunks(job, requested, drops.canceled)
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


# -- reorient_part --------------------------------------------------------------------------------


# Minimum time between two publications of the matrix of an active goal, s.
MATRIX_PERIOD = 1.0


def requested_action(action: FeederAction) -> NamedAction:
    """Return the action that a goal requests; raises InvalidValueError."""
    if not action.kind and action.name in KINDS:
        action.kind = action.name
    if action.kind:
        return action_from(action)
    if action.names or action.values:
        raise InvalidValueError(
            f'invalid values of action {shown(action.name)}: expected none without a kind'
        )
    return shipped_actions().get(action.name)


def plan_goal(
    part: Part,
    action: NamedAction,
    conditions: DropConditions,
    goal: ReorientPart.Goal,
) -> tuple[PlannedDrops, int, PlannedActions | None]:
    """Return the drops, the number of actions and the actions; runs in a FileWorker.

    In surroundings, actions start from the resting poses of the drops, so that they are None
    here; see plan_from_rests.
    """
    drops = plan_drops(part, conditions, drops=goal.drops, seed=goal.seed)
    if conditions.surroundings is None:
        actions = plan_from_rests(part, action, conditions, goal, None)
        return drops, actions.run.drops, actions
    _, aspects, per_aspect = check_actions(
        part, action, conditions, per_aspect=goal.per_aspect, precision=goal.precision
    )
    return drops, per_aspect * len(aspects), None


def plan_from_rests(
    part: Part,
    action: NamedAction,
    conditions: DropConditions,
    goal: ReorientPart.Goal,
    rests: RestingPoses | None,
) -> PlannedActions:
    """Return the actions of a goal from resting poses in surroundings; runs in a FileWorker."""
    return plan_actions(
        part,
        action,
        conditions,
        per_aspect=goal.per_aspect,
        precision=goal.precision,
        seed=goal.seed,
        rests=rests,
    )


def bounded_long_run(result: ReorientResult) -> BoundedLongRun | None:
    """Return the long-run shares of a result with their bounds; runs in a FileWorker."""
    return None if result.long_run is None else (result.long_run, *result.long_run_bounds)


class ReorientGoal:
    """An active goal, which sends feedback of its progress."""

    def __init__(self, handle: ServerGoalHandle) -> None:
        self.request: ReorientPart.Goal = handle.request
        self.feedback = ReorientPart.Feedback()
        self._handle = handle
        self._start: float | None = None

    def canceled(self) -> bool:
        """Return whether the goal was canceled."""
        return bool(self._handle.is_cancel_requested)

    def check(self) -> None:
        """Raise CanceledError if the goal was canceled; describes the actions made."""
        made = self.feedback.done
        if self.canceled():
            raise CanceledError(
                f'canceled after {made} of {self.feedback.total} actions; these are kept'
                if made
                else 'canceled before the first action'
            )

    def add_drops(self, drops: int) -> None:
        """Count drops, and send feedback."""
        self.feedback.drops += drops
        self._handle.publish_feedback(self.feedback)

    def add_actions(self, actions: int) -> None:
        """Count actions, and send feedback."""
        now = time.monotonic()
        self._start = now if self._start is None else self._start
        self.feedback.done += actions
        if now > self._start:
            self.feedback.actions_per_second = self.feedback.done / (now - self._start)
        self._handle.publish_feedback(self.feedback)

    def __str__(self) -> str:
        name = self.request.action.name or self.request.action.kind
        return (
            f'{self.request.part}, {name}: {self.feedback.done} of {self.feedback.total} actions'
        )


class ReorientServer(GoalServer):
    """Serves reorient_part, and publishes transitions/<part>.

    Parameters
    ----------
    node, shared : as for GoalServer
    """

    def __init__(self, node: Node, *shared: Any) -> None:
        super().__init__(ReorientPart, REORIENT_PART, node, *shared)
        self._goals: list[ReorientGoal] = []
        self._topics = PartTopics(node, TransitionMatrix, TRANSITIONS, LATCHED)
        self._actions = RateCounter()

    @property
    def state(self) -> str:
        """The progress of the first active goal; empty if there is none."""
        return str(self._goals[0]) if self._goals else ''

    def values(self) -> dict[str, object]:
        """Return values for the diagnostics."""
        goals = {f'reorientation {k}': str(goal) for k, goal in enumerate(self._goals, 1)}
        return {
            'actions made': self._actions.total,
            'actions per second': self._actions.rate(),
            'active reorientations': len(self._goals),
            **truncated(goals),
        }

    async def _answer(
        self, handle: ServerGoalHandle
    ) -> tuple[ReorientPart.Result, Exception | None]:
        self._check_number(self._goals)
        goal = ReorientGoal(handle)
        self._goals.append(goal)
        try:
            return await self._make(goal)
        finally:
            self._goals.remove(goal)

    async def _make(self, goal: ReorientGoal) -> tuple[ReorientPart.Result, Exception | None]:
        part = await self._parts.get(goal.request.part)
        action = requested_action(goal.request.action)
        conditions = await self._conditions(goal.request)
        given = (part, action, conditions, goal.request)
        drops, goal.feedback.total, planned = await self._files.run(plan_goal, *given)
        self._topics.offer(part.name)  # before the drops, so that subscribers miss nothing
        dropped, rests = await self._drop(goal, drops)
        if planned is None:
            planned = await self._files.run(plan_from_rests, *given, rests)
            self._publish_surroundings(planned.run, planned.job.scene)
        error: Exception | None = None
        try:
            await self._act(goal, planned, part, dropped)
        except Exception as raised:  # noqa: BLE001 - the result keeps the actions made before
            error = raised
        result = ReorientPart.Result()
        if planned.tally.done:
            made = _result(planned, part, dropped)
            result.transitions = self._publish(
                made, ended=True, long_run=await self._long_run(made)
            )
        if not action.action.has_effect:
            result.status.message = f'{action.name} has no effect: every part stays where it is'
        return result, error

    async def _drop(
        self, goal: ReorientGoal, planned: PlannedDrops
    ) -> tuple[Distribution, RestingPoses | None]:
        """Return the distribution of the drops of a goal, and their poses in surroundings."""
        total, kept = planned.tally.distribution, []
        chunks = self._chunks(planned.job, planned.run, goal.canceled)
        async with aclosing(chunks):
            async for chunk in chunks:
                total += count_poses(total.aspects, chunk)
                goal.add_drops(len(chunk))
                if not planned.job.scene.level:
                    kept.append(chunk)
        goal.check()
        return total, RestingPoses.join(kept) if kept else None

    async def _act(
        self, goal: ReorientGoal, planned: PlannedActions, part: Part, dropped: Distribution
    ) -> None:
        """Make and count the actions of a goal; raises CanceledError and EngineError."""
        tally, published = planned.tally, time.monotonic()
        chunks = self._chunks(planned.job, planned.run, goal.canceled)
        try:
            async with aclosing(chunks):
                async for chunk in chunks:
                    tally.add(chunk, aspect_ids(tally.aspects, chunk))
                    self._actions.add(len(chunk))
                    goal.add_actions(len(chunk))
                    if tally.complete:
                        return
                    if time.monotonic() - published >= MATRIX_PERIOD:
                        published = time.monotonic()
                        self._publish(_result(planned, part, dropped), ended=False)
        except EngineError as error:
            raise EngineError(f'{error}; the actions made before are kept') from error
        goal.check()

    async def _long_run(self, result: ReorientResult) -> BoundedLongRun | None:
        try:
            found: BoundedLongRun | None = await self._files.run(bounded_long_run, result)
        except FileLimitError as error:
            self._node.get_logger().warning(f'no long-run shares of {result.run.part}: {error}')
            return None
        return found

    def _publish(
        self, result: ReorientResult, *, ended: bool, long_run: BoundedLongRun | None = None
    ) -> TransitionMatrix:
        stamp = self._node.get_clock().now().to_msg()
        message = transitions_msg(result, stamp, ended=ended, long_run=long_run, frame=self._frame)
        self._topics.publish(result.run.part, message)
        return message


def _result(planned: PlannedActions, part: Part, dropped: Distribution) -> ReorientResult:
    tally = planned.tally
    return ReorientResult(tally.matrix, planned.action, planned.run, part, dropped, tally.complete)
