"""How drops start and end: from a job to initial states, and from ends to resting poses."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from resting_aspects_ros.arrays import Array, Bytes, Indices
from resting_aspects_ros.rotations import (
    Random,
    canonical,
    composed,
    product,
    random_orientations,
    rotate,
    turned_down,
)
from resting_aspects_ros.simulation.conditions import BULLET, DropConditions, HeightOf
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.scene import (
    depth_of,
    heights_at_touch,
    in_scene_axes,
    in_tray_axes,
)
from resting_aspects_ros.simulation.starts import Starts, States
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus

# -- Random numbers -------------------------------------------------------------------------------


# Numbers of a drop; a block of the counter-based generator Philox has four.
NUMBERS, BLOCK = 16, 4


class DropRandom:
    """Numbers for consecutive drops, with the two methods of numpy's Generator that starts need.

    Any range of drops has the same numbers as in a longer run, because those of drop i are blocks
    of the generator Philox (Salmon, Moraes, Dror, Shaw 2011) at a counter that follows from i.

    Parameters
    ----------
    seed : int
        From 0 to 2^64 - 1.
    first, end : int
        Indices of the first drop and of the one after the last.
    """

    def __init__(self, seed: int, first: int, end: int) -> None:
        blocks = NUMBERS // BLOCK
        bits = np.random.Philox(key=seed, counter=first * blocks)
        raw = bits.random_raw((end - first) * NUMBERS).reshape(end - first, NUMBERS)
        # The middles of 2^53 intervals, so that none is 0 or 1.
        self._uniform = ((raw >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
        self._used = 0

    def random(self, shape: int | tuple[int, ...]) -> Array:
        """Return uniform numbers between 0 and 1, of shape (n,) or (n, k) for n drops."""
        sizes = (shape,) if isinstance(shape, int) else shape
        count = sizes[1] if len(sizes) > 1 else 1
        found = self._uniform[:, self._used : self._used + count]
        self._used += count
        if sizes[0] != len(found) or self._used > NUMBERS:
            raise ValueError(
                f'invalid shape {shape}: expected {len(found)} drops with numbers left'
            )
        return np.array(found.reshape(sizes))

    def standard_normal(self, shape: int | tuple[int, ...]) -> Array:
        """Return numbers from the standard normal distribution; see random."""
        return np.asarray(ndtri(self.random(shape)))


# -- Initial states -------------------------------------------------------------------------------


# Without spin, free fall only adds speed, so it is not simulated down to this clearance, R. The
# clearance exceeds Bullet's contact breaking distance (0.02).
START_CLEARANCE = 0.05
# Height above the surface, R, at which Bullet lets a hull rest: its collision margin.
REST_MARGIN = 0.001
# A drop that still moves after this time, T, is unsettled.
TIME_LIMIT = 500.0


@dataclass(frozen=True, eq=False)
class InitialState(States):
    """Initial states of n drops, in R and T, in the axes of the scene.

    elapsed : (n,) float
        Time of the free fall that is not simulated.
    """

    elapsed: Array

    @property
    def flight(self) -> Array:
        """(n,) time of flight that is simulated, T."""
        up = self.velocity[:, 2]
        return np.asarray(up + np.sqrt(up**2 + 2 * np.abs(self.position[:, 2])))


def initial_states(job: DropJob, first: int, end: int) -> InitialState:
    """Return the initial states of the drops ``first`` to ``end - 1``.

    That of a drop depends only on the job and its index.
    """
    random, n = DropRandom(job.seed, first, end), end - first
    if job.starts is not None:
        return _started(job, job.starts, np.arange(first, end), random)
    return (_released if job.scene.level else _in_scene)(job, random, n)


def _started(job: DropJob, starts: Starts, index: Indices, random: Random) -> InitialState:
    """Return the initial states of parts that start as ``starts`` determines."""
    states, scene = starts.states(index, random), job.scene
    of_body = composed(states.orientation, job.axes)
    position = scene.in_scene(states.position) / job.radius
    if scene.level:  # a part that lies on the surface begins where the engine lets it rest
        lowest = depth_of(of_body, job.hull) + (REST_MARGIN if job.engine == BULLET else 0.0)
        position[:, 2] = np.maximum(position[:, 2], lowest)
    return InitialState(
        position,
        in_scene_axes(scene, of_body),
        scene.in_scene(states.velocity) * (job.time_unit / job.radius),
        scene.in_scene(states.spin) * job.time_unit,
        np.zeros(len(index)),
    )


def _thrown(c: DropConditions, random: Random, n: int) -> tuple[Array, Array, Array]:
    """Return orientations, tray from part, velocities and spins at release, SI, tray axes."""
    of_part = random_orientations(random, n)
    deviations = np.array([c.speed_horizontal, c.speed_horizontal, c.speed_vertical])
    velocity = random.standard_normal((n, 3)) * deviations
    return of_part, velocity, random.standard_normal((n, 3)) * c.spin


def _released(job: DropJob, random: Random, n: int) -> InitialState:
    """Return the initial states of parts that are dropped in random orientations."""
    c, unit = job.conditions, job.time_unit
    of_part, velocity, spin = _thrown(c, random, n)
    velocity, spin = velocity * unit / job.radius, spin * unit
    of_body = composed(of_part, job.axes)
    depth = depth_of(of_body, job.hull)
    height = np.full(n, c.height / job.radius)
    clearance = height if c.height_of is HeightOf.LOWEST_POINT else height - depth
    elapsed = np.zeros(n)
    if c.spin == 0:
        start = np.minimum(clearance, START_CLEARANCE)
        speed = np.sqrt(velocity[:, 2] ** 2 + 2 * (clearance - start))
        speed = np.where(clearance > start, speed, -velocity[:, 2])
        elapsed = velocity[:, 2] + speed
        velocity[:, 2] = -speed
        clearance = start
    position = np.zeros((n, 3))
    position[:, :2] = velocity[:, :2] * elapsed[:, None]
    position[:, 2] = clearance + depth
    return InitialState(position, of_body, velocity, spin, elapsed)


def _in_scene(job: DropJob, random: Random, n: int) -> InitialState:
    """Return the initial states of parts that are released in surroundings, scene frame."""
    scene, c, unit = job.scene, job.conditions, job.time_unit
    of_part, velocity, spin = _thrown(c, random, n)
    place = random.random((n, 2))
    if scene.orientation is not None:
        of_part = np.tile(scene.orientation, (n, 1))
    x, y = (low + (high - low) * place[:, k] for k, (low, high) in enumerate(scene.region))
    base = scene.in_scene(np.stack([x, y, np.zeros(n)], axis=1))
    of_body = in_scene_axes(scene, product(of_part, np.tile(job.axes, (n, 1))))
    lift = heights_at_touch(scene, base, of_body, job.hull * job.radius)
    if c.height_of is HeightOf.CENTRE_OF_MASS:
        lift = np.maximum(
            lift, heights_at_touch(scene, base, of_body, np.zeros((1, 3))) + c.height
        )
    else:
        lift = lift + c.height
    position = (base - lift[:, None] * scene.down) / job.radius
    velocity, spin = scene.in_scene(velocity), scene.in_scene(spin)
    elapsed = np.zeros(n)
    fall = c.height / job.radius - START_CLEARANCE
    still = c.speed_horizontal == c.speed_vertical == c.spin == 0
    if still and fall > 0 and c.height_of is HeightOf.LOWEST_POINT:
        position += fall * scene.down
        elapsed += np.sqrt(2 * fall)
        velocity = np.tile(np.sqrt(2 * fall) * scene.down, (n, 1))
    else:
        velocity *= unit / job.radius
    return InitialState(position, of_body, velocity, spin * unit, elapsed)


def part_from_body(of_body: Array, axes: Array) -> Array:
    """Return the rotation tray from part, given tray from body and the job's axes."""
    return composed(of_body, axes * [-1, -1, -1, 1])


