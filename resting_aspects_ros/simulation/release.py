"""Initial states of drops: random or given, but determined by seed and index of each drop."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.rotations import Random, composed, down_in_part, random_orientations
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.job import BULLET, DropJob
from resting_aspects_ros.simulation.scene import in_scene_axes, released
from resting_aspects_ros.simulation.starts import Starts

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


@dataclass(frozen=True, eq=False)
class InitialState:
    """Initial state of n drops, in R and T; shapes (n, 3), (n, 4), (n, 3), (n, 3) and (n,)."""

    position: Array
    orientation: Array
    velocity: Array
    spin: Array
    elapsed: Array  # time of the free fall that is not simulated

    def select(self, which: npt.NDArray[Any]) -> 'InitialState':
        """Return the states of some of the drops."""
        return InitialState(
            self.position[which],
            self.orientation[which],
            self.velocity[which],
            self.spin[which],
            self.elapsed[which],
        )

    @property
    def flight(self) -> Array:
        """(n,) time of flight that is simulated, T."""
        up = self.velocity[:, 2]
        return np.asarray(up + np.sqrt(up**2 + 2 * np.abs(self.position[:, 2])))


@dataclass(frozen=True, eq=False)
class BodyStates:
    """States of n bodies, in R and T, in tray axes.

    position, velocity : (n, 3)
        Of the centre of mass.
    orientation : (n, 4)
        Tray from body.
    spin : (n, 3)
    """

    position: Array
    orientation: Array
    velocity: Array
    spin: Array

    def select(self, which: npt.NDArray[Any]) -> 'BodyStates':
        """Return the states of some of the bodies."""
        return BodyStates(
            self.position[which], self.orientation[which], self.velocity[which], self.spin[which]
        )


def initial_states(job: DropJob, first: int, end: int) -> InitialState:
    """Return the initial states of the drops ``first`` to ``end - 1``.

    That of a drop depends only on the job and its index.
    """
    random, n = DropRandom(job.seed, first, end), end - first
    if job.starts is not None:
        return _started(job, job.starts, np.arange(first, end), random)
    return (_released if job.scene.level else _in_scene)(job, random, n)


def _started(
    job: DropJob, starts: Starts, index: npt.NDArray[np.int64], random: Random
) -> InitialState:
    """Return the initial states of parts that start as ``starts`` determines."""
    states, scene = starts.states(index, random), job.scene
    of_body = body_from_part(states.orientation, job.axes)
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


def _released(job: DropJob, random: Random, n: int) -> InitialState:
    """Return the initial states of parts that are dropped in random orientations."""
    c, unit = job.conditions, job.time_unit
    of_part = random_orientations(random, n)
    deviations = np.array([c.speed_horizontal, c.speed_horizontal, c.speed_vertical])
    velocity = random.standard_normal((n, 3)) * deviations * unit / job.radius
    spin = random.standard_normal((n, 3)) * c.spin * unit

    of_body = body_from_part(of_part, job.axes)
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
    corners = job.hull * job.radius
    position, of_body, velocity, spin = released(scene, c, corners, job.axes, random, n)
    position /= job.radius
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


def body_from_part(of_part: Array, axes: Array) -> Array:
    """Return the rotation tray from body, given tray from part and the job's axes."""
    return composed(of_part, axes)


def part_from_body(of_body: Array, axes: Array) -> Array:
    """Return the rotation tray from part, given tray from body and the job's axes."""
    return composed(of_body, axes * [-1, -1, -1, 1])


def depth_of(xyzw: Array, hull: Array) -> Array:
    """Return the heights, (n,), of the centre of mass above the lowest point of the hull."""
    # A matrix product would not do: its rounding depends on the number of rows, so that a drop's
    # height would depend on how many other drops are simulated.
    x, y, z = down_in_part(xyzw).T[:, :, None]
    reach: Array = (x * hull[:, 0] + y * hull[:, 1] + z * hull[:, 2]).max(axis=1)
    return reach
