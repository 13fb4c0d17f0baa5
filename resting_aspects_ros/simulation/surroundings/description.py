"""Description of surroundings: a kind with its dimensions, its bodies' values and the release."""

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE, canonical
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions
from resting_aspects_ros.simulation.quantity import Quantity, quantities_of
from resting_aspects_ros.simulation.surroundings.kinds import (
    BowlTrack,
    Chute,
    Corner,
    Kind,
    Plane,
    Slope,
    Tray,
    VGroove,
    Wall,
    tray_from_scene,
)
from resting_aspects_ros.simulation.surroundings.mesh_checks import ground_of
from resting_aspects_ros.simulation.surroundings.mesh_surface import MeshSurface
from resting_aspects_ros.simulation.surroundings.release import check_release
from resting_aspects_ros.simulation.surroundings.scene import MeshBody, PairValues, Scene
from resting_aspects_ros.simulation.surroundings.texts import group_text

KINDS: dict[str, type[Any]] = {
    each.kind: each
    for each in (Plane, Slope, Wall, VGroove, Chute, Corner, BowlTrack, Tray, MeshSurface)
}
# Values of a body; those of the pair are taken from the conditions unless they are given.
BODY_VALUES: dict[str, Quantity] = {
    **{name: QUANTITIES[name] for name in ('friction', 'restitution', 'rolling_friction')},
    'speed': Quantity('speed', 'm/s', 'speed of the surface', low=-100.0, high=100.0),
}
# Where parts are released, m in the tray frame: x and y are those of the centre of mass.
RELEASE_VALUES: dict[str, Quantity] = {
    name: Quantity(name.replace('_', ' '), 'm', text, low=-100.0, high=100.0)
    for name, text in {
        'x_min': 'lowest x of the release',
        'x_max': 'highest x of the release',
        'y_min': 'lowest y of the release',
        'y_max': 'highest y of the release',
    }.items()
}


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Surroundings of a drop: a kind with its dimensions, values of its bodies, and the release.

    Parameters
    ----------
    shape : Kind
        Such as ``Slope(angle=0.3)``; one of the classes in KINDS.
    bodies : mapping of str to mapping of str to float
        Values of a body that differ from the conditions, by the name of the body, such as
        ``{'belt': {'friction': 0.4, 'speed': 0.1}}``; see BODY_VALUES.
    release : mapping of str to float
        Place of release; see RELEASE_VALUES. A value that is not given follows from the kind and
        the size of the part.
    orientation : (4,) sequence of float, optional
        Orientation at release, xyzw, tray from part; by default uniformly random.
    name : str
        Name of the surroundings; not part of their values, which are compared.

    Raises
    ------
    InvalidValueError
        If a name is not known, or a value is out of bounds.
    """

    shape: Kind
    bodies: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    release: Mapping[str, float] = dataclasses.field(default_factory=dict)
    orientation: tuple[float, ...] | None = None
    name: str = ''

    def __post_init__(self) -> None:
        if not isinstance(self.shape, tuple(KINDS.values())):
            raise InvalidValueError(
                f'invalid surroundings {shown(self.shape)}: expected one of '
                f'{", ".join(each.__name__ for each in KINDS.values())}'
            )
        names = self.shape.body_names
        bodies = _mapping('bodies', self.bodies, names)
        for body, values in bodies.items():
            bodies[body] = _checked(body, values, BODY_VALUES)
        release = _checked('release', self.release, RELEASE_VALUES)
        for axis in 'xy':
            low, high = release.get(f'{axis}_min'), release.get(f'{axis}_max')
            if low is not None and high is not None and low > high:
                raise InvalidValueError(
                    f'invalid release {axis}_min {low:g}: expected at most {axis}_max, {high:g} m'
                )
        object.__setattr__(self, 'bodies', {k: bodies[k] for k in names if bodies.get(k)})
        object.__setattr__(self, 'release', release)
        if self.orientation is not None:
            object.__setattr__(self, 'orientation', _quaternion(self.orientation))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Surroundings) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def level(self) -> bool:
        """Whether these are the infinite level plane, with the values of the conditions."""
        flat = isinstance(self.shape, Plane) or (
            isinstance(self.shape, Slope) and self.shape.angle == 0
        )
        return flat and not self.bodies and self.orientation is None

    @property
    def document(self) -> dict[str, Any]:
        """Everything that the simulation depends on, as a mapping of plain values."""
        document: dict[str, Any] = {'kind': self.shape.kind, **self.shape_values}
        if self.bodies:
            document['bodies'] = {k: dict(v) for k, v in self.bodies.items()}
        if self.release:
            document['release'] = dict(self.release)
        if self.orientation is not None:
            document['orientation'] = list(self.orientation)
        return document

    @property
    def shape_values(self) -> dict[str, Any]:
        """Dimensions of the kind, SI units."""
        values = {name: getattr(self.shape, name) for name in quantities_of(self.shape)}
        return {**values, **getattr(self.shape, 'texts', {})}

    @property
    def known(self) -> bool:
        """Whether parts can be dropped in them: not without the triangles of a mesh surface."""
        return not isinstance(self.shape, MeshSurface) or self.shape.file is not None

    @cached_property
    def key(self) -> str:
        """The document as canonical JSON; equal for equal surroundings, empty if level."""
        if self.level:
            return ''
        return json.dumps(self.document, sort_keys=True, separators=(',', ':'))

    @property
    def text(self) -> str:
        """The surroundings in words: 'chute (roll 45 deg), belt (friction 0.4)'."""
        shape = quantities_of(self.shape)
        texts = [Path(text).name for key, text in self.shape_values.items() if key == 'mesh']
        values = {name: getattr(self.shape, name) for name in shape}
        if isinstance(self.shape, MeshSurface):  # its pose, if it is not that of the file
            values = {name: value for name, value in values.items() if value}
        parts = [group_text(self.name or self.shape.kind, values, shape, texts)]
        parts += [group_text(body, each, BODY_VALUES) for body, each in self.bodies.items()]
        if self.release:
            parts.append(group_text('release', self.release, RELEASE_VALUES))
        if self.orientation is not None:
            parts.append('given orientation')
        return ', '.join(parts)

    def scene(self, conditions: DropConditions, radius: float) -> Scene:
        """Return bodies, gravity and release for a part of a hull radius, m.

        Raises InvalidValueError if a part could touch a body at the release.
        """
        contacts = {name: self._contact(name, conditions) for name in self.shape.body_names}
        bodies, region = self.shape.bodies(contacts), self._region(radius)
        scene = Scene(
            bodies=bodies,
            tray_from_scene=tray_from_scene(*self.shape.tilt),
            free=self.shape.free,
            region=region,
            ground=max(
                (ground_of(b, region, radius) for b in bodies if isinstance(b, MeshBody)),
                default=0.0,
            ),
            lost=self.shape.lost(radius),
            orientation=None if self.orientation is None else np.array(self.orientation),
        )
        check_release(scene, radius)
        return self._merged(scene, radius)

    def _merged(self, scene: Scene, radius: float) -> Scene:
        shape = self.shape
        if not isinstance(shape, MeshSurface):
            return scene
        merged = [shape.merged(b, radius) for b in scene.bodies if isinstance(b, MeshBody)]
        return dataclasses.replace(scene, bodies=tuple(merged))

    def _contact(self, name: str, conditions: DropConditions) -> PairValues:
        pair = {k: getattr(conditions, k) for k in BODY_VALUES if k != 'speed'}
        return PairValues(**{**pair, **self.bodies.get(name, {})})

    def _region(self, radius: float) -> tuple[Any, Any]:
        low, high = (radius * r for r in self.shape.across)
        centre = getattr(self.shape, 'centre', (0.0, 0.0))
        found = []
        for axis, middle, ends in (('x', centre[0], (0.0, 0.0)), ('y', centre[1], (low, high))):
            given = self.release.get(f'{axis}_min'), self.release.get(f'{axis}_max')
            if given == (None, None):
                found.append(np.array([middle + ends[0], middle + ends[1]]))
            else:
                first = given[0] if given[0] is not None else given[1]
                last = given[1] if given[1] is not None else given[0]
                found.append(np.array([first, last]))
        return found[0], found[1]


def _mapping(name: str, given: Any, allowed: Any) -> dict[str, Any]:
    if not isinstance(given, Mapping):
        raise InvalidValueError(f'invalid {name} {shown(given)}: expected a mapping')
    unknown = [key for key in given if key not in allowed]
    if unknown:
        raise InvalidValueError(
            f'invalid name {shown(unknown[0])} in {name}: expected one of {", ".join(allowed)}'
            f'{did_you_mean(unknown[0], allowed)}'
        )
    return dict(given)


def _checked(name: str, given: Any, quantities: Mapping[str, Quantity]) -> dict[str, float]:
    values = _mapping(name, given, quantities)
    return {
        k: each.check(f'{name} {k}', values[k]) for k, each in quantities.items() if k in values
    }


def _quaternion(given: Any) -> tuple[float, ...]:
    try:
        xyzw = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        xyzw = np.zeros(0)
    if xyzw.shape != (4,) or not abs(math.hypot(*xyzw) - 1) <= LENGTH_TOLERANCE:
        raise InvalidValueError(
            f'invalid orientation {shown(given)}: expected a unit quaternion x, y, z, w'
        )
    return tuple(canonical(xyzw).tolist())
