"""Where and how parts start that are not released: from given states, or at rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import Random, canonical, product, rotate
from resting_aspects_ros.simulation.conditions import check_quantities, quantity
from resting_aspects_ros.simulation.scene import Scene
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus


@dataclass(frozen=True)
class Noise:
    """Standard deviations of normal errors of given states, for each component in tray axes."""

    orientation: float = quantity(
        'orientation noise', 'rad', 'noise of the orientation', high=10.0, default=0.0
    )
    velocity: float = quantity(
        'velocity noise', 'm/s', 'noise of the velocity', high=100.0, default=0.0
    )
    spin: float = quantity('spin noise', 'rad/s', 'noise of the spin', high=1e4, default=0.0)

    def __post_init__(self) -> None:
        check_quantities(self)


# -- What happens after the start -----------------------------------------------------------------


class Motion(Protocol):
    """A motion of the surface that begins and ends at rest, with the surface in the plane z = 0.

    Lengths are in m and times in s. Before it begins and after its end, the frame of the surface
    is the tray frame.
    """

    @property
    def duration(self) -> float:
        """Time from the beginning to the end, s."""

    @property
    def time_step(self) -> float:
        """Maximum time step that resolves the motion, s."""

    def pose(self, time: Array) -> tuple[Array, Array]:
        """Return positions (n, 3) and quaternions xyzw (n, 4), tray from surface, at times."""

    def velocity(self, time: Array) -> tuple[Array, Array]:
        """Return the derivatives: velocity (n, 3), m/s, and angular velocity (n, 3), rad/s.

        The velocity is that of the origin of the surface; both are in tray axes.
        """

    def left(self, position: Array) -> npt.NDArray[np.bool_]:
        """Return which parts (n,) have left the surface.

        ``position`` (n, 3) are their centres of mass in the frame of the surface, m.
        """


@dataclass(frozen=True, eq=False)
class Edge:
    """The end of an upper belt, as a part meets it. SI units.

    The upper belt moves in the direction x and turns down at x = 0, over a roller along y, whose
    surface moves with it. Below the roller is a vertical wall at x = 0. Velocities are relative to
    this wall; z = 0 is the lower belt.

    height : float
        Of the upper belt above the lower one.
    radius : float
        Of the roller.
    belt_speed, lower_speed : float
        Of the upper and of the lower belt.
    friction_factor, restitution_factor : float
        Friction and restitution of the upper belt, its roller and the wall, as multiples of the
        conditions, which are those of the lower belt.
    pieces : tuple of (k, 3) float
        Corners of convex pieces of the part, relative to its centre of mass, in part axes.
    """

    height: float
    radius: float
    belt_speed: float
    lower_speed: float
    friction_factor: float
    restitution_factor: float
    pieces: tuple[Array, ...]


# -- Starts ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class States:
    """States of n parts, in SI units and tray axes.

    position, velocity : (n, 3)
        Of the centre of mass, m and m/s. A part that would be below the surface is lifted onto it.
    orientation : (n, 4)
        Unit quaternions xyzw, tray from part.
    spin : (n, 3)
        Angular velocity, rad/s.
    """

    position: Array
    orientation: Array
    velocity: Array
    spin: Array


class Starts(Protocol):
    """Where and how the parts of a run start; determined by the index and the random numbers."""

    @property
    def rows(self) -> int:
        """Number of different starts."""

    @property
    def max_speed(self) -> float:
        """Speed at which the fastest point of a part can hit the surface first, m/s."""

    @property
    def motion(self) -> Motion | None:
        """Motion of the surface, on which the positions then are; None: it stays at rest."""

    @property
    def edge(self) -> Edge | None:
        """Edge that the parts pass before they are on the surface; None: there is none."""

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of the drops of a chunk, whose indices (n,) are consecutive."""


