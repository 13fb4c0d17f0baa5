"""The kinds of surroundings: which bodies each has, in the scene frame; see scene.py.

The metadata of the fields is the only declaration of units, bounds and descriptions.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.quantity import check_quantities, quantity
from resting_aspects_ros.simulation.surroundings.scene import (
    Block,
    HalfSpace,
    PairValues,
    SceneBody,
)

# Maximum inclination, rad: 85 degrees.
MAX_TILT = math.radians(85)
X, Y, Z = np.eye(3)
# Depth of blocks below the surface on which parts rest, m.
DEPTH = 1.0
# Length of a track along x in both directions, m, as it is drawn; parts meet no end of it.
LENGTH = 10.0

Contacts = Mapping[str, PairValues]


class Kind(Protocol):
    """A kind of surroundings with its dimensions."""

    kind: ClassVar[str]
    body_names: ClassVar[tuple[str, ...]]
    free: ClassVar[int]
    # Lowest and highest place of release across x, in hull radii from the origin of the tray.
    across: ClassVar[tuple[float, float]]

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll about x, and then pitch about y, of the scene in the tray frame, rad."""

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """Return the bodies; ``contacts`` by their names."""

    def lost(self, radius: float) -> tuple[HalfSpace, ...]:
        """Return where a part of a hull radius, m, has left the surroundings."""


def _angle(label: str, text: str, *, low: float = -MAX_TILT, **more: Any) -> Any:
    return quantity(label, 'rad', text, low=low, high=MAX_TILT, **more)


_ROLL_TEXT = 'rotation about the direction along it, towards the wall'
_PITCH_TEXT = 'inclination along it; positive: downhill in the direction x'


class _Unbounded:
    """Surroundings that a part cannot leave; level unless they have a roll or a pitch."""

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def tilt(self) -> tuple[float, float]:
        """See Kind."""
        return getattr(self, 'roll', 0.0), getattr(self, 'pitch', 0.0)

    def lost(self, radius: float) -> tuple[HalfSpace, ...]:
        """See Kind."""
        del radius
        return ()


