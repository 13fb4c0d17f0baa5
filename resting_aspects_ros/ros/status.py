"""Errors and statuses of services and actions, and the checks of requests."""

import math
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.aspects.estimate import METHODS, NotDefinedError
from resting_aspects_ros.errors import (
    InvalidValueError,
    PartError,
    RestingAspectsError,
    UnknownPartError,
    shown,
)
from resting_aspects_ros.part.library import unknown_part_text
from resting_aspects_ros.ros.conversions import status
from resting_aspects_ros.ros.interface import SERVICES
from resting_aspects_ros.statistics.distribution import METHOD


class NotAvailableError(RestingAspectsError):
    """A valid request cannot be answered now, or not by this version."""


class BusyError(RestingAspectsError):
    """Too many requests are active."""


class CanceledError(RestingAspectsError):
    """A request was canceled before it was done."""


_CODES: dict[type[RestingAspectsError], int] = {
    UnknownPartError: Status.UNKNOWN_PART,
    InvalidValueError: Status.INVALID,
    PartError: Status.INVALID,
    NotAvailableError: Status.NOT_AVAILABLE,
    NotDefinedError: Status.INVALID,
    BusyError: Status.BUSY,
    CanceledError: Status.CANCELED,
}


def error_status(error: RestingAspectsError) -> Status:
    """Return the status that reports an error to a client."""
    return status(_CODES.get(type(error), Status.FAILED), str(error))


def serve(node: Node, kind: Any, name: str, answer: Callable[[Any, Any], Awaitable[None]]) -> None:
    """Create a service; an error of ``answer`` becomes the status of the response.

    Parameters
    ----------
    answer : coroutine function
        Fills in the response to a request. Its numbers are NaN and its status is OK before.
    """

    async def respond(request: Any, response: Any) -> Any:
        for field, field_type in response.get_fields_and_field_types().items():
            if field_type == 'double':
                setattr(response, field, math.nan)
        response.status = status(Status.OK)
        try:
            await answer(request, response)
        except RestingAspectsError as error:
            response.status = error_status(error)
        except Exception as error:  # noqa: BLE001 - the edge: a defect must not stop the node
            node.get_logger().error(f'{name} failed: {error!r}')
            response.status = status(Status.FAILED, f'unexpected error {error!r}')
        return response

    # In the default group of the node, a waiting request would block what it waits for.
    group = ReentrantCallbackGroup()
    node.create_service(kind, name, respond, qos_profile=SERVICES, callback_group=group)


def status_error(answer: Status) -> RestingAspectsError:
    """Return the error that a status reports."""
    kinds = {code: kind for kind, code in reversed(_CODES.items())}
    return kinds.get(answer.code, RestingAspectsError)(answer.message)


def requested_estimator(method: str) -> str | None:
    """Return the requested estimator, or None for drops; raises InvalidValueError."""
    if method in ('', METHOD):
        return None
    if method not in METHODS:
        raise InvalidValueError(
            f'invalid method {shown(method)}: expected {METHOD} or one of {", ".join(METHODS)}'
        )
    return method


def unknown_part(name: str, known: Iterable[str]) -> UnknownPartError:
    """Return the error for a name that is not one of the known parts."""
    none = 'none, because no simulator has offered any yet'
    return UnknownPartError(unknown_part_text(name, known, none))