@dataclass(frozen=True, eq=False)
class GivenStates:
    """Recorded or computed states from which parts start, n of them.

    Parameters
    ----------
    position : (n, 3) array_like
        Centre of mass in the tray frame, m.
    orientation : (n, 4) array_like
        Quaternions xyzw, tray from part, of any length but zero.
    velocity : (n, 3) array_like
        Of the centre of mass, tray axes, m/s; zero by default.
    spin : (n, 3) array_like
        Angular velocity in the axes of the part, as an inertial sensor measures it, rad/s; zero
        by default.

    Raises
    ------
    InvalidValueError
        If a shape is wrong, a value is not finite, a quaternion is zero, or there is no state.
    """

    position: Array
    orientation: Array
    velocity: Any = None
    spin: Any = None

    def __post_init__(self) -> None:
        n = len(np.asarray(self.orientation))
        if n == 0:
            raise InvalidValueError('invalid initial states: expected at least one')
        for name, columns in (('position', 3), ('orientation', 4), ('velocity', 3), ('spin', 3)):
            given = getattr(self, name)
            array = np.array(np.zeros((n, 3)) if given is None else given, dtype=np.float64)
            if array.shape != (n, columns):
                raise InvalidValueError(
                    f'invalid shape {array.shape} of {name}: expected {(n, columns)}'
                )
            wrong = np.flatnonzero(~np.isfinite(array).all(axis=1))
            if len(wrong):
                raise InvalidValueError(
                    f'invalid {name} {array[wrong[0]].tolist()} of initial state '
                    f'{int(wrong[0])}: expected finite numbers'
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        zero = np.flatnonzero(~self.orientation.any(axis=1))
        if len(zero):
            raise InvalidValueError(
                f'invalid orientation [0, 0, 0, 0] of initial state {int(zero[0])}: expected a '
                'quaternion'
            )
        object.__setattr__(self, 'orientation', canonical(self.orientation))

    def __len__(self) -> int:
        return len(self.orientation)


class GivenStarts:
    """Given states with noise. Every replicate of a state has its own noise."""

    motion: Motion | None = None
    edge: Edge | None = None

    def __init__(self, given: GivenStates, noise: Noise, gravity: float, radius: float) -> None:
        self._states = States(
            given.position,
            given.orientation,
            given.velocity,
            rotate(given.orientation, given.spin),
        )
        self._noise = noise
        self.rows = len(given)
        velocity = np.linalg.norm(given.velocity, axis=1) + 3 * noise.velocity
        spin = np.linalg.norm(given.spin, axis=1) + 3 * noise.spin
        fall = 2 * gravity * np.maximum(given.position[:, 2], 0)
        self.max_speed = float((np.sqrt(velocity**2 + fall) + spin * radius).max())

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of some drops; see Starts."""
        row, s = index % self.rows, self._states
        chosen = States(s.position[row], s.orientation[row], s.velocity[row], s.spin[row])
        return _with_noise(chosen, self._noise, random)


def _with_noise(states: States, noise: Noise, random: Random) -> States:
    """Return the states with independent errors."""
    shape = states.position.shape
    turn = random.standard_normal(shape) * noise.orientation
    velocity = states.velocity + random.standard_normal(shape) * noise.velocity
    spin = states.spin + random.standard_normal(shape) * noise.spin
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    # sinc(x) is sin(pi x) / (pi x), which has no division by zero.
    vector = turn / 2 * np.sinc(angle / 2 / np.pi)
    orientation = product(np.hstack([vector, np.cos(angle / 2)]), states.orientation)
    return States(states.position, orientation, velocity, spin)


@dataclass(frozen=True, eq=False)
class Body:
    """What an impulse acts on: a part, in SI units and part axes.

    inertia : (3, 3)
        About the centre of mass.
    corners : (k, 3)
        Of the convex hull, relative to the centre of mass.
    normals, offsets : (f, 3) and (f,)
        Planes of the convex hull: points inside have ``normals @ x <= offsets``, relative to the
        centre of mass.
    radius : float
        Hull radius R, m.
    moments, axes : (3,) and (3, 3)
        Principal moments of inertia, and the principal axes as columns.
    compliance : (3, 3)
        Inverse of the inertia.
    """

    mass: float
    inertia: Array
    corners: Array
    normals: Array
    offsets: Array
    radius: float
    moments: Array
    axes: Array
    compliance: Array


class Impulse(Protocol):
    """A disturbance that changes velocity and spin at once, or where the surface moves, places."""

    def max_speed(self, body: Body) -> float:
        """Return the speed that the fastest point of the part can have after it, m/s."""

    def applied(self, states: States, row: Indices, body: Body, random: Random, /) -> States:
        """Return the states after the disturbance; ``row`` (n,) are the rows of the starts."""


@dataclass(frozen=True, eq=False)
class RestStarts:
    """Parts at rest in aspects, with a uniform yaw, to which an impulse is applied.

    orientations : tuple of (m, 4) float
        For each row the orientations, tray from part, in which a part can rest: one, or for a
        rolling part one for each direction of its sweep.
    weights : tuple of (m,) float
        Their probabilities.
    impulse : Impulse
    body : Body
    motion : Motion or None
    edge : Edge or None
    """

    orientations: tuple[Array, ...]
    weights: tuple[Array, ...]
    impulse: Impulse
    body: Body
    motion: Motion | None = None
    edge: Edge | None = None

    @property
    def rows(self) -> int:
        """Number of different starts."""
        return len(self.orientations)

    @property
    def max_speed(self) -> float:
        """See Starts."""
        return self.impulse.max_speed(self.body)

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of some drops; see Starts."""
        row = index % self.rows
        n = len(index)
        share, half_yaw = random.random(n), random.random(n) * np.pi
        orientation = np.empty((n, 4))
        for r in np.unique(row).tolist():
            here = row == r
            # The last interval is open, so that rounding in the sum leaves no gap.
            chosen = np.searchsorted(np.cumsum(self.weights[r])[:-1], share[here], side='right')
            orientation[here] = self.orientations[r][chosen]
        zero = np.zeros(n)
        yaw = np.stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)], axis=-1)
        none = np.zeros((n, 3))
        states = States(none, product(yaw, orientation), none, none)
        return self.impulse.applied(states, row, self.body, random)


