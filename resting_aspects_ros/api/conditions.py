"""Conditions and surroundings as they are given, and in words."""

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.support import ContactFinder, ContactPlane
from resting_aspects_ros.errors import (
    InvalidValueError,
    PartError,
    did_you_mean,
    one_line,
    shown,
)
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import ConvexPieces, convex_pieces
from resting_aspects_ros.simulation.actions import Actions
from resting_aspects_ros.simulation.conditions import (
    QUANTITIES,
    UNCERTAINTY,
    DropConditions,
    Surfaces,
    all_surfaces,
)
from resting_aspects_ros.simulation.scene import Scene, make_scene
from resting_aspects_ros.simulation.surroundings import (
    Surroundings,
    named_surroundings,
)
from resting_aspects_ros.statistics.distribution import ContactCounts, Distribution
from resting_aspects_ros.system import config_folder

# -- Conditions -----------------------------------------------------------------------------------


@functools.cache
def shipped_surfaces() -> Surfaces:
    """Return the surfaces of config/surfaces.yaml; the file is read once."""
    return all_surfaces()


def given_conditions(surface: str | DropConditions, changes: Mapping[str, Any]) -> DropConditions:
    """Return named or given conditions with the changes; raises InvalidValueError."""
    conditions = (
        surface if isinstance(surface, DropConditions) else shipped_surfaces().get(surface)
    )
    known = [field.name for field in dataclasses.fields(DropConditions) if field.compare]
    for name in changes:
        if name not in known:
            raise InvalidValueError(
                f'invalid condition {shown(name)}: expected one of {", ".join(known)}'
                f'{did_you_mean(name, known)}'
            )
    return conditions.changed(**changes) if changes else conditions


@functools.cache
def shipped_actions() -> Actions:
    """Return the actions of config/actions.yaml; the file is read once."""
    return Actions(config_folder() / 'actions.yaml')


def surface_text(conditions: DropConditions) -> str:
    """Return the name of the surface and the changed conditions; see Surfaces.text."""
    return one_line(shipped_surfaces().text(conditions))


def condition_facts(conditions: DropConditions) -> Iterator[tuple[str, str]]:
    """Yield label and value of each condition."""
    for name, quantity in QUANTITIES.items():
        of = f' ({conditions.height_of.label})' if name == 'height' else ''
        yield quantity.label, f'{getattr(conditions, name):g} {quantity.unit}'.rstrip() + of


def surface_entry(
    name: str,
    conditions: DropConditions,
    source: str,
    samples: Sequence[Mapping[str, float]] = (),
) -> str:
    """Return an entry for a surfaces file, such as config/surfaces.yaml.

    ``samples`` are equally probable values of the conditions that are not known exactly.
    """
    entry: dict[str, Any] = {key: getattr(conditions, key) for key in QUANTITIES}
    entry |= {'height_of': conditions.height_of.name, 'source': ' '.join(source.split())}
    if samples:
        entry[UNCERTAINTY] = {
            key: [float(f'{each[key]:.3g}') for each in samples] for key in samples[0]
        }
    return yaml_text({name: entry})


def when_text(started: int) -> str:
    """Return a time, ns since the epoch, as '2025-01-31 12:00:00 UTC'."""
    return f'{datetime.fromtimestamp(started / 1e9, timezone.utc):%Y-%m-%d %H:%M:%S} UTC'


# -- Surroundings ---------------------------------------------------------------------------------


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
    'l chute (roll 30 deg, pitch 0 deg), belt (friction 0.4, speed 0.2 m/s), wall (friction 0.2)'
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
    return dataclasses.replace(conditions, surroundings=found)


def scene_of(part: Part, conditions: DropConditions) -> Scene:
    """Return the surroundings of drops of a part, of which a level plane is the simplest."""
    return make_scene(conditions, part.hull_radius)


