"""What services and actions share: what may be asked for, and how errors are answered."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.core.errors import (
    InvalidValueError,
    PartError,
    RestingAspectsError,
    UnknownPartError,
    shown,
)
from resting_aspects_ros.core.estimators.estimate import METHODS
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError
from resting_aspects_ros.core.statistics.distribution import METHOD
from resting_aspects_ros.ros.conversions import conditions_from, status
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.part_library import unknown_part_text
from resting_aspects_ros.simulation.surfaces import Surfaces


class NotAvailableError(RestingAspectsError):
    """What is asked for is allowed, but not to be had now, or not in this version."""


class BusyError(RestingAspectsError):
    """Too much is under way."""


class CanceledError(RestingAspectsError):
    """It was canceled before it was done."""


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
    """The status that tells a client of an error."""
    return status(_CODES.get(type(error), Status.FAILED), str(error))


@contextmanager
def answering(service: str, response: Any, complain: Callable[[str], object]) -> Iterator[None]:
    """The edge of a service: what goes wrong within becomes the response's status."""
    try:
        yield
    except RestingAspectsError as error:
        response.status = error_status(error)
    except Exception as error:  # noqa: BLE001 - the edge: a defect must not stop the node
        complain(f'{service} failed: {error!r}')
        response.status = status(Status.FAILED, f'unexpected: {error!r}')


def status_error(answer: Status) -> RestingAspectsError:
    """The error that a status tells of."""
    kinds = {code: kind for kind, code in reversed(_CODES.items())}
    return kinds.get(answer.code, RestingAspectsError)(answer.message)


def asked_conditions(
    surfaces: Surfaces,
    surface: str,
    given: Sequence[DropConditionsMsg],
    default: DropConditions,
) -> DropConditions:
    """Those given, else those of the named surface, else the default."""
    if given:
        return surfaces.named(conditions_from(given[0]))
    return surfaces.get(surface) if surface else default


def asked_estimator(method: str) -> str | None:
    """The estimator that is asked for by name, or None for drops; raises InvalidValueError."""
    if method in ('', METHOD):
        return None
    if method not in METHODS:
        raise InvalidValueError(
            f'method {shown(method)} is not known, allowed are {METHOD}, {", ".join(METHODS)}'
        )
    return method


def unknown_part(name: str, known: Iterable[str]) -> UnknownPartError:
    """The error for a name that is none of those."""
    none = 'none, because no simulator has offered any yet'
    return UnknownPartError(unknown_part_text(name, known, none))
