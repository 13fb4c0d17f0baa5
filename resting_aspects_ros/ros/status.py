"""Errors and statuses of services and actions, and checks of their requests."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
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
from resting_aspects_ros.ros.conversions import conditions_from, status
from resting_aspects_ros.simulation.conditions import DropConditions, Surfaces
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


@contextmanager
def status_from_errors(
    service: str, response: Any, log_error: Callable[[str], object]
) -> Iterator[None]:
    """Context manager of a service: an error within becomes the status of the response."""
    try:
        yield
    except RestingAspectsError as error:
        response.status = error_status(error)
    except Exception as error:  # noqa: BLE001 - the edge: a defect must not stop the node
        log_error(f'{service} failed: {error!r}')
        response.status = status(Status.FAILED, f'unexpected error {error!r}')


def status_error(answer: Status) -> RestingAspectsError:
    """Return the error that a status reports."""
    kinds = {code: kind for kind, code in reversed(_CODES.items())}
    return kinds.get(answer.code, RestingAspectsError)(answer.message)


def requested_conditions(
    surfaces: Surfaces,
    surface: str,
    conditions: Sequence[DropConditionsMsg],
    default: DropConditions,
) -> DropConditions:
    """Return the given conditions, else those of the named surface, else the default."""
    if conditions:
        return surfaces.named(conditions_from(conditions[0]))
    return surfaces.get(surface) if surface else default


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
