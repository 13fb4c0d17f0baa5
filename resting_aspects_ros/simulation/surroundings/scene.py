"""What surroundings are for a simulation: bodies, gravity, release and bounds.

The axes of the *scene frame* are those of the bodies: its x axis is the direction in which a
groove or a chute is the same everywhere. In it, gravity is tilted. Bullet's friction is exact
along the axes of a plane, which depend on the plane's normal; in the scene frame, they are the
directions in which parts mostly slide. The published frame is the tray frame, with z up.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array, rotate

# The direction of gravity in the tray frame.
_DOWN = np.array([[0.0, 0.0, -1.0]])


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
        Corners of convex prisms that represent its wide flat sides; see flat_sides.py.
    remaining : (l, 3, 3) float or None
        Corners of the triangles that represent the other sides; None: all triangles.
    sides : int
        Number of flat sides that the prisms represent.
    distance : float
        Maximum distance between the other sides and ``remaining``, m.
    """

    vertices: Array
    triangles: npt.NDArray[np.int64]
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
    """

    bodies: tuple[SceneBody, ...]
    tray_from_scene: Array
    free: int
    region: tuple[Array, Array]
    ground: float = 0.0
    lost: tuple[HalfSpace, ...] = ()
    orientation: Array | None = None

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
    def finite(self) -> bool:
        """Whether all bodies are meshes that do not move, so that each part can have its own."""
        return not self.driven and all(isinstance(body, MeshBody) for body in self.bodies)

    @property
    def down(self) -> Array:
        """(3,) direction of gravity, scene frame."""
        return np.asarray(self.in_scene(_DOWN)[0])

    def in_scene(self, vectors: Array) -> Array:
        """Return vectors or points (n, 3) of the tray frame in the scene frame."""
        return rotate(self.tray_from_scene * [-1, -1, -1, 1], vectors)

    def in_tray(self, vectors: Array) -> Array:
        """Return vectors or points (n, 3) of the scene frame in the tray frame."""
        return rotate(self.tray_from_scene, vectors)

    @property
    def frame_velocity(self) -> Array:
        """(3,) velocity of the frame in which the scene is simulated, m/s, scene frame.

        That of the first body, if the scene is the same everywhere in that direction. In the
        engine, friction on bodies at rest is more accurate, and takes less time.
        """
        velocity = self.bodies[0].velocity
        return velocity if self._same_along(velocity) else np.zeros(3)

    @property
    def driven(self) -> bool:
        """Whether a surface moves, which can add energy."""
        return any(body.contact.speed for body in self.bodies)

    def velocities(self) -> Array:
        """Return zero and the velocities (k, 3) with which parts can be carried for ever, m/s.

        A belt that runs into a wall, or ends, carries no part for ever. Scene frame.
        """
        moving = {tuple(body.velocity.tolist()) for body in self.bodies if body.contact.speed}
        endless = sorted(v for v in moving if self._same_along(np.array(v)))
        return np.array([(0.0, 0.0, 0.0), *endless])

    def _same_along(self, direction: Array) -> bool:
        """Return whether the scene is the same everywhere along a direction (3,)."""
        return not direction[self.free :].any()