# -- Ends -----------------------------------------------------------------------------------------


# A part touches a half-space if its hull is closer than this, R: Bullet lets it rest at 0.001.
TOUCH = 0.005


@dataclass(eq=False)
class Ends:
    """How n drops have ended, in R and T, in the axes of the surroundings.

    position, orientation : (n, 3) and (n, 4) float
        Of the centre of mass, and xyzw, from body axes.
    status, minimum : (n,) int
        Codes of RestStatus, and the minimum of the landscape that the energy decided, or -1.
    time, growth : (n,) float
        From release to the end, and the largest growth of the energy, m g R.
    """

    position: Array
    orientation: Array
    status: Bytes
    minimum: Indices
    time: Array
    growth: Array


def resting_poses(job: DropJob, first_drop: int, ends: Ends) -> RestingPoses:
    """Return the poses of drops that have ended, in the tray frame.

    The first has the index ``first_drop``.
    """
    scene = job.scene
    failed, settled = ends.status == RestStatus.FAILED, ends.status == RestStatus.SETTLED
    body = np.where(failed[:, None], [0.0, 0.0, 0.0, 1.0], ends.orientation)
    orientation = canonical(part_from_body(in_tray_axes(scene, body), job.axes))
    # A drop decided by its energy would continue to roll to the minimum. Its yaw and its sliding
    # on the way there are not predicted.
    decided = ends.minimum >= 0
    minima = job.rest.directions[ends.minimum[decided]]
    orientation[decided] = turned_down(orientation[decided], minima)
    # In Bullet, a hull rests a margin (0.001 R) above a plane; the pose has the part on it.
    if scene.level:
        centre = ends.position * job.radius
        depth = depth_of(composed(orientation, job.axes), job.hull) * job.radius
        centre[:, 2] = np.where(settled, depth, centre[:, 2])
    else:
        put_down = np.where(settled[:, None], _put_down(job, ends.position, body), ends.position)
        centre = scene.in_tray(put_down * job.radius)
    return RestingPoses(
        first_drop=first_drop,
        position=np.where(failed[:, None], 0.0, centre - rotate(orientation, job.centre_of_mass)),
        orientation=orientation,
        status=ends.status,
        decided_by=np.where(decided, DecidedBy.ENERGY, DecidedBy.STILLNESS).astype(np.uint8),
        time_to_rest=ends.time * job.time_unit,
        energy_growth=ends.growth,
    )


def _put_down(job: DropJob, position: Array, orientation: Array) -> Array:
    """Return positions (n, 3), R, at which hulls that rest near half-spaces touch them."""
    position = position.copy()
    planes = [
        (p.normal, p.offset / job.radius, depth_of(orientation, job.hull, -p.normal))
        for p in job.scene.half_spaces
    ]
    gaps = [(position * n).sum(axis=1) - offset - reach for n, offset, reach in planes]
    touching = [np.abs(gap) < TOUCH for gap in gaps]
    for _ in range(50 if len(planes) > 1 else 1):
        for (n, offset, reach), touches in zip(planes, touching, strict=True):
            gap = (position * n).sum(axis=1) - offset - reach
            position -= np.where(touches, gap, 0.0)[:, None] * n
    return position
