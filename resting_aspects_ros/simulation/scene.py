"""What surroundings are for a simulation: bodies, gravity, release and bounds.

The axes of the *scene frame* are those of the bodies: its x axis is the direction in which a
groove or a chute is the same everywhere. In it, gravity is tilted. Bullet's friction is exact
along the axes of a plane, which depend on the plane's normal; in the scene frame, they are the
directions in which parts mostly slide. The published frame is the tray frame, with z up.
"""

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import product, rotate
from resting_aspects_ros.simulation.conditions import DropConditions

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class PairValues:
    """Values of the pair of part and body, and the speed of the surface of the body, m/s."""

    friction: float
    restitution: float
    rolling_friction: float
    speed: float = 0.0


@dataclass(frozen=True, eq=False)
class SceneBody:
    """A body that does not move, though its surface may.

    name : str
        Name of the body, such as 'belt'; several can have the same.
    contact : PairValues
    along : (3,) float
        Direction in which the surface moves, unit vector, scene frame.
    """

    name: str
    contact: PairValues
    along: Array

    @property
    def velocity(self) -> Array:
        """(3,) velocity of the surface, m/s, scene frame."""
        return self.contact.speed * self.along


@dataclass(frozen=True, eq=False)
class HalfSpace(SceneBody):
    """All points x with ``normal @ x <= offset``; the unit normal (3,) points away from it, m."""

    normal: Array
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Block(SceneBody):
    """A box with faces along the axes of the scene frame, from ``low`` to ``high`` (3,), m.

    ``normal`` (3,) is that of the face on which parts rest.
    """

    low: Array
    high: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class MeshBody(SceneBody):
    """A mesh, scene frame, m.

    vertices, triangles : (n, 3) float and (m, 3) int
        The triangles point outward.
    prisms : tuple of (k, 3) float
        Corners of convex prisms that represent its wide flat sides; see mesh_simplification.py.
    remaining : (l, 3, 3) float or None
        Corners of the triangles that represent the other sides; None: all triangles.
    sides : int
        Number of flat sides that the prisms represent.
    distance : float
        Maximum distance between the other sides and ``remaining``, m.
    """

    vertices: Array
    triangles: Indices
    prisms: tuple[Array, ...] = ()
    remaining: Array | None = None
    sides: int = 0
    distance: float = 0.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Bodies, gravity, release and bounds; see the module for the scene frame.

    Attributes
    ----------
    bodies : tuple of SceneBody
        The first is the one on which the aspects of a part are counted.
    tray_from_scene : (4,) float
        Unit quaternion xyzw.
    free : int
        In how many directions the scene is the same everywhere: 2 (x and y), 1 (x) or 0.
    region : ((2,), (2,)) float
        Lowest and highest x and y of the place of release, tray frame, m.
    ground : float
        Height in the tray frame above which parts are released if there are no half-spaces, m.
    lost : tuple of HalfSpace
        A part whose centre of mass is in one of these has left the surroundings.
    orientation : (4,) float or None
        Orientation at release, tray from part; None: uniformly random.
    level : bool
        Whether this is the infinite level plane, on which energy decides the aspect of a part.
        Its axes are those of the tray.
    """

    bodies: tuple[SceneBody, ...]
    tray_from_scene: Array
    free: int
    region: tuple[Array, Array]
    ground: float = 0.0
    lost: tuple[HalfSpace, ...] = ()
    orientation: Array | None = None
    level: bool = False

    @property
    def half_spaces(self) -> tuple[HalfSpace, ...]:
        """The bodies that are half-spaces."""
        return tuple(body for body in self.bodies if isinstance(body, HalfSpace))

    @property
    def faces(self) -> tuple[HalfSpace, ...]:
        """The planes on which parts can lie: half-spaces, and the upper faces of blocks."""
        found = []
        for body in self.bodies:
            if isinstance(body, Block):
                offset = float(np.where(body.normal > 0, body.high, 0.0) @ body.normal)
                found.append(HalfSpace(body.name, body.contact, body.along, body.normal, offset))
            elif isinstance(body, HalfSpace):
                found.append(body)
        return tuple(found)

    @property
    def flat(self) -> bool:
        """Whether all bodies are half-spaces, which touch only the convex hull of a part."""
        return len(self.half_spaces) == len(self.bodies)

    @property
    def down(self) -> Array:
        """(3,) direction of gravity, scene frame."""
        return np.asarray(self.in_scene(-Z[None])[0])

    def in_scene(self, vectors: Array) -> Array:
        """Return vectors or points (n, 3) of the tray frame in the scene frame."""
        return rotate(self.tray_from_scene * [-1, -1, -1, 1], vectors)

    def in_tray(self, vectors: Array) -> Array:
        """Return vectors or points (n, 3) of the scene frame in the tray frame."""
        return rotate(self.tray_from_scene, vectors)

    @property
    def driven(self) -> bool:
        """Whether a surface moves, which can add energy."""
        return any(body.contact.speed for body in self.bodies)

    def velocities(self) -> Array:
        """Return zero and the velocities (k, 3) with which parts can be carried for ever, m/s.

        A belt that runs into a wall, or ends, carries no part for ever. Scene frame.
        """
        moving = {tuple(body.velocity.tolist()) for body in self.bodies if body.contact.speed}
        endless = sorted(v for v in moving if self.same_along(np.array(v)))
        return np.array([(0.0, 0.0, 0.0), *endless])

    def with_floor_speed(self, speed: float) -> 'Scene':
        """Return the scene with another speed of the first body, m/s, along x."""
        floor, *others = self.bodies
        contact = replace(floor.contact, speed=speed)
        return replace(self, bodies=(replace(floor, contact=contact, along=X), *others))

    def same_along(self, direction: Array) -> bool:
        """Return whether the scene is the same everywhere along a direction (3,)."""
        return not direction[self.free :].any()


def level_plane(conditions: DropConditions) -> Scene:
    """Return the infinite level plane, the simplest scene."""
    c = conditions
    contact = PairValues(c.friction, c.restitution, c.rolling_friction)
    floor = HalfSpace('floor', contact, X, Z)
    none = np.zeros(2)
    return Scene((floor,), np.array([0.0, 0.0, 0.0, 1.0]), 2, (none, none), level=True)


def make_scene(conditions: DropConditions, radius: float) -> Scene:
    """Return the surroundings of drops of a part with a hull radius, m; raises InvalidValueError.

    Without surroundings, they are the level plane.
    """
    if conditions.surroundings is None:
        return level_plane(conditions)
    return conditions.surroundings.scene(conditions, radius)


# -- Release --------------------------------------------------------------------------------------


# Cosine of the angle between the vertical and the normal of a plane below which it is a wall: a
# part that falls by a height does not meet it.
STEEP = 0.02


def in_scene_axes(scene: Scene, orientation: Array) -> Array:
    """Return orientations (n, 4), tray from body, as orientations scene from body."""
    if scene.level:
        return orientation
    inverse = scene.tray_from_scene * [-1, -1, -1, 1]
    return product(np.tile(inverse, (len(orientation), 1)), orientation)


def in_tray_axes(scene: Scene, orientation: Array) -> Array:
    """Return orientations (n, 4), scene from body, as orientations tray from body."""
    if scene.level:
        return orientation
    return product(np.tile(scene.tray_from_scene, (len(orientation), 1)), orientation)


def depth_of(orientation: Array, corners: Array, direction: Array = -Z) -> Array:
    """Return how far the corners (k, 3) of bodies in orientations (n, 4) reach, (n,).

    ``direction`` (3,) is a unit vector in the frame of the orientations; by default down.
    """
    x, y, z = rotate(orientation * [-1, -1, -1, 1], direction).T[:, :, None]
    # A matrix product would not do: its rounding depends on the number of rows, so that a drop's
    # height would depend on how many other drops are simulated.
    reach: Array = (x * corners[:, 0] + y * corners[:, 1] + z * corners[:, 2]).max(axis=1)
    return reach


def heights_at_touch(scene: Scene, base: Array, orientation: Array, corners: Array) -> Array:
    """Return the heights (n,) of the centre of mass above z = 0 at which bodies touch first.

    Parameters
    ----------
    base : (n, 3) float
        The points at z = 0 above which they are, scene frame, m.
    orientation : (n, 4) float
        Scene from body.
    corners : (k, 3) float
        Corners of the hull relative to the centre of mass, body axes, m.
    """
    # The planes that a part can meet when it falls.
    planes = [plane for plane in scene.faces if -float(plane.normal @ scene.down) > STEEP]
    if not planes:
        return scene.ground + depth_of(orientation, corners, scene.down)
    found = []
    for plane in planes:
        reach = depth_of(orientation, corners, -plane.normal)
        above = (base * plane.normal).sum(axis=1) - plane.offset
        found.append((reach - above) / -float(plane.normal @ scene.down))
    return np.asarray(np.max(found, axis=0))


def check_release(scene: Scene, radius: float) -> None:
    """Raise InvalidValueError if the place of release is so near a wall that a part can touch it.

    A wall is a half-space that a part does not reach by falling. Also refuses opposite walls
    between which the part cannot be released anywhere.
    """
    for one, other in combinations(scene.half_spaces, 2):
        gap = -one.offset - other.offset
        if float(one.normal @ other.normal) < -1 + 1e-9 and gap < 2 * radius * (1 - 1e-9):
            raise InvalidValueError(
                f'invalid distance {1000 * gap:.4g} mm between two sides of the {one.name}: '
                f'expected at least twice the hull radius of the part, {2000 * radius:.4g} mm'
            )
    (x, y) = scene.region
    places = scene.in_scene(np.array([[a, b, 0.0] for a in x for b in y]))
    for plane in scene.half_spaces:
        if float(plane.normal @ scene.down) > -STEEP:
            distance = float((places @ plane.normal).min()) - plane.offset
            if distance < radius * (1 - 1e-9):
                raise InvalidValueError(
                    f'invalid release {1000 * distance:.4g} mm from the {plane.name}: expected at '
                    f'least the hull radius of the part, {1000 * radius:.4g} mm'
                )


def ground_below(corners: Array, low: Array, high: Array) -> float:
    """Return the highest z of triangles (m, 3, 3) in a rectangle of x and y; -inf if none is.

    ``low`` and ``high`` (2,) are the corners of the rectangle.
    """
    near = (corners[:, :, :2].max(axis=1) >= low) & (corners[:, :, :2].min(axis=1) <= high)
    highest = -math.inf
    for triangle in corners[near.all(axis=1)]:
        polygon = triangle
        for axis, low_side, high_side in zip((X, Y), low, high, strict=True):
            polygon = clipped(clipped(polygon, -axis, -low_side), axis, high_side)
        highest = max([highest, *polygon[:, 2].tolist()])
    return highest


def clipped(polygon: Array, normal: Array, offset: float) -> Array:
    """Return the part of a polygon (k, d) of points x with ``normal @ x <= offset``."""
    above = (polygon @ normal - offset).tolist()
    kept: list[Array] = []
    for k, (one, other) in enumerate(zip(above, [*above[1:], *above[:1]], strict=True)):
        if one <= 0:
            kept.append(polygon[k])
        if (one <= 0) != (other <= 0):
            along = polygon[(k + 1) % len(polygon)] - polygon[k]
            kept.append(polygon[k] + one / (one - other) * along)
    return np.array(kept).reshape(-1, polygon.shape[1])