# -- Parts at rest in surroundings ----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FoundStarts:
    """Parts at rest in each aspect, in poses that drops ended in, to which an impulse is applied.

    positions, orientations : tuple of (m, 3) and (m, 4) float
        For each row the poses of the centre of mass, tray frame, m and unit quaternions.
    carried : (3,) float
        Velocity of the parts, with the first body, tray axes, m/s.
    impulse : Impulse or None
        None: only the surroundings move, or the parts move over an edge.
    ids : tuple of int
        The aspect of each row, if each row is one.
    fall_speed : float
        Speed that a part can have after the edge, m/s.
    """

    positions: tuple[Array, ...]
    orientations: tuple[Array, ...]
    carried: Array
    impulse: Impulse | None
    body: Body
    ids: tuple[int, ...] = ()
    motion: Motion | None = None
    edge: Edge | None = None
    fall_speed: float = 0.0

    @property
    def rows(self) -> int:
        """Number of different starts."""
        return len(self.positions)

    @property
    def max_speed(self) -> float:
        """See Starts."""
        speed = 0.0 if self.impulse is None else self.impulse.max_speed(self.body)
        return max(self.fall_speed, speed + float(np.linalg.norm(self.carried)))

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of some drops; see Starts."""
        row, n = index % self.rows, len(index)
        share = random.random(n)
        position, orientation = np.empty((n, 3)), np.empty((n, 4))
        for r in np.unique(row).tolist():
            here = row == r
            chosen = (share[here] * len(self.positions[r])).astype(np.int64)
            position[here] = self.positions[r][chosen]
            orientation[here] = self.orientations[r][chosen]
        none = np.zeros((n, 3))
        states = States(position, orientation, none, none)
        if self.impulse is not None:
            states = self.impulse.applied(states, row, self.body, random)
        return States(position, orientation, states.velocity + self.carried, states.spin)


def found_starts(
    part: Part,
    aspects: AspectSet,
    scene: Scene,
    poses: RestingPoses,
    body: Body,
    impulse: Impulse | None,
    motion: Motion | None,
) -> FoundStarts:
    """Return parts at rest in each aspect that occurs in drops in the surroundings.

    Raises InvalidValueError if no drop ended in an aspect.
    """
    centre, orientation, ids = _at_rest(part, aspects, scene, poses)
    occurring = tuple(a.id for a in aspects.aspects if (ids == a.id).any())
    if not occurring:
        raise InvalidValueError(
            f'invalid surroundings: no part came to rest in an aspect in {len(poses)} drops, so '
            'that no action can start; expected surroundings in which an aspect occurs, or more '
            'drops'
        )
    found = [ids == each for each in occurring]
    rows = _each(centre, found), _each(orientation, found)
    return FoundStarts(*rows, _carried(scene), impulse, body, occurring, motion)


def pose_starts(
    part: Part,
    aspects: AspectSet,
    scene: Scene,
    poses: RestingPoses,
    body: Body,
    impulse: Impulse | None,
    motion: Motion | None,
) -> FoundStarts:
    """Return the parts at rest in an aspect, each with a row of its own, in the order of drops."""
    centre, orientation, ids = _at_rest(part, aspects, scene, poses)
    which = ids > 0
    rows = tuple(centre[which][:, None]), tuple(orientation[which][:, None])
    return FoundStarts(*rows, _carried(scene), impulse, body, motion=motion)


def _at_rest(
    part: Part, aspects: AspectSet, scene: Scene, poses: RestingPoses
) -> tuple[Array, Array, Indices]:
    """Return centre of mass, orientation and aspect of the parts at rest; 0: in no aspect.

    A part that only the mesh of a curved side stopped is in none.
    """
    settled = poses.status == RestStatus.SETTLED
    orientation = poses.orientation[settled]
    centre = poses.position[settled] + rotate(orientation, part.centre_of_mass)
    # Where the surroundings are the same everywhere, the place does not matter.
    free = np.arange(3) < scene.free
    centre = scene.in_tray(np.where(free, 0.0, scene.in_scene(centre)))
    return centre, orientation, aspects.at_rest().classify(orientation)


def _carried(scene: Scene) -> Array:
    """Return the velocity (3,) of parts that lie on the first body, tray axes, m/s."""
    carried = scene.bodies[0].velocity[None] if scene.free else np.zeros((1, 3))
    return np.asarray(scene.in_tray(carried)[0])


def _each(rows: Array, found: Sequence[Array]) -> tuple[Array, ...]:
    return tuple(rows[which] for which in found)