def aspects_in(scene: Scene, aspects: AspectSet) -> AspectSet:
    """Return the aspects as they are counted in surroundings: on the first plane."""
    if scene.level or not scene.half_spaces:
        return aspects
    first = next((p for p in scene.faces if p.name == scene.bodies[0].name), None)
    if first is None:
        return aspects
    normal = scene.in_tray(first.normal[None])[0]
    return dataclasses.replace(aspects, floor_normal=normal)


def contacts_in(scene: Scene, part: Part, aspects: AspectSet) -> ContactCounts | None:
    """Return counts by what the parts touch, without drops; None without walls."""
    if len(scene.faces) < 2:
        return None
    return ContactCounts(ContactFinder(part, aspects, contact_planes(scene)), aspects)


def without_drops(
    part: Part, conditions: DropConditions, aspects: AspectSet
) -> tuple[AspectSet, ContactCounts | None]:
    """Return how drops are counted: by which aspects, and by what they touch if there are walls.

    Drops on a mesh surface without its mesh are counted by the aspects of a level plane.
    """
    if conditions.surroundings is not None and not conditions.surroundings.known:
        return aspects, None
    scene = scene_of(part, conditions)
    aspects = aspects_in(scene, aspects)
    return aspects, contacts_in(scene, part, aspects)


def surroundings_text(surroundings: Surroundings) -> str:
    """Return where parts are, such as 'on a slope (angle 10 deg)'."""
    text = dataclasses.replace(surroundings, name='').text
    return f'{surroundings.shape.place} {text}'


def conditions_text(conditions: DropConditions) -> str:
    """Return the surface and the surroundings in words; see surface_text."""
    surface, around = surface_text(conditions), conditions.surroundings
    return surface if around is None else f'{surface}, {surroundings_text(around)}'


def contact_planes(scene: Scene) -> list[ContactPlane]:
    """Return the planes of surroundings in the tray frame, as contacts are counted on them."""
    normals = [scene.in_tray(face.normal[None])[0] for face in scene.faces]
    pairs = zip(scene.faces, normals, strict=True)
    return [ContactPlane(face.name, normal, face.offset) for face, normal in pairs]


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


def outcome_hints(distribution: Distribution, conditions: DropConditions) -> Iterator[str]:
    """Yield a sentence for each outcome that only surroundings have."""
    if conditions.surroundings is None:
        return
    if distribution.sliding:
        yield f'{_count(distribution.sliding, distribution)} slide or roll until the end.'
    if distribution.lost:
        how = conditions.surroundings.shape.loss
        yield f'{_count(distribution.lost, distribution)} are lost: {how}.'


def _count(number: int, distribution: Distribution) -> str:
    if number == distribution.drops > 1:
        return f'All {number} parts'
    return f'{number} of {distribution.drops} parts'


# -- Convex pieces --------------------------------------------------------------------------------


# Shorter distances, m, are rounding errors.
ROUNDING = 1e-9


def simulated_pieces(part: Part | None, conditions: DropConditions) -> ConvexPieces | None:
    """Return the convex pieces with which a part is simulated; None if only planes meet it.

    They are not known without the part, without the mesh of the surroundings, and if CoACD is not
    installed where a result of another machine is shown.
    """
    around = conditions.surroundings
    if part is None or around is None or not around.known:
        return None
    try:
        return None if scene_of(part, conditions).flat else convex_pieces(part)
    except PartError:
        return None


def pieces_text(pieces: ConvexPieces, what: str) -> str:
    """Return in words how far convex pieces are from the part; ``what`` meets the part."""
    number = len(pieces.corners)
    missing, excess = (_millimetres(each) for each in (pieces.missing, pieces.excess))
    return (
        f'{what} the part as {number} convex {"piece" if number == 1 else "pieces"}: at '
        f'most {missing} mm of it are missing, at most {excess} mm are extra, and the volume '
        f'differs by {100 * pieces.volume_error:+.1f} %.'
    )


def _millimetres(length: float) -> str:
    from resting_aspects_ros.report.format import number_text

    return number_text(1000 * length) if length >= ROUNDING else '0'
