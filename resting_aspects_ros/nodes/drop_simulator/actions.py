"""The actions drop_part and reorient_part: they simulate, and publish poses and transitions."""

import time
import uuid
from collections.abc import AsyncGenerator, Awaitable, Callable
from concurrent.futures import Future as PoolFuture
from contextlib import aclosing, closing
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import FeederAction, Status, TransitionMatrix
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
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import EngineError, InvalidValueError, RestingAspectsError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import PartTopics, advertise, ros_future, wait_for
from resting_aspects_ros.ros.conversions import MAX_POSES, description_msg, poses_msgs
from resting_aspects_ros.ros.distribution_conversions import (
    BoundedLongRun,
    action_from,
    transitions_msg,
)
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker
from resting_aspects_ros.ros.health import RateCounter, progress_text
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    DROP_PART,
    LATCHED,
    POSES,
    REORIENT_PART,
    RESTING_POSES,
    TRANSITIONS,
)
from resting_aspects_ros.ros.requests import (
    BusyError,
    CanceledError,
    NotAvailableError,
    error_status,
)
from resting_aspects_ros.simulation.actions import KINDS, NamedAction
from resting_aspects_ros.simulation.conditions import MAX_DROPS, DropConditions
from resting_aspects_ros.simulation.job import DropJob, RunDescription, check_run_id, plan_run
from resting_aspects_ros.simulation.scene import Scene
from resting_aspects_ros.simulation.workers import LocalWorkers, drop_chunks
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import max_drops
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# -- goals ----------------------------------------------------------------------------------------


# Maximum number of concurrent goals of an action; all goals share the workers chunk by chunk.
MAX_GOALS = 16
# Time for which a result is kept for a client that requests it late, s.
RESULT_TIMEOUT = 300
# Interval at which a goal that waits checks whether it was canceled, s.
CANCEL_PERIOD = 0.5


@dataclass(frozen=True)
class Resources:
    """What the servers of both actions share.

    part : returns an offered part by its name
    conditions : returns the conditions that a goal requests
    files : computes what could block the node, such as the aspects of a large mesh
    surroundings : topics of the surroundings of new runs
    frame : frame of the published poses
    """

    node: Node
    part: Callable[[str], Awaitable[Part]]
    conditions: Callable[[Any], Awaitable[DropConditions]]
    workers: LocalWorkers
    files: FileWorker
    surroundings: PartTopics
    frame: str


