"""What a forecast is asked for: pickable aspects, times of a cycle, footprints, and checks."""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.cycle import CycleTimes
from resting_aspects_ros.core.feeding.density import check_fit, free_shares
from resting_aspects_ros.core.feeding.footprint import Footprint, Tray
from resting_aspects_ros.core.feeding.model import check_number
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.vibration import Vibration

if TYPE_CHECKING:
    from resting_aspects_ros.core.vision.grasp import Grasp
    from resting_aspects_ros.core.vision.location import Placement


def cycle_times(
    action: NamedAction,
    *,
    robot: float,
    vibrate: float | None,
    settle: float | None,
    image: float,
    supply: float,
    overlap: bool,
    place: float | None,
) -> CycleTimes:
    """Return the times of a cycle, with those of the action where none are given.

    The time of a vibration is divided into its duration and the time until the parts are at rest;
    that of any other action is all vibration time. Raises InvalidValueError.
    """
    if place is not None and not overlap:
        raise InvalidValueError(f'invalid place time {place!r} s: expected only with overlap')
    made = action.action
    lasts = min(made.duration, action.time) if isinstance(made, Vibration) else action.time
    times = CycleTimes(
        robot=robot,
        vibrate=lasts if vibrate is None else vibrate,
        settle=action.time - lasts if settle is None else settle,
        image=image,
        supply=supply,
    )
    if not overlap:
        return times
    away = times.robot / 2 if place is None else place
    return dataclasses.replace(times, place=away)


def pickable_aspects(
    aspects: AspectSet, ids: Sequence[int] | None, classes: Sequence[int] | None
) -> tuple[int, ...]:
    """Return the ids of pickable aspects, ascending, from ids or from numbers of classes.

    Raises InvalidValueError if an id or a number is not known, or if there is none.
    """
    members = aspects.classes()
    what, limit, given = 'aspect', len(aspects), ids
    if given is None:
        what, limit, given = 'symmetry class', len(members), classes or ()
    if not given:
        raise InvalidValueError(f'invalid pickable {what}: expected at least one')
    for k in given:
        if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 1 <= k <= limit:
            raise InvalidValueError(f'invalid pickable {what} {shown(k)}: expected 1 to {limit}')
    if ids is not None:
        return tuple(sorted({int(k) for k in ids}))
    return tuple(sorted(aspect.id for k in set(given) for aspect in members[k - 1]))


def footprints_of(
    part: Part,
    aspects: AspectSet,
    rows: Sequence[tuple[Aspect, ...]],
    grasps: Sequence['Grasp'] = (),
) -> tuple[Footprint, ...]:
    """Return the rectangle, or the disc, around the outline of each row, with the grips of it."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.api.grasps import grips_of

    placements = {each.outline.symmetry_class: each for each in placements_of(part, aspects)}
    found = []
    for row in rows:
        placement = placements[row[0].symmetry_class]
        seen = placement.outline
        grips = grips_of(grasps, placement) if grasps else ()
        if seen.yaw_symmetry == 0:
            found.append(Footprint(0.0, 0.0, seen.length / 2, grips))
        else:
            found.append(Footprint(seen.length, seen.width, 0.0, grips))
    return tuple(found)


def placements_of(part: Part, aspects: AspectSet) -> tuple['Placement', ...]:
    """Return how the part lies in each symmetry class, with its outline."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.core.vision.location import Placement
    from resting_aspects_ros.core.vision.outline import find_outlines

    return tuple(Placement(part, aspects, each) for each in find_outlines(part, aspects))


def check_tray(part: Part, aspects: AspectSet, tray: Tray, number: int | None) -> None:
    """Raise InvalidValueError if the part, or the number of parts, does not fit on the tray."""
    footprints = footprints_of(part, aspects, aspects.classes())
    check_fit(tray, footprints)
    if number is not None:
        check_number('number of parts on the tray', number)
        free_shares(tray, footprints, np.ones(len(footprints)), 1, number).at(number)
