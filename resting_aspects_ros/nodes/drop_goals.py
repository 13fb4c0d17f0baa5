"""One drop_part goal followed to its end, also if that is the end of the simulator."""

import time
from collections.abc import Callable
from uuid import uuid4

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from unique_identifier_msgs.msg import UUID

from resting_aspects_ros.nodes.requests import CanceledError, NotAvailableError
from resting_aspects_ros.nodes.waiting import wait_for

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
    sent = _SentGoal(node, client, goal, group, feedback)
    handle = await sent.accepted()
    return await sent.result(handle, wanted)


class _SentGoal:
    def __init__(
        self,
        node: Node,
        client: ActionClient,
        goal: DropPart.Goal,
        group: CallbackGroup | None,
        feedback: Callable[[DropPart.Feedback], object],
    ) -> None:
        self._node = node
        self._client = client
        self._goal = goal
        self._group = group
        self._feedback = feedback
        self._heard = time.monotonic()

    async def accepted(self) -> ClientGoalHandle:
        """Send the goal until the simulator answers that it has it."""
        goal_id = UUID(uuid=list(uuid4().bytes))
        for sends in range(MAX_SENDS):
            asked = self._client.send_goal_async(self._goal, self._hear, goal_id)
            end = time.monotonic() + GOAL_TIMEOUT
            while not await self._arrived(asked) and time.monotonic() < end:
                self._check_there()
            if not asked.done():
                continue
            handle = asked.result()
            # One that it has already is not accepted a second time.
            if handle.accepted or sends:
                return handle
            raise NotAvailableError('the simulator did not accept the goal')
        raise NotAvailableError(f'the simulator accepted no goal in {MAX_SENDS * GOAL_TIMEOUT} s')

    async def result(
        self, handle: ClientGoalHandle, wanted: Callable[[], bool]
    ) -> DropPart.Result:
        """Wait for the result."""
        answer = handle.get_result_async()
        while not await self._arrived(answer):
            self._check_there()
            if not wanted():
                await self._arrived(handle.cancel_goal_async())
                raise CanceledError(f'the drops of {self._goal.part} are not wanted any more')
            if time.monotonic() - self._heard > ASK_PERIOD:
                self._heard = time.monotonic()
                again = handle.get_result_async()
                if await self._arrived(again):
                    answer = again
        if answer.result().status == GoalStatus.STATUS_UNKNOWN:
            raise NotAvailableError(
                f'the simulator was started again while it dropped {self._goal.part}: ask again'
            )
        return answer.result().result

    def _hear(self, message: DropPart.Impl.FeedbackMessage) -> None:
        self._heard = time.monotonic()
        self._feedback(message.feedback)

    async def _arrived(self, future: Future) -> bool:
        return await wait_for(self._node, future, LOOK_PERIOD, self._group)

    def _check_there(self) -> None:
        """Raises NotAvailableError if the simulator that existed does not any more."""
        if not self._client.server_is_ready():
            raise NotAvailableError(f'the simulator went away while it dropped {self._goal.part}')
