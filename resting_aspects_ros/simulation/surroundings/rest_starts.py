"""Parts at rest in surroundings, from which actions start: poses that drops ended in."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import Array, Random, rotate
from resting_aspects_ros.simulation.edge import Edge
from resting_aspects_ros.simulation.motion import Motion
from resting_aspects_ros.simulation.starts import Body, Impulse, Indices, States
from resting_aspects_ros.simulation.surroundings.scene import Scene


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
