"""Surroundings of drops: from their names, and what they are for the classification of poses."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.contacts import ContactFinder, ContactPlane
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.contact_counts import ContactCounts
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.library import (
    named_surroundings,
    surroundings_from,
)
from resting_aspects_ros.simulation.surroundings.scene import HalfSpace, Scene


def surroundings(name: str | Path, **changes: Any) -> Surroundings:
    """Return named surroundings, a kind of surroundings, or those in a YAML file.

    Parameters
    ----------
    name : str or Path
        A name of config/surroundings, a kind such as 'slope', or a YAML file.
    **changes : float or str or mapping
        Values that differ, in SI units or as texts with a unit; a mapping for a body or for
        ``release``.

    Raises
    ------
    InvalidValueError
        If the name is not known, the file cannot be read, or a value is out of bounds.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> chute = ra.surroundings('l_chute', roll='30deg', belt={'speed': 0.2})
    >>> chute.text
    'l_chute, roll 30 deg, pitch 0 deg, belt friction 0.4, belt speed 0.2 m/s, wall friction 0.2'
    """
    flat: dict[str, Any] = {}
    for key, value in changes.items():
        if isinstance(value, Mapping):
            flat.update({f'{key}.{inner}': each for inner, each in value.items()})
        else:
            flat[key] = value
    return named_surroundings(name, flat)


def with_surroundings(
    conditions: DropConditions, given: str | Path | Surroundings | None
) -> DropConditions:
    """Return the conditions with the surroundings, which may be given by name; None: as it is."""
    if given is None:
        return conditions
    found = given if isinstance(given, Surroundings) else named_surroundings(given)
    return dataclasses.replace(conditions, surroundings=found.key)


def scene_of(part: Part, conditions: DropConditions) -> Scene | None:
    """Return the surroundings of drops of a part; None for the infinite level plane."""
    if not conditions.surroundings:
        return None
    return surroundings_from(conditions.surroundings).scene(conditions, part.hull_radius)


def aspects_in(scene: Scene | None, aspects: AspectSet) -> AspectSet:
    """Return the aspects as they are counted in surroundings: on the first plane."""
    if scene is None or not scene.half_spaces:
        return aspects
    first = next((p for p in scene.faces if p.name == scene.bodies[0].name), None)
    if first is None:
        return aspects
    normal = scene.in_tray(first.normal[None])[0]
    return dataclasses.replace(aspects, floor_normal=normal)


def contacts_in(scene: Scene | None, part: Part, aspects: AspectSet) -> ContactCounts | None:
    """Return counts by what the parts touch, without drops; None without walls."""
    if scene is None or len(scene.faces) < 2:
        return None
    planes = [_contact_plane(scene, face) for face in scene.faces]
    return ContactCounts(ContactFinder(part, aspects, planes), aspects)


def _contact_plane(scene: Scene, face: HalfSpace) -> ContactPlane:
    return ContactPlane(face.name, scene.in_tray(face.normal[None])[0], face.offset)


def requested_surroundings(name: str | None, changes: list[str]) -> Surroundings | None:
    """Return the surroundings of a name and changes of the form ``NAME=VALUE``; None if none.

    Raises InvalidValueError.
    """
    if name is None:
        if changes:
            raise InvalidValueError(
                f'invalid --set {changes[0]!r}: expected only with --surroundings'
            )
        return None
    values: dict[str, str] = {}
    for change in changes:
        key, equals, value = change.partition('=')
        if not equals or not key:
            raise InvalidValueError(
                f'invalid --set {change!r}: expected NAME=VALUE, such as roll=30deg or '
                'belt.friction=0.4'
            )
        values[key.strip()] = value.strip()
    return named_surroundings(name, values)
