"""Named conditions and actions; conditions and times as text."""

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.errors import InvalidValueError, did_you_mean, one_line, shown
from resting_aspects_ros.simulation.conditions import (
    QUANTITIES,
    DropConditions,
    Surfaces,
    actions_file,
    all_surfaces,
)

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.actions import Actions

_NANOSECONDS = 1_000_000_000


@functools.cache
def shipped_surfaces() -> Surfaces:
    """Return the surfaces of config/surfaces.yaml; the file is read once."""
    return all_surfaces()


def given_conditions(surface: str | DropConditions, changes: Mapping[str, Any]) -> DropConditions:
    """Return named or given conditions with the changes; raises InvalidValueError."""
    conditions = (
        surface if isinstance(surface, DropConditions) else shipped_surfaces().get(surface)
    )
    known = [field.name for field in dataclasses.fields(DropConditions)]
    for name in changes:
        if name not in known:
            raise InvalidValueError(
                f'invalid condition {shown(name)}: expected one of {", ".join(known)}'
                f'{did_you_mean(name, known)}'
            )
    return conditions.changed(**changes) if changes else conditions


@functools.cache
def shipped_actions() -> 'Actions':
    """Return the actions of config/actions.yaml; the file is read once."""
    # This import is slow because of NumPy, which --help does not need.
    from resting_aspects_ros.simulation.actions import Actions

    return Actions.read(actions_file())


def surface_text(conditions: DropConditions) -> str:
    """Return the name of the surface and the changed conditions; see Surfaces.text."""
    return one_line(shipped_surfaces().text(conditions))


def condition_facts(conditions: DropConditions) -> Iterator[tuple[str, str]]:
    """Yield label and value of each condition."""
    for name, quantity in QUANTITIES.items():
        of = f' ({conditions.height_of.label})' if name == 'height' else ''
        yield quantity.label, f'{getattr(conditions, name):g} {quantity.unit}'.rstrip() + of


def when_text(started: int) -> str:
    """Return a time, ns since the epoch, as '2025-01-31 12:00:00 UTC'."""
    return f'{datetime.fromtimestamp(started / _NANOSECONDS, timezone.utc):%Y-%m-%d %H:%M:%S} UTC'
