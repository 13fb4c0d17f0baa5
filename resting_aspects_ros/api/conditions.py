"""Conditions and surroundings as they are given, and in words.

Warnings and hints state where parts wedge, and why they slide, are lost, or lean. Where more than
planes meet a part, texts say how part and surroundings are represented.
"""

import dataclasses
import functools
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.support import ContactFinder, ContactPlane
from resting_aspects_ros.errors import (
    InvalidValueError,
    PartError,
    did_you_mean,
    one_line,
    shown,
    warn,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import ConvexPieces, convex_pieces
from resting_aspects_ros.rotations import canonical, orientation_with_down, product, rotate
from resting_aspects_ros.simulation.conditions import (
    QUANTITIES,
    UNCERTAINTY,
    DropConditions,
    Surfaces,
    all_surfaces,
)
from resting_aspects_ros.simulation.scene import Block, HalfSpace, MeshBody, Scene, make_scene
from resting_aspects_ros.simulation.surroundings import (
    Surroundings,
    named_surroundings,
)
from resting_aspects_ros.simulation.surroundings_kinds import (
    NO_CONTACT,
    MeshSurface,
    VGroove,
    tray_from_scene,
)
from resting_aspects_ros.statistics.distribution import ContactCounts, Distribution
from resting_aspects_ros.system import config_folder

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.actions import Actions


# -- Conditions -----------------------------------------------------------------------------------


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
    known = [field.name for field in dataclasses.fields(DropConditions) if field.compare]
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

    Parameters
    ----------
    name : str
        Name of the surface.
    conditions : DropConditions
    source : str
        Where the values come from.
    samples : sequence of mappings
        Equally probable values of the conditions that are not known exactly.
    """
    lines = [f'{name}:']
    for key in QUANTITIES:
        lines.append(f'  {key}: {getattr(conditions, key)}')
        if key == 'height':
            lines.append(f'  height_of: {conditions.height_of.name}')
    lines.append('  source: >-')
    lines += [f'    {line}' for line in _folded(source, 94)]
    if samples:
        comment = 'equally probable; the k-th values belong together'
        lines.append(f'  {UNCERTAINTY}:  # {comment}')
    for key in samples[0] if samples else ():
        values = ', '.join(f'{each[key]:.3g}' for each in samples)
        lines += [
            f'    {key}: [',
            *(f'      {line}' for line in _folded(values, 92)),
            '    ]',
        ]
    return '\n'.join(lines) + '\n'


def _folded(text: str, width: int) -> list[str]:
    """Return the lines of a text that YAML can fold again."""
    return textwrap.wrap(' '.join(text.split()), width, break_long_words=False)


def when_text(started: int) -> str:
    """Return a time, ns since the epoch, as '2025-01-31 12:00:00 UTC'."""
    return f'{datetime.fromtimestamp(started / _NANOSECONDS, timezone.utc):%Y-%m-%d %H:%M:%S} UTC'


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


def has_level_floor(conditions: DropConditions) -> bool:
    """Return whether parts lie on a level plane; False if the surroundings are a mesh."""
    if conditions.surroundings is None:
        return True
    shape = conditions.surroundings.shape
    if isinstance(shape, MeshSurface):
        return False
    floor = shape.bodies(dict.fromkeys(shape.body_names, NO_CONTACT))[0]
    if not isinstance(floor, HalfSpace | Block):
        return False
    up = rotate(tray_from_scene(*shape.tilt), floor.normal)
    return bool(up[2] > 1 - 1e-9)


def aspects_in(scene: Scene, aspects: AspectSet) -> AspectSet:
    """Return the aspects as they are counted in surroundings: on the first plane."""
    if scene.level or not scene.half_spaces:
        return aspects
    first = next((p for p in scene.faces if p.name == scene.bodies[0].name), None)
    if first is None:
        return aspects
    normal = scene.in_tray(first.normal[None])[0]
    return dataclasses.replace(aspects, floor_normal=normal)


def on_level_floor(
    orientation: Array, part: Part, surroundings: str | Path | Surroundings
) -> Array:
    """Return orientations (n, 4) turned so that the normal of the first body points up."""
    scene = scene_of(part, with_surroundings(shipped_surfaces().get(), surroundings))
    normal = aspects_in(scene, AspectSet('', ())).floor_normal
    if normal is None:
        return orientation
    turn = orientation_with_down(-normal)
    return canonical(product(np.tile(turn, (len(orientation), 1)), orientation))


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


def outcome_hints(
    distribution: Distribution, conditions: DropConditions, radius: float | None
) -> Iterator[str]:
    """Yield a sentence for each outcome that only surroundings have.

    Parameters
    ----------
    radius : float or None
        Hull radius of the part, m; None if the part is not known: yields nothing.
    """
    surroundings = conditions.surroundings
    if surroundings is None or radius is None or not surroundings.known:
        return
    scene = surroundings.scene(conditions, radius)
    if distribution.sliding:
        reason = slide_reason(scene)
        yield (
            f'{_count(distribution.sliding, distribution)} slide or roll until the end'
            f'{": " if reason else ""}{reason}.'
        )
    if distribution.lost:
        how = surroundings.shape.loss
        yield f'{_count(distribution.lost, distribution)} are lost: {how}.'
    if distribution.unclassified and len(scene.faces) > 1:
        name = scene.faces[0].name.replace('_', ' ')
        yield (
            f'{_count(distribution.unclassified, distribution)} came to rest but do not lie in '
            f'an aspect on the {name}: they lean. The contacts show how.'
        )


def warn_of_surroundings(conditions: DropConditions, radius: float) -> None:
    """Warn, before the drops, of surroundings in which the drops can take long.

    Parameters
    ----------
    radius : float
        Hull radius of the part, m.
    """
    surroundings = conditions.surroundings
    if surroundings is not None and isinstance(surroundings.shape, VGroove):
        scene = surroundings.scene(conditions, radius)
        if reason := wedge_reason(scene, surroundings.shape.opening):
            warn(reason)


def wedge_reason(scene: Scene, opening: float) -> str:
    """Return why parts can wedge between the two planes of a groove; empty if they cannot.

    Two opposite contacts hold a part without any load if the line between them is in both cones
    of friction, which is possible if the opening, rad, is at most the sum of the friction angles.
    """
    holds = sum(math.atan(plane.contact.friction) for plane in scene.half_spaces)
    if opening > holds:
        return ''
    return (
        f'parts can wedge in the groove: its opening of {_degrees(opening)} does not exceed the '
        f'sum of the friction angles of its planes, {_degrees(holds)}; the simulation of '
        'wedged parts can take minutes'
    )


def _count(number: int, distribution: Distribution) -> str:
    if number == distribution.drops > 1:
        return f'All {number} parts'
    return f'{number} of {distribution.drops} parts'


def slide_reason(scene: Scene) -> str:
    """Return why no part can stay at rest in a scene; empty if friction can hold parts.

    Friction holds a part on a plane if the inclination is at most atan(friction). In a groove or
    a chute it holds the part along the groove if the component of gravity along it is at most the
    sum of friction times normal force of both planes. Empty if a surface moves.
    """
    if not scene.flat or not scene.free or len(scene.velocities()) > 1:
        return ''
    normals = np.array([plane.normal for plane in scene.half_spaces])
    friction = np.array([plane.contact.friction for plane in scene.half_spaces])
    if scene.free == 2:
        across = float(-normals[0] @ scene.down)
        along, holds = math.sqrt(max(1 - across**2, 0.0)), float(friction[0]) * across
        what = f'friction angle of {_degrees(math.atan(friction[0]))} (friction {friction[0]:g})'
    else:
        from scipy.optimize import nnls  # slow, and only needed here

        forces, _ = nnls(normals.T[1:], -scene.down[1:])
        across = float(np.linalg.norm(scene.down[1:]))
        along, holds = abs(float(scene.down[0])), float(friction @ forces)
        names = ' and '.join(dict.fromkeys(plane.name for plane in scene.half_spaces))
        what = f'{_degrees(math.atan2(holds, across))} at which friction on {names} holds a part'
    if along <= holds * (1 + 1e-9):
        return ''
    return f'the slope of {_degrees(math.atan2(along, across))} exceeds the {what}'


def _degrees(angle: float) -> str:
    return f'{math.degrees(angle):.3g} degrees'


# -- Simulated shapes -----------------------------------------------------------------------------


# Shorter distances, m, are rounding errors.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class SimulatedShapes:
    """Shapes that the simulation uses instead of the real ones.

    pieces : ConvexPieces
        Of the part.
    mesh : MeshBody or None
        The mesh of the surroundings, with its flat sides as prisms and its other sides simplified.
    """

    pieces: ConvexPieces
    mesh: MeshBody | None

    def document(self) -> dict[str, Any]:
        """Return the fields of a JSON document of drops."""
        fields: dict[str, Any] = {'convex_pieces': self.pieces.summary()}
        if self.mesh is not None:
            fields['mesh_surface'] = {
                'triangles': len(self.mesh.triangles),
                'flat_sides': self.mesh.sides,
                'prisms': len(self.mesh.prisms),
                'remaining_triangles': _remaining(self.mesh),
                'distance': self.mesh.distance,
            }
        return fields

    def sentences(self) -> Iterator[str]:
        """Yield a sentence about each shape."""
        what = 'The edge meets' if self.mesh is None else 'The mesh meets'
        yield pieces_text(self.pieces, what)
        if self.mesh is not None:
            yield _mesh_text(self.mesh)


def simulated_shapes(part: Part | None, conditions: DropConditions) -> SimulatedShapes | None:
    """Return the shapes that drops of a part use; None if only planes meet it, or not known.

    They are not known without the part, without the mesh of the surroundings, and if CoACD is not
    installed where a result of another machine is shown.
    """
    around = conditions.surroundings
    if part is None or around is None or not around.known:
        return None
    try:
        scene = scene_of(part, conditions)
        if scene.flat:
            return None
        pieces = convex_pieces(part)
    except PartError:
        return None
    return SimulatedShapes(
        pieces, next((b for b in scene.bodies if isinstance(b, MeshBody)), None)
    )


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


def _mesh_text(mesh: MeshBody) -> str:
    remaining = _number(_remaining(mesh), 'triangle')
    if not mesh.prisms and not mesh.distance:
        return f'The part meets the {remaining} of the mesh.'
    simulated = []
    if mesh.prisms:
        sides = _number(mesh.sides, 'flat side')
        prisms = _number(len(mesh.prisms), 'convex prism')
        simulated.append(f'{prisms}, into which the triangles of {sides} are merged')
    if mesh.distance:
        away = _millimetres(mesh.distance)
        simulated.append(f'{remaining}, which are at most {away} mm away from its curved sides')
    elif _remaining(mesh):
        simulated.append(f'its other {remaining}')
    return (
        f'The mesh of {len(mesh.triangles):,} triangles is simulated as '
        f'{", and ".join(simulated)}.'
    )


def _remaining(mesh: MeshBody) -> int:
    return len(mesh.triangles if mesh.remaining is None else mesh.remaining)


def _number(number: int, what: str) -> str:
    return f'{number:,} {what}{"" if number == 1 else "s"}'
