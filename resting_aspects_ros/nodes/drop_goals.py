"""One drop_part goal followed to its end, also if that is the end of the simulator."""

import time
from collections.abc import Callable
from uuid import uuid4

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.node import Node
from resting_aspects_interfaces.action import DropPart
from unique_identifier_msgs.msg import UUID

from resting_aspects_ros.nodes.requests import NotAvailableError
from resting_aspects_ros.nodes.waiting import wait_for

# A simulator takes a goal within this, s; else it is sent again, so often. It can be that it has
# been found and has not yet found who asks: then it takes the goal, and its answer is lost.
GOAL_TIMEOUT = 3.0
MOST_SENDS = 10
# How often it is looked whether the simulator is still there, s.
LOOK_PERIOD = 1.0
# After so long without feedback it is asked for the result again, s: one that was restarted
# answers at once that it does not know the goal; one that is slow answers both in the end.
ASK_PERIOD = 5.0


async def drop_result(node: Node, client: ActionClient, goal: DropPart.Goal) -> DropPart.Result:
    """Send a goal and wait for its result; NotAvailableError if the simulator is gone before."""
    heard = time.monotonic()

    def note_feedback(_: object) -> None:
        nonlocal heard
        heard = time.monotonic()

    handle = await _taken(node, client, goal, note_feedback)
    answer = handle.get_result_async()
    while not await wait_for(node, answer, LOOK_PERIOD):
        _check_there(client, goal)
        if time.monotonic() - heard > ASK_PERIOD:
            heard = time.monotonic()
            again = handle.get_result_async()
            if await wait_for(node, again, LOOK_PERIOD):
                answer = again
    if answer.result().status == GoalStatus.STATUS_UNKNOWN:
        raise NotAvailableError(
            f'the simulator was started again while it dropped {goal.part}: ask again'
        )
    return answer.result().result


async def _taken(
    node: Node, client: ActionClient, goal: DropPart.Goal, feedback: Callable[[object], None]
) -> ClientGoalHandle:
    """Send a goal until the simulator answers that it has it."""
    goal_id = UUID(uuid=list(uuid4().bytes))
    for sends in range(MOST_SENDS):
        asked = client.send_goal_async(goal, feedback, goal_id)
        if await wait_for(node, asked, GOAL_TIMEOUT):
            handle = asked.result()
            # One that it has already is not accepted a second time.
            if handle.accepted or sends:
                return handle
            raise NotAvailableError('the simulator did not take the goal')
        _check_there(client, goal)
    raise NotAvailableError(f'the simulator took no goal in {MOST_SENDS * GOAL_TIMEOUT:g} s')


def _check_there(client: ActionClient, goal: DropPart.Goal) -> None:
    """Raises NotAvailableError if the simulator that was there is not any more."""
    if not client.server_is_ready():
        raise NotAvailableError(f'the simulator went away while it dropped {goal.part}')
