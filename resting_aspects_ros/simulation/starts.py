"""Where parts start that are not released: from given states, or at rest before an action."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.hull import convex_hull
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import convex_pieces
from resting_aspects_ros.rotations import (
    Random,
    angle_between,
    canonical,
    orientation_with_down,
    product,
    rotate,
)
from resting_aspects_ros.simulation.conditions import Described, DropConditions, Noise
from resting_aspects_ros.simulation.scene import Scene, level_plane
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.actions import Step, Vibration


# -- States ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class States:
    """States of n parts: at the start in SI units and tray axes, in an engine in R and T.

    position, velocity : (n, 3)
        Of the centre of mass. A part that starts below a level plane is lifted onto it.
    orientation : (n, 4)
        Unit quaternions xyzw, from part, or in an engine from body.
    spin : (n, 3)
        Angular velocity.
    """

    position: Array
    orientation: Array
    velocity: Array
    spin: Array

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array]:
        """The four arrays, in the order of the fields."""
        return self.position, self.orientation, self.velocity, self.spin

    @property
    def finite(self) -> Flags:
        """Which parts (n,) have finite states."""
        return np.asarray(np.isfinite(np.hstack(self.arrays)).all(axis=1))

    def select(self, which: npt.NDArray[Any] | slice) -> 'States':
        """Return the states of some of the parts."""
        return States(*(each[which] for each in self.arrays))


# -- Given states ---------------------------------------------------------------------------------


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

    Raises InvalidValueError if a shape is wrong, a value is not finite, a quaternion is zero, or
    there is no state.
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
        # Scaled by a power of two, which is exact, so that no square overflows or is rounded to 0.
        exponent = np.frexp(np.abs(self.orientation).max(axis=1, keepdims=True))[1]
        object.__setattr__(self, 'orientation', canonical(np.ldexp(self.orientation, -exponent)))

    def __len__(self) -> int:
        return len(self.orientation)


class GivenStarts:
    """Given states with noise, of which every replicate has its own; see RestStarts."""

    motion: 'Vibration | None' = None
    edge: 'Step | None' = None

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
        """Return the states of some drops with independent errors; see RestStarts."""
        states, noise = self._states.select(index % self.rows), self._noise
        shape = states.position.shape
        turn = random.standard_normal(shape) * noise.orientation
        velocity = states.velocity + random.standard_normal(shape) * noise.velocity
        spin = states.spin + random.standard_normal(shape) * noise.spin
        angle = np.linalg.norm(turn, axis=1, keepdims=True)
        # sinc(x) is sin(pi x) / (pi x), which has no division by zero.
        vector = turn / 2 * np.sinc(angle / 2 / np.pi)
        orientation = product(np.hstack([vector, np.cos(angle / 2)]), states.orientation)
        return States(states.position, orientation, velocity, spin)


# -- Actions on parts at rest ---------------------------------------------------------------------


class Action(Described):
    """What a feeder does to parts at rest.

    A kind of action is a frozen dataclass whose fields are declared by `quantity`. All randomness
    comes from the generator that ``applied`` receives.
    """

    # Whether it can leave a part untouched, of which the user is warned.
    can_miss: ClassVar[bool] = False

    @property
    def has_effect(self) -> bool:
        """Whether the action can move a part at all."""
        return True

    @property
    def motion(self) -> 'Vibration | None':
        """Motion of the surface after the start; None: it stays at rest."""
        return None

    @property
    def edge(self) -> 'Step | None':
        """The step from which parts fall, which only Bullet simulates; None: there is none."""
        return None

    def check(self, name: str, scene: Scene) -> None:
        """Raise InvalidValueError if the action of this name is not possible in surroundings."""

    def max_speed(self, at: 'RestStarts') -> float:
        """Return the speed that the fastest point of the part can have after it, m/s."""
        raise NotImplementedError

    def applied(self, states: States, row: Indices, at: 'RestStarts', random: Random) -> States:
        """Return the states after the action; ``row`` (n,) are the rows of the starts.

        Before it, the part is at rest on a surface, which can carry it, or on a level plane, where
        the horizontal place is arbitrary.
        """
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Body:
    """What an impulse acts on: a part, in SI units and part axes.

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
        Inverse of the inertia about the centre of mass.
    """

    mass: float
    corners: Array
    normals: Array
    offsets: Array
    radius: float
    moments: Array
    axes: Array
    compliance: Array


# Centres of mass (m, 3) in the tray frame, m, unit quaternions (m, 4), tray from part, and their
# probabilities (m,).
Row = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class RestStarts:
    """Parts at rest to which an action is applied.

    poses : tuple of Row
        For each row the poses in which a part can rest. On a level plane, a part has a uniform
        yaw in addition.
    ids : tuple of int
        The aspect of each row, if each row is one.
    action : Action
    body : Body
    scene : Scene
        Where the parts rest; at an edge, the upper floor.
    gravity : float
        m/s2.
    pieces : tuple of (k, 3) float
        At an edge, corners of convex pieces of the part, relative to its centre of mass, in part
        axes, m.
    """

    poses: tuple[Row, ...]
    ids: tuple[int, ...]
    action: Action
    body: Body
    scene: Scene
    gravity: float
    pieces: tuple[Array, ...]

    @property
    def rows(self) -> int:
        """Number of different starts."""
        return len(self.poses)

    @property
    def motion(self) -> 'Vibration | None':
        """Motion of the surface, on which the positions then are; None: it stays at rest."""
        return self.action.motion

    @property
    def edge(self) -> 'Step | None':
        """Edge that the parts pass before they are on the surface; None: there is none."""
        return self.action.edge

    @property
    def carried(self) -> Array:
        """(3,) velocity of the parts before the action, with the first body, tray axes, m/s."""
        scene = self.scene
        carried = scene.bodies[0].velocity[None] if scene.free else np.zeros((1, 3))
        return np.asarray(scene.in_tray(carried)[0])

    @property
    def max_speed(self) -> float:
        """Speed at which the fastest point of a part can hit the surface first, m/s."""
        return self.action.max_speed(self) + float(np.linalg.norm(self.carried))

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of the drops of a chunk, whose indices (n,) are consecutive.

        They follow from the indices and the random numbers.
        """
        row, n = index % self.rows, len(index)
        share = random.random(n)
        position, orientation = np.empty((n, 3)), np.empty((n, 4))
        for r in np.unique(row).tolist():
            here = row == r
            # The last interval is open, so that rounding in the sum leaves no gap.
            positions, orientations, weights = self.poses[r]
            chosen = np.searchsorted(np.cumsum(weights)[:-1], share[here], side='right')
            position[here] = positions[chosen]
            orientation[here] = orientations[chosen]
        if self.scene.level:
            half_yaw, zero = random.random(n) * np.pi, np.zeros(n)
            yaw = np.stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)], axis=-1)
            orientation = product(yaw, orientation)
        states = States(position, orientation, np.tile(self.carried, (n, 1)), np.zeros((n, 3)))
        return self.action.applied(states, row, self, random)


