"""Client of one goal of the simulator, which also detects that it stopped or restarted."""

import time
from collections.abc import Awaitable, Callable
from typing import Any
from uuid import uuid4

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from resting_aspects_ros.ros.callbacks import wait_for
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError

# Timeout after which a goal is sent again, s, and maximum number of attempts. The response is lost
# if a client discovers a simulator before the simulator discovers the client.
GOAL_TIMEOUT = 3.0
MAX_SENDS = 10
# Interval of checks that the simulator still exists and that the result is still needed, s.
CHECK_PERIOD = 0.5
# Time without feedback after which the result is requested again, s. A restarted simulator answers
# at once that it does not know the goal; a slow one eventually answers both requests.
RETRY_PERIOD = 5.0


async def goal_result(
    node: Node,
    client: ActionClient,
    goal: Any,
    *,
    group: CallbackGroup | None = None,
    feedback: Callable[[Any], object] = lambda _: None,
    wanted: Callable[[], bool] = lambda: True,
) -> Any:
    """Send a goal of drop_part or reorient_part, wait for its result and return it.

    Parameters
    ----------
    group : callback group of the timers; None: the group of the node
    feedback : called with each feedback message
    wanted : the goal is canceled when this returns False

    Raises
    ------
    NotAvailableError
        The simulator stopped before it sent the result.
    CanceledError
        ``wanted`` returned False.
    """
    last_feedback = time.monotonic()

    def on_feedback(message: Any) -> None:
        nonlocal last_feedback
        last_feedback = time.monotonic()
        feedback(message.feedback)

    async def arrived(future: Future) -> bool:
        if await wait_for(node, future, CHECK_PERIOD, group):
            return True
        if not client.server_is_ready():
            raise NotAvailableError(f'the simulator stopped while it simulated {goal.part}')
        return False

    handle = await _accepted(client, goal, on_feedback, arrived)
    answer = handle.get_result_async()
    while not await arrived(answer):
        if not wanted():
            await arrived(handle.cancel_goal_async())
            raise CanceledError(f'the simulation of {goal.part} was canceled')
        if time.monotonic() - last_feedback > RETRY_PERIOD:
            last_feedback = time.monotonic()
            again = handle.get_result_async()
            if await arrived(again):
                answer = again
    if answer.result().status == GoalStatus.STATUS_UNKNOWN:
        raise NotAvailableError(
            f'the simulator was restarted while it simulated {goal.part}: try again'
        )
    return answer.result().result


async def _accepted(
    client: ActionClient,
    goal: Any,
    on_feedback: Callable[[Any], None],
    arrived: Callable[[Future], Awaitable[bool]],
) -> ClientGoalHandle:
    """Send the goal until the simulator accepts it; return the handle."""
    goal_id = UUID(uuid=list(uuid4().bytes))
    for sends in range(MAX_SENDS):
        response = client.send_goal_async(goal, on_feedback, goal_id)
        end = time.monotonic() + GOAL_TIMEOUT
        while not await arrived(response) and time.monotonic() < end:
            pass
        # The simulator does not accept a goal a second time.
        if response.done() and (response.result().accepted or sends):
            return response.result()
        if response.done():
            raise NotAvailableError('the simulator did not accept the goal')
    raise NotAvailableError(
        f'the simulator did not accept the goal within {MAX_SENDS * GOAL_TIMEOUT:g} s'
    )
