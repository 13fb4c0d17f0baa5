"""Goals of the simulator as a client sends them, and drops whose messages are missing.

A client also detects that the simulator stopped or was restarted.
"""

import time
from collections.abc import Awaitable, Callable
from copy import copy
from functools import partial
from typing import Any
from uuid import uuid4

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import Status
from unique_identifier_msgs.msg import UUID

from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.ros.callbacks import sleep_for, wait_for
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.health import LivelinessMonitor
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    DROP_PART,
    DROP_SIMULATOR,
    LOG_REPLAYER,
)
from resting_aspects_ros.ros.requests import CanceledError, NotAvailableError, status_error
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import RunDescription

# Timeout after which a goal is sent again, s, and maximum number of attempts. The response is lost
# if a client discovers a simulator before the simulator discovers the client.
GOAL_TIMEOUT = 3.0
MAX_SENDS = 10
# Interval of checks that the simulator still exists and that the result is still needed, s.
CHECK_PERIOD = 0.5
# Time without feedback after which the result is requested again, s. A restarted simulator answers
# at once that it does not know the goal; a slow one eventually answers both requests.
RETRY_PERIOD = 5.0
# Time after the start of the node within which a simulator that was started together with it is
# ready, s. After that time, a running simulator is discovered within DISCOVERY_TIMEOUT, s.
STARTUP_TIMEOUT = 10.0
DISCOVERY_TIMEOUT = 2.0
# Interval of checks for conditions that have no event, s.
POLL_PERIOD = 0.1
# How often missing drops are requested, and how long their messages are waited for each time, s.
ATTEMPTS = 3
ARRIVAL_TIMEOUT = 5.0


async def goal_result(
    node: Node,
    client: ActionClient,
    goal: Any,
    *,
    feedback: Callable[[Any], object] = lambda _: None,
    wanted: Callable[[], bool] = lambda: True,
) -> Any:
    """Send a goal of drop_part or reorient_part, wait for its result and return it.

    Parameters
    ----------
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
        if await wait_for(node, future, CHECK_PERIOD):
            return True
        if not client.server_is_ready():
            raise NotAvailableError(f'the simulator stopped while it simulated {goal.part}')
        return False

    handle = await _accepted(client, goal, on_feedback, arrived)
    answer = Future(executor=node.executor)
    take = partial(_take_first, answer)
    handle.get_result_async().add_done_callback(take)
    while not await arrived(answer):
        if not wanted():
            await arrived(handle.cancel_goal_async())
            raise CanceledError(f'the simulation of {goal.part} was canceled')
        if time.monotonic() - last_feedback > RETRY_PERIOD:
            last_feedback = time.monotonic()
            # The first response that arrives is used: each of them may be lost or late.
            handle.get_result_async().add_done_callback(take)
    if answer.result().status == GoalStatus.STATUS_UNKNOWN:
        raise NotAvailableError(
            f'the simulator was restarted while it simulated {goal.part}: try again'
        )
    return answer.result().result


def _take_first(answer: Future, response: Future) -> None:
    if not answer.done():
        answer.set_result(response.result())


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


def drop_goal(part: str, conditions: DropConditions, seed: int, **fields: object) -> DropPart.Goal:
    """Return a goal of drop_part with all conditions."""
    return DropPart.Goal(
        part=part,
        surface=conditions.surface,
        conditions=[conditions_msg(conditions)],
        seed=seed,
        **fields,
    )


def goal_of_run(run: RunDescription) -> DropPart.Goal:
    """Return the goal with which drops of a run are published again."""
    return drop_goal(run.part, run.conditions, run.seed, run_id=run.run_id)


class DropClient:
    """Sends goals of drop_part, and requests drops again whose messages are missing.

    simulators, replayers : nodes that are alive in the namespace
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.simulators = LivelinessMonitor(node, DROP_SIMULATOR)
        self.replayers = LivelinessMonitor(node, LOG_REPLAYER)
        self._client = ActionClient(node, DropPart, DROP_PART, **ACTION_SERVICES)
        self._start = time.monotonic()

    def destroy(self) -> None:
        """Destroy the action client."""
        self._client.destroy()

    def is_ready(self) -> bool:
        """Return whether a goal can be sent now."""
        return bool(self.simulators.count and self._client.server_is_ready())

    @property
    def source_is_gone(self) -> bool:
        """Whether no simulator and no replayer is alive; False if neither has ever been."""
        was_seen = self.simulators.was_seen or self.replayers.was_seen
        return was_seen and not (self.simulators.count or self.replayers.count)

    async def wait_until_ready(self) -> None:
        """Wait until a simulator is ready; raises NotAvailableError after a timeout."""
        begin = time.monotonic()
        end = max(begin + DISCOVERY_TIMEOUT, self._start + STARTUP_TIMEOUT)
        while not self.is_ready():
            if time.monotonic() >= end:
                raise NotAvailableError(
                    f'no drop_simulator answers on {self._node.resolve_service_name(DROP_PART)}, '
                    f'waited {end - begin:.0f} s: start drop_simulator'
                )
            await sleep_for(self._node, POLL_PERIOD)

    async def drop(self, goal: DropPart.Goal) -> DropPart.Result:
        """Return the result of a goal; raises the error of the simulator."""
        result: DropPart.Result = await goal_result(self._node, self._client, goal)
        if result.status.code != Status.OK:
            raise status_error(result.status)
        return result

    async def request_again(
        self, goal: DropPart.Goal, missing: Callable[[], list[tuple[int, int]]]
    ) -> bool:
        """Request missing drops of a run, up to ATTEMPTS times; return whether all arrived.

        Parameters
        ----------
        goal : of the run, see goal_of_run
        missing : returns the ranges of drops that have not arrived
        """
        logger = self._node.get_logger()
        for _ in range(ATTEMPTS):
            for first, end in missing():
                text = f'drops {first} to {end - 1} of run {goal.run_id} ({goal.part})'
                logger.warning(f'{text} are missing and are requested again')
                again = copy(goal)
                again.first_drop, again.drops, again.precision = first, end - first, 0.0
                try:
                    await self.drop(again)
                except RestingAspectsError as error:
                    logger.warning(f'{text} are not available: {error}')
                    return False
            if await self.arrived(lambda: not missing(), ARRIVAL_TIMEOUT):
                return True
        return False

    async def arrived(self, condition: Callable[[], object], seconds: float) -> bool:
        """Wait until a condition holds, up to a timeout; return whether it does."""
        end = time.monotonic() + seconds
        pause = 0.002  # messages usually arrive before the result of their goal
        while not condition():
            if time.monotonic() >= end:
                return False
            await sleep_for(self._node, pause)
            pause = min(2 * pause, POLL_PERIOD)
        return True
