"""A goal of reorient_part: what it requests, and its progress."""

import time

from rclpy.action.server import ServerGoalHandle
from resting_aspects_interfaces.action import ReorientPart
from resting_aspects_interfaces.msg import FeederAction

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.api.plan import (
    PlannedActions,
    PlannedDrops,
    check_actions,
    plan_actions,
    plan_drops,
)
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.status import CanceledError
from resting_aspects_ros.ros.transition_conversions import BoundedLongRun, action_from
from resting_aspects_ros.simulation.actions import KINDS, NamedAction
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.statistics.poses import RestingPoses


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