class GoalServer:
    """Serves an action; goals of all actions share the workers chunk by chunk.

    kind, name : type and name of the action
    """

    def __init__(self, kind: Any, name: str, resources: Resources) -> None:
        self._kind, self._name = kind, name
        self._resources = resources
        self._node, self._files, self._frame = resources.node, resources.files, resources.frame
        self._progress: dict[int, str] = {}  # of the active goals, by the id of the handle
        self._server = ActionServer(
            self._node,
            kind,
            name,
            self._execute,
            # By default, rclpy rejects every cancel request.
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            **ACTION_SERVICES,
        )

    @property
    def active(self) -> int:
        """Number of active goals."""
        return len(self._progress)

    @property
    def state(self) -> str:
        """The progress of the first active goal and the number of others, as text."""
        running = [text for text in self._progress.values() if text]
        more = f', and {len(running) - 1} more' if running[1:] else ''
        return f'{running[0]}{more}' if running else ''

    def destroy(self) -> None:
        """Destroy the action server."""
        self._server.destroy()

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Return the result of a goal with its status, and set the state of the goal."""
        result = self._kind.Result()
        try:
            if len(self._progress) >= MAX_GOALS:
                raise BusyError(f'{MAX_GOALS} {self._name} goals are active, try again later')
            self._progress[id(handle)] = ''
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
        except InvalidHandle:  # the result cannot be sent
            result.status = Status(code=Status.FAILED, message='the node has stopped')
        except Exception as error:  # noqa: BLE001 - a defect must not look like an answer
            self._node.get_logger().error(f'{self._name} failed: {error!r}')
            result.status = Status(code=Status.FAILED, message=f'unexpected error {error!r}')
            handle.abort()
        finally:
            self._progress.pop(id(handle), None)
        return result

    async def _answer(self, handle: ServerGoalHandle) -> tuple[Any, Exception | None]:
        """Return the result of a goal, and the error that ended it early, if any."""
        raise NotImplementedError

    async def _chunks(
        self, job: DropJob, requested: RunDescription, handle: ServerGoalHandle
    ) -> AsyncGenerator[RestingPoses, None]:
        """Yield chunks of drops in order; raises EngineError if the workers fail or die.

        Ends early if the goal is canceled, also while a chunk is simulated.
        """
        with closing(drop_chunks(job, requested, self._resources.workers)) as steps:
            for step in steps:
                if not isinstance(step, PoolFuture):
                    yield step
                    continue
                done = ros_future(self._node, step)  # drop_chunks handles its exception
                while not (
                    handle.is_cancel_requested or await wait_for(self._node, done, CANCEL_PERIOD)
                ):
                    pass
                if handle.is_cancel_requested:
                    return

    def _publish_surroundings(self, run: RunDescription, scene: Scene) -> None:
        """Publish the surroundings of a new run; nothing for the infinite level plane."""
        if not scene.level:
            self._resources.surroundings.publish(
                run.part, description_msg(run, scene, self._frame)
            )


# -- drop_part ------------------------------------------------------------------------------------


# Time for which drops wait until the message with them has MAX_POSES drops, s.
PUBLISH_PERIOD = 0.5
# Maximum number of runs whose descriptions are kept, to publish drops of them again.
MAX_RUNS = 10_000


class DropGoal:
    """An active goal: counts its drops in the result, and sends feedback.

    requested : the drops that the goal requests
    """

    def __init__(self, handle: ServerGoalHandle, requested: RunDescription) -> None:
        self.handle = handle
        self.requested = requested
        self.result = DropPart.Result(run_id=requested.run_id)
        self._start = time.monotonic()

    def add(self, chunk: RestingPoses) -> None:
        """Count the drops of a chunk and send feedback."""
        result = self.result
        result.drops += len(chunk)
        for name in ('settled', 'unsettled', 'failed', 'lost', 'sliding'):
            number = int((chunk.status == RestStatus[name.upper()]).sum())
            setattr(result, name, getattr(result, name) + number)
        feedback = DropPart.Feedback(done=result.drops, total=self.requested.drops)
        seconds = time.monotonic() - self._start
        feedback.drops_per_second = result.drops / seconds if seconds > 0 else 0.0
        self.handle.publish_feedback(feedback)

    @property
    def progress(self) -> str:
        """The drops made and requested, as text."""
        return progress_text(self.requested, int(self.result.drops))


class DropServer(GoalServer):
    """Serves drop_part, and publishes resting_poses.

    drops : counter of all drops made
    """

    def __init__(self, resources: Resources) -> None:
        super().__init__(DropPart, DROP_PART, resources)
        self._runs: dict[str, RunDescription] = {}  # by run id
        self._publisher = advertise(self._node, RestingPosesMsg, RESTING_POSES, POSES)
        self.drops = RateCounter()

    async def _answer(self, handle: ServerGoalHandle) -> tuple[DropPart.Result, Exception | None]:
        goal = handle.request
        check_run_id(goal.run_id)
        part = await self._resources.part(goal.part)
        if handle.is_cancel_requested:
            raise CanceledError('canceled before the first drop')
        job, requested = await self._plan(goal, part)
        run = self._published(requested) if goal.run_id else requested
        active = DropGoal(handle, requested)
        try:
            await self._make(active, part, job, run)
        except (CanceledError, EngineError) as error:  # the drops made before are kept
            return active.result, error
        return active.result, None

    async def _plan(self, goal: DropPart.Goal, part: Part) -> tuple[DropJob, RunDescription]:
        conditions = await self._resources.conditions(goal)
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
            self._runs.pop(next(iter(self._runs)))
        self._publish_surroundings(run, job.scene)

    async def _make(self, goal: DropGoal, part: Part, job: DropJob, run: RunDescription) -> None:
        """Make and publish the drops of a goal; raises CanceledError and EngineError.

        The last message ends the run, unless its drops are published again. It is not empty: the
        newest chunk waits until another one follows, because some readers of logs cannot read a
        message with empty columns.
        """
        requested = goal.requested
        is_new = run is requested
        if is_new:
            self._begin(run, job)
        total = None
        if requested.precision:
            aspects = await self._files.run(find_aspects, part)
            total = no_drops(aspects_in(job.scene, aspects))
        waiting: list[RestingPoses] = []
        since = 0.0
        try:
            chunks = self._chunks(job, requested, goal.handle)
            async with aclosing(chunks):
                async for chunk in chunks:
                    self.drops.add(len(chunk))
                    goal.add(chunk)
                    self._progress[id(goal.handle)] = f'{run.part}: {goal.progress}'
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
                goal.result.run_id = ''  # there is no run
        if goal.result.drops < requested.drops:
            raise CanceledError(f'canceled after {goal.progress}; these are kept')

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
    part: Part, action: NamedAction, conditions: DropConditions, goal: ReorientPart.Goal
) -> tuple[PlannedDrops, int]:
    """Return the drops and the number of actions, which are checked; runs in a FileWorker."""
    drops = plan_drops(part, conditions, drops=goal.drops, seed=goal.seed)
    _, aspects, per_aspect = check_actions(
        part, action, conditions, per_aspect=goal.per_aspect, precision=goal.precision
    )
    return drops, per_aspect * len(aspects)


def plan_after_drops(
    part: Part,
    action: NamedAction,
    conditions: DropConditions,
    goal: ReorientPart.Goal,
    rests: RestingPoses | None,
) -> PlannedActions:
    """Return the actions of a goal; runs in a FileWorker.

    rests : in surroundings, the resting poses from which they start
    """
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
        self.handle = handle
        self.request: ReorientPart.Goal = handle.request
        self.feedback = ReorientPart.Feedback()
        self._start: float | None = None

    def check(self) -> None:
        """Raise CanceledError if the goal was canceled; describes the actions made."""
        made = self.feedback.done
        if self.handle.is_cancel_requested:
            raise CanceledError(
                f'canceled after {made} of {self.feedback.total} actions; these are kept'
                if made
                else 'canceled before the first action'
            )

    def add_drops(self, drops: int) -> None:
        """Count drops, and send feedback."""
        self.feedback.drops += drops
        self.handle.publish_feedback(self.feedback)

    def add_actions(self, actions: int) -> None:
        """Count actions, and send feedback."""
        now = time.monotonic()
        self._start = now if self._start is None else self._start
        self.feedback.done += actions
        if now > self._start:
            self.feedback.actions_per_second = self.feedback.done / (now - self._start)
        self.handle.publish_feedback(self.feedback)

    def __str__(self) -> str:
        name = self.request.action.name or self.request.action.kind
        return (
            f'{self.request.part}, {name}: {self.feedback.done} of {self.feedback.total} actions'
        )


class ReorientServer(GoalServer):
    """Serves reorient_part, and publishes transitions/<part>.

    actions : counter of all actions made
    """

    def __init__(self, resources: Resources) -> None:
        super().__init__(ReorientPart, REORIENT_PART, resources)
        self._topics = PartTopics(self._node, TransitionMatrix, TRANSITIONS, LATCHED)
        self.actions = RateCounter()

    async def _answer(
        self, handle: ServerGoalHandle
    ) -> tuple[ReorientPart.Result, Exception | None]:
        goal = ReorientGoal(handle)
        part = await self._resources.part(goal.request.part)
        action = requested_action(goal.request.action)
        conditions = await self._resources.conditions(goal.request)
        given = (part, action, conditions, goal.request)
        drops, goal.feedback.total = await self._files.run(plan_goal, *given)
        self._topics.offer(part.name)  # before the drops, so that subscribers miss nothing
        dropped, rests = await self._drop(goal, drops)
        planned = await self._files.run(plan_after_drops, *given, rests)
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
        chunks = self._chunks(planned.job, planned.run, goal.handle)
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
        chunks = self._chunks(planned.job, planned.run, goal.handle)
        try:
            async with aclosing(chunks):
                async for chunk in chunks:
                    tally.add(chunk, aspect_ids(tally.aspects, chunk))
                    self.actions.add(len(chunk))
                    goal.add_actions(len(chunk))
                    self._progress[id(goal.handle)] = str(goal)
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