# Where and how the parts of a run start that are not released.
Starts = GivenStarts | RestStarts


def starts_of(
    part: Part,
    aspects: AspectSet,
    action: Action,
    scene: Scene,
    conditions: DropConditions,
    rests: RestingPoses | None = None,
    ids: Sequence[int] = (),
) -> RestStarts:
    """Return a part at rest in aspects, a row for each, to which an action is applied.

    In surroundings, a part rests in the poses in which drops ended; an aspect that does not occur
    in them has no row.

    Parameters
    ----------
    rests : RestingPoses, optional
        Drops in the surroundings; a level plane needs none.
    ids : sequence of int, optional
        Ids of the aspects; by default all.

    Raises InvalidValueError if no drop ended in an aspect.
    """
    wanted = [a for a in aspects if not ids or a.id in ids]
    if scene.level:
        return rest_starts(part, wanted, action, conditions)
    if rests is None:
        raise InvalidValueError('invalid surroundings: expected resting poses in them')
    centre, orientation, found = _at_rest(part, aspects, scene, rests)
    if not found.any():
        raise InvalidValueError(
            f'invalid surroundings: no part came to rest in an aspect in {len(rests)} drops, so '
            'that no action can start; expected surroundings in which an aspect occurs, or more '
            'drops'
        )
    occurring = [a.id for a in wanted if (found == a.id).any()]
    rows = [_row(centre[found == k], orientation[found == k]) for k in occurring]
    return _starts(part, action, scene, conditions, rows, occurring)


