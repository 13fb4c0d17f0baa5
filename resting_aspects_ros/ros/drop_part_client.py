"""One drop_part goal followed to its end, also if that is the end of the simulator."""

import time
from collections.abc import Awaitable, Callable
from uuid import uuid4

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from unique_identifier_msgs.msg import UUID

from resting_aspects_ros.ros.callbacks import wait_for
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError

# A simulator accepts a goal within this, s; else the goal is sent again, so often: a simulator can
# be discovered before it has discovered the client, and then its answer is lost.
GOAL_TIMEOUT = 3.0
MAX_SENDS = 10
# How often it is checked whether the simulator still exists and the result is still wanted, s.
LOOK_PERIOD = 0.5
# After so long without feedback the result is requested again, s: a simulator that was restarted
# answers at once that it does not know the goal; a slow one answers both in the end.
ASK_PERIOD = 5.0


async def drop_result(
    node: Node,
    client: ActionClient,
    goal: DropPart.Goal,
    *,
    group: CallbackGroup | None = None,
    feedback: Callable[[DropPart.Feedback], object] = lambda _: None,
    wanted: Callable[[], bool] = lambda: True,
) -> DropPart.Result:
    """Send a goal and wait for its result.

    Parameters
    ----------
    group : callback group of the timers; None: the node's own
    feedback : called with each feedback message
    wanted : the goal is canceled when this is false

    Raises
    ------
    NotAvailableError
        The simulator is gone before the result came.
    CanceledError
        The goal is not wanted any more.
    """
    heard = time.monotonic()

    def hear(message: DropPart.Impl.FeedbackMessage) -> None:
        nonlocal heard
        heard = time.monotonic()
        feedback(message.feedback)

    async def arrived(future: Future) -> bool:
        if await wait_for(node, future, LOOK_PERIOD, group):
            return True
        if not client.server_is_ready():
            raise NotAvailableError(f'the simulator went away while it dropped {goal.part}')
        return False

    handle = await _accepted(client, goal, hear, arrived)
    answer = handle.get_result_async()
    while not await arrived(answer):
        if not wanted():
            await arrived(handle.cancel_goal_async())
            raise CanceledError(f'the drops of {goal.part} are not wanted any more')
        if time.monotonic() - heard > ASK_PERIOD:
            heard = time.monotonic()
            again = handle.get_result_async()
            if await arrived(again):
                answer = again
    if answer.result().status == GoalStatus.STATUS_UNKNOWN:
        raise NotAvailableError(
            f'the simulator was started again while it dropped {goal.part}: ask again'
        )
    result: DropPart.Result = answer.result().result
    return result


async def _accepted(
    client: ActionClient,
    goal: DropPart.Goal,
    hear: Callable[[DropPart.Impl.FeedbackMessage], None],
    arrived: Callable[[Future], Awaitable[bool]],
) -> ClientGoalHandle:
    """Send the goal until the simulator answers that it has it."""
    goal_id = UUID(uuid=list(uuid4().bytes))
    for sends in range(MAX_SENDS):
        asked = client.send_goal_async(goal, hear, goal_id)
        end = time.monotonic() + GOAL_TIMEOUT
        while not await arrived(asked) and time.monotonic() < end:
            pass
        # One that the simulator has already is not accepted a second time.
        if asked.done() and (asked.result().accepted or sends):
            return asked.result()
        if asked.done():
            raise NotAvailableError('the simulator did not accept the goal')
    raise NotAvailableError(f'the simulator accepted no goal in {MAX_SENDS * GOAL_TIMEOUT} s')