@dataclass(frozen=True)
class Plane(_Unbounded):
    """An infinite level plane."""

    kind: ClassVar[str] = 'plane'
    body_names: ClassVar[tuple[str, ...]] = ('floor',)
    free: ClassVar[int] = 2
    across: ClassVar[tuple[float, float]] = (0.0, 0.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return (_floor('floor', contacts),)


@dataclass(frozen=True)
class Slope(_Unbounded):
    """An infinite inclined plane; x is downhill."""

    kind: ClassVar[str] = 'slope'
    body_names: ClassVar[tuple[str, ...]] = ('floor',)
    free: ClassVar[int] = 2
    across: ClassVar[tuple[float, float]] = (0.0, 0.0)

    angle: float = _angle('angle', 'inclination', low=0.0)

    @property
    def tilt(self) -> tuple[float, float]:
        """See Kind."""
        return 0.0, self.angle

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return (_floor('floor', contacts),)


@dataclass(frozen=True)
class Wall(_Unbounded):
    """A level plane with a vertical wall along x, on the side of negative y."""

    kind: ClassVar[str] = 'wall'
    body_names: ClassVar[tuple[str, ...]] = ('floor', 'wall')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (1.0, 3.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return _floor('floor', contacts), HalfSpace('wall', contacts['wall'], X, Y)


@dataclass(frozen=True)
class VGroove(_Unbounded):
    """Two planes that meet along x; without roll, both are equally steep."""

    kind: ClassVar[str] = 'v_groove'
    body_names: ClassVar[tuple[str, ...]] = ('right', 'left')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (-0.5, 0.5)

    opening: float = quantity(
        'opening', 'rad', 'angle between the planes', low=math.radians(5), high=math.radians(179)
    )
    roll: float = _angle('roll', 'rotation about the direction along the groove', default=0.0)
    pitch: float = _angle('pitch', _PITCH_TEXT, default=0.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind. The plane on the right is that at negative y, seen in the direction x."""
        c, s = math.cos(self.opening / 2), math.sin(self.opening / 2)
        right, left = np.array([0.0, c, s]), np.array([0.0, -c, s])
        return (
            HalfSpace('right', contacts['right'], X, right),
            HalfSpace('left', contacts['left'], X, left),
        )


@dataclass(frozen=True)
class Chute(_Unbounded):
    """A belt and a wall at a right angle, an L, rolled towards the wall and pitched along x."""

    kind: ClassVar[str] = 'chute'
    body_names: ClassVar[tuple[str, ...]] = ('belt', 'wall')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (-0.5, 0.5)

    roll: float = _angle('roll', _ROLL_TEXT, default=math.radians(45))
    pitch: float = _angle('pitch', _PITCH_TEXT, default=0.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return _floor('belt', contacts), HalfSpace('wall', contacts['wall'], X, Y)


@dataclass(frozen=True)
class Corner(_Unbounded):
    """A plane, a wall along x and a wall across x, tilted towards both walls."""

    kind: ClassVar[str] = 'corner'
    body_names: ClassVar[tuple[str, ...]] = ('floor', 'wall', 'end_wall')
    free: ClassVar[int] = 0
    across: ClassVar[tuple[float, float]] = (0.0, 1.0)

    roll: float = _angle('roll', _ROLL_TEXT, default=math.radians(20))
    pitch: float = _angle('pitch', 'inclination towards the end wall', default=math.radians(20))

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        return (
            _floor('floor', contacts),
            HalfSpace('wall', contacts['wall'], X, Y),
            HalfSpace('end_wall', contacts['end_wall'], Y, -X),
        )


@dataclass(frozen=True)
class Tray(_Unbounded):
    """A level plane with four walls."""

    kind: ClassVar[str] = 'tray'
    body_names: ClassVar[tuple[str, ...]] = ('floor', 'wall')
    free: ClassVar[int] = 0
    across: ClassVar[tuple[float, float]] = (0.0, 0.0)

    length: float = quantity('length', 'm', 'inner length, along x', high=10.0, above=True)
    width: float = quantity('width', 'm', 'inner width, along y', high=10.0, above=True)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        walls = [
            HalfSpace('wall', contacts['wall'], along, normal, -size / 2)
            for along, axis, size in ((Y, X, self.length), (X, Y, self.width))
            for normal in (axis, -axis)
        ]
        return _floor('floor', contacts), *walls


@dataclass(frozen=True)
class BowlTrack(_Unbounded):
    """A track that is rolled towards a wall, with an edge over which parts fall off."""

    kind: ClassVar[str] = 'bowl_track'
    body_names: ClassVar[tuple[str, ...]] = ('track', 'wall')
    free: ClassVar[int] = 1
    across: ClassVar[tuple[float, float]] = (0.0, 1.0)

    width: float = quantity('width', 'm', 'width of the track', high=10.0, above=True)
    roll: float = _angle('roll', _ROLL_TEXT, low=0.0, default=math.radians(5))
    pitch: float = _angle('pitch', _PITCH_TEXT, default=0.0)

    def bodies(self, contacts: Contacts) -> tuple[SceneBody, ...]:
        """See Kind."""
        low, high = np.array([-LENGTH, -DEPTH, -DEPTH]), np.array([LENGTH, self.width, 0.0])
        return (
            Block('track', contacts['track'], X, low, high, Z),
            HalfSpace('wall', contacts['wall'], X, Y),
        )

    def lost(self, radius: float) -> tuple[HalfSpace, ...]:
        """See Kind: a part whose centre of mass is below the track has fallen off."""
        return (HalfSpace('below', NO_CONTACT, X, Z, -radius),)


NO_CONTACT = PairValues(0.0, 0.0, 0.0)


def _floor(name: str, contacts: Contacts) -> HalfSpace:
    return HalfSpace(name, contacts[name], X, Z)


def tray_from_scene(roll: float, pitch: float) -> Array:
    """Return the quaternion (4,) of a roll about x, followed by a pitch about y, rad."""
    a, b = math.sin(roll / 2), math.cos(roll / 2)
    c, d = math.sin(pitch / 2), math.cos(pitch / 2)
    return np.array([a * d, b * c, -a * c, b * d])
