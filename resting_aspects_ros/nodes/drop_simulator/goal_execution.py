"""Execution of a goal: its errors become the status of its result."""

from collections.abc import Awaitable, Callable
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.ros.conversions import status
from resting_aspects_ros.ros.status import CanceledError, error_status

# Maximum number of concurrent goals of an action; all goals share the workers chunk by chunk.
MAX_GOALS = 16
# Time for which a result is kept for a client that requests it late, s.
RESULT_TIMEOUT = 300


async def execute_goal(
    node: Node,
    action: str,
    handle: ServerGoalHandle,
    result: Any,
    work: Callable[[ServerGoalHandle], Awaitable[tuple[Any, Exception | None]]],
) -> Any:
    """Return the result of a goal with its status, and set the state of the goal.

    action : name of the action
    result : returned if ``work`` raises an error
    work : returns the result, whose status is OK, and the error that ended the goal early, if any
    """
    try:
        result, error = await work(handle)
        if error is not None:
            raise error
        handle.succeed()
    except CanceledError as error:
        result.status = error_status(error)
        handle.canceled()
    except RestingAspectsError as error:
        result.status = error_status(error)
        handle.abort()
    except InvalidHandle:
        result.status = status(Status.FAILED, 'the node has stopped')  # it cannot be sent
    except Exception as error:  # noqa: BLE001 - the edge: a defect must not look like an answer
        node.get_logger().error(f'{action} failed: {error!r}')
        result.status = status(Status.FAILED, f'unexpected error {error!r}')
        handle.abort()
    return result