def pose_starts(
    part: Part,
    aspects: AspectSet,
    action: Action,
    scene: Scene,
    conditions: DropConditions,
    rests: RestingPoses,
) -> RestStarts:
    """Return the parts at rest in an aspect, each with a row of its own, in the order of drops."""
    centre, orientation, ids = _at_rest(part, aspects, scene, rests)
    rows = [_row(centre[k : k + 1], orientation[k : k + 1]) for k in np.flatnonzero(ids)]
    return _starts(part, action, scene, conditions, rows)


def rest_starts(
    part: Part, aspects: Sequence[Aspect], action: Action, conditions: DropConditions
) -> RestStarts:
    """Return a part at rest on a level plane in these aspects, a row for each; see starts_of."""
    known = {aspect.id: _rests(aspect) for aspect in {each.id: each for each in aspects}.values()}
    ids = [aspect.id for aspect in aspects]
    return _starts(part, action, level_plane(conditions), conditions, [known[k] for k in ids], ids)


def _starts(
    part: Part,
    action: Action,
    scene: Scene,
    conditions: DropConditions,
    rows: Sequence[Row],
    ids: Sequence[int] = (),
) -> RestStarts:
    pieces = () if action.edge is None else convex_pieces(part).corners
    return RestStarts(
        poses=tuple(rows),
        ids=tuple(ids),
        action=action,
        body=body_of(part),
        scene=scene,
        gravity=conditions.gravity,
        pieces=tuple(corners - part.centre_of_mass for corners in pieces),
    )


def _row(position: Array, orientation: Array) -> Row:
    """Return equally probable poses as a row."""
    return position, orientation, np.full(len(position), 1 / len(position))


def body_of(part: Part) -> Body:
    """Return what impulses need to know of a part."""
    corners = part.hull_vertices - part.centre_of_mass
    triangles, normals = convex_hull(corners, part.name)[1:]
    moments, axes = np.linalg.eigh(part.inertia)
    return Body(
        mass=part.mass,
        corners=corners,
        normals=normals,
        offsets=(corners[triangles[:, 0]] * normals).sum(axis=1),
        radius=part.hull_radius,
        # Once for all workers, because the bits depend on the machine.
        moments=moments,
        axes=axes,
        compliance=np.asarray(np.linalg.inv(part.inertia)),
    )


def _rests(aspect: Aspect) -> Row:
    """Return how a part rests in an aspect on a level plane.

    On a curved side, a direction has the weight of the links of the mesh that lead to it, so that
    all directions of the sweep are about equally probable for an irregular mesh, too.
    """
    down = aspect.directions[: aspect.level]
    weights = np.ones(len(down))
    links = aspect.links[(aspect.links < aspect.level).all(axis=1)]
    if len(links):
        one, other = links.T
        angle = angle_between(down[one], down[other])
        weights = np.zeros(len(down))
        for end in (one, other):
            np.add.at(weights, end, angle)
    orientation = np.array([orientation_with_down(d) for d in down])
    return np.zeros((len(down), 3)), orientation, weights / weights.sum()


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
