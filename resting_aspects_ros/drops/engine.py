"""Bullet as the engine of the drops: the one file that imports pybullet.

Everything is simulated in the part's own scale, because Bullet's margins and thresholds are
absolute: lengths in units of the hull radius R, times in T = sqrt(R / g), and the mass is 1,
so that g is 1.
"""

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.errors import EngineError, InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import (
    Array,
    canonical,
    down_in_part,
    random_orientations,
    rotate,
)
from resting_aspects_ros.drops.conditions import DropConditions, HeightOf


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing reaches standard error: for C code, which does not know sys.stderr."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _silent():  # it prints when it was built, in every process
    import pybullet

ENGINE = 'bullet'
ENGINE_VERSION = version('pybullet')

# Drops of a chunk share a world, each in its own slot; a drop's slot is its index modulo the
# chunk, since the rounding, and with it the pose, depends on the place in the world.
CHUNK = 125
# Slots are this far apart, R. Bodies never meet (collision mask); apart, they cost least.
SLOT_SPACING = 4.0

# Steps in T: from here on, finer steps move no aspect of an L bracket by more than sampling does.
STEPS_PER_T = 160
# A step moves no point of the part by more than this, R, at the speed of impact, however high it
# fell and however fast it was thrown.
TRAVEL_PER_STEP = 0.02
# Faster impacts, R / T, are refused: their many small steps would hold a worker for hours.
FASTEST_IMPACT = 100.0
SOLVER_ITERATIONS = 20
# Overlap from an impact is pushed apart over this time, T. Bullet's default does it within a few
# steps, which adds speed: finer steps then bounce higher than e^2 h instead of converging to it.
OVERLAP_TIME = 0.25
# Impacts slower than this, R / T, do not bounce; it ends the endless small bounces.
RESTITUTION_THRESHOLD = 0.05
# Without spin, free fall only adds speed: it is left out down to this clearance, R, which is more
# than Bullet's contact breaking distance (0.02).
START_CLEARANCE = 0.05

# At rest: for REST_WINDOW T no coordinate and no quaternion component changes by more than
# REST_MOTION between looks that are LOOK T apart. A part about to topple from an edge grows its
# tilt e-fold in about T, so that only a tilt below 1e-4 could be taken for rest. Windows of 0.5 to
# 60 T gave the same aspects (L bracket, T prism, hex nut; 500 drops of each).
LOOK = 0.25
REST_WINDOW = 2.0
REST_MOTION = 1e-4
# A drop that still moves after so many T is unsettled.
TIME_LIMIT = 500.0

_SURFACE_GROUP, _PART_GROUP = 1, 2


@dataclass(frozen=True, eq=False)
class DropJob:
    """All that a worker needs to drop a part: plain data, the same for every drop of a run.

    hull : (k, 3) float
        Hull vertices from the centre of mass along the principal axes, in units of R.
    moments : (3,) float
        Principal moments of inertia in units of mass x R^2.
    axes : (3, 3) float
        Principal axes as columns, part frame.
    centre_of_mass : (3,) float
        Part frame, m.
    radius : float
        R, the hull radius, m.
    """

    hull: Array
    moments: Array
    axes: Array
    centre_of_mass: Array
    radius: float
    conditions: DropConditions
    seed: int

    @property
    def time_unit(self) -> float:
        """T = sqrt(R / g), s."""
        return math.sqrt(self.radius / self.conditions.gravity)

    @property
    def impact(self) -> float:
        """Speed at which the fastest point of the part meets the surface, m/s.

        With 3 standard deviations of the speed and the spin at release; the horizontal speed
        counts, because friction makes it spin.
        """
        c = self.conditions
        fall = 2 * c.gravity * c.height
        thrown = math.hypot(3 * c.speed_horizontal, 3 * c.speed_vertical)
        return math.sqrt(fall + thrown**2) + 3 * c.spin * self.radius

    @property
    def steps_per_t(self) -> int:
        """Time steps in T."""
        impact = self.impact * self.time_unit / self.radius
        return max(STEPS_PER_T, math.ceil(impact / TRAVEL_PER_STEP))

    @property
    def time_step(self) -> float:
        """Of the engine, s."""
        return self.time_unit / self.steps_per_t


def make_job(part: Part, conditions: DropConditions, seed: int) -> DropJob:
    """The job of dropping a part; InvalidValueError if it cannot be dropped in that way."""
    radius = part.hull_radius
    if conditions.height_of is HeightOf.CENTRE_OF_MASS and conditions.height <= radius:
        raise InvalidValueError(
            f'height of the centre of mass is {conditions.height:g} m, allowed for {part.name} is '
            f'more than {radius:.4g} m: lower, the part could touch the surface when released'
        )
    job = DropJob(
        hull=(part.hull_vertices - part.centre_of_mass) @ part.principal_axes / radius,
        moments=part.principal_moments / (part.mass * radius**2),
        axes=part.principal_axes,
        centre_of_mass=part.centre_of_mass,
        radius=radius,
        conditions=conditions,
        seed=seed,
    )
    fastest = FASTEST_IMPACT * job.radius / job.time_unit
    if job.impact > fastest:
        raise InvalidValueError(
            f'height, speed and spin of release let {part.name} meet the surface at '
            f'{job.impact:.4g} m/s, allowed for its size and gravity is up to {fastest:.4g} m/s'
        )
    return job


@dataclass(frozen=True, eq=False)
class _Release:
    """How the drops of a chunk start in the world, in R and T. Shapes (n, 3), (n, 4), (n,)."""

    position: Array
    orientation: Array
    velocity: Array
    spin: Array
    elapsed: Array  # time of the fall that was left out


def _releases(job: DropJob, chunk: int) -> _Release:
    """The starts of all drops of a chunk: always all, so that a drop's start is its own."""
    c, unit = job.conditions, job.time_unit
    generator = np.random.default_rng(np.random.SeedSequence(job.seed, spawn_key=(chunk,)))
    of_part = random_orientations(generator, CHUNK)
    deviations = np.array([c.speed_horizontal, c.speed_horizontal, c.speed_vertical])
    velocity = generator.standard_normal((CHUNK, 3)) * deviations * unit / job.radius
    spin = generator.standard_normal((CHUNK, 3)) * c.spin * unit

    of_body = _body_from_part(of_part, job.axes)
    depth = _depth(of_body, job.hull)
    height = np.full(CHUNK, c.height / job.radius)
    clearance = height if c.height_of is HeightOf.LOWEST_POINT else height - depth
    elapsed = np.zeros(CHUNK)
    if c.spin == 0:
        start = np.minimum(clearance, START_CLEARANCE)
        speed = np.sqrt(velocity[:, 2] ** 2 + 2 * (clearance - start))
        speed = np.where(clearance > start, speed, -velocity[:, 2])
        elapsed = velocity[:, 2] + speed
        velocity[:, 2] = -speed
        clearance = start
    position = np.zeros((CHUNK, 3))
    position[:, :2] = velocity[:, :2] * elapsed[:, None]
    position[:, 2] = clearance + depth
    return _Release(position, of_body, velocity, spin, elapsed)


def drop_chunk(job: DropJob, first_drop: int, end: int) -> RestingPoses:
    """Drop the drops ``first_drop`` to ``end - 1``, all of one chunk, until they rest.

    The poses depend on the job and the index of the drop alone: not on which other drops of the
    chunk are asked for, nor on the process they are made in.
    """
    chunk = first_drop // CHUNK
    if not chunk * CHUNK <= first_drop < end <= (chunk + 1) * CHUNK:
        raise ValueError(f'drops {first_drop} to {end - 1} are not of one chunk of {CHUNK}')
    slots = np.arange(first_drop - chunk * CHUNK, end - chunk * CHUNK)
    release = _releases(job, chunk)
    with _world(job) as world:
        return _poses(job, first_drop, release, slots, world.drop(release, slots))


@dataclass(frozen=True, eq=False)
class _Ends:
    """Where bodies came to rest, in R and T, in the order of the slots asked for."""

    position: Array  # (n, 3) centre of mass
    orientation: Array  # (n, 4) body frame
    status: npt.NDArray[np.uint8]
    time: Array  # (n,)


class _World:
    """One Bullet world with a surface; bodies are created, stepped and removed only here."""

    def __init__(self, job: DropJob, client: int) -> None:
        self._job = job
        self._client = client
        self._step = 1 / job.steps_per_t
        pybullet.setGravity(0, 0, -1, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            numSubSteps=0,
            numSolverIterations=SOLVER_ITERATIONS,
            # Any other value lets the bodies of a world stop iterating together.
            solverResidualThreshold=0,
            restitutionVelocityThreshold=RESTITUTION_THRESHOLD,
            erp=self._step / OVERLAP_TIME,
            contactERP=self._step / OVERLAP_TIME,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
        # Bullet multiplies the two bodies' values: the part has those of the pair.
        self._set(ground, restitution=1, lateralFriction=1, rollingFriction=0, spinningFriction=0)
        self._collide(ground, _SURFACE_GROUP, _PART_GROUP)
        self._shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=job.hull.tolist(), physicsClientId=client
        )

    def _set(self, body: int, **values: float | list[float]) -> None:
        pybullet.changeDynamics(body, -1, physicsClientId=self._client, **values)

    def _collide(self, body: int, group: int, mask: int) -> None:
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self._client)

    def _add(self, release: _Release, slot: int) -> int:
        c = self._job.conditions
        body: int = pybullet.createMultiBody(
            1,
            self._shape,
            basePosition=(release.position[slot] + _slot_origin(slot)).tolist(),
            baseOrientation=release.orientation[slot].tolist(),
            useMaximalCoordinates=1,
            physicsClientId=self._client,
        )
        self._set(
            body,
            # Together, or the mass becomes 0; without it the inertia is that of the bounding box.
            mass=1,
            localInertiaDiagonal=self._job.moments.tolist(),
            restitution=c.restitution,
            lateralFriction=c.friction,
            rollingFriction=c.rolling_friction,
            spinningFriction=c.spinning_friction,
            linearDamping=0,
            angularDamping=0,
            # Contacts act when they touch. By default Bullet brakes an approaching part ahead of
            # the contact, and with fine steps nothing is left to bounce (bullet3 issue 4341).
            contactProcessingThreshold=0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
        )
        self._collide(body, _PART_GROUP, _SURFACE_GROUP)
        pybullet.resetBaseVelocity(
            body,
            release.velocity[slot].tolist(),
            release.spin[slot].tolist(),
            physicsClientId=self._client,
        )
        return body

    def drop(self, release: _Release, slots: npt.NDArray[np.int64]) -> _Ends:
        """Release a body in each slot and step until all rest, failed, or the time is up."""
        n, client = len(slots), self._client
        bodies = [self._add(release, int(slot)) for slot in slots]
        pose = np.zeros((n, 7))
        status = np.full(n, RestStatus.UNSETTLED, dtype=np.uint8)
        time = np.full(n, math.inf)
        still = np.zeros(n, dtype=np.int64)  # looks in a row without motion
        moving = np.arange(n)
        steps = round(LOOK * self._job.steps_per_t)
        now, limit = 0.0, TIME_LIMIT + float(_flight(release))
        while len(moving) and now < limit:
            for _ in range(steps):
                pybullet.stepSimulation(physicsClientId=client)
            now += steps * self._step
            seen = np.array(
                [
                    (*position, *orientation)
                    for position, orientation in (
                        pybullet.getBasePositionAndOrientation(bodies[i], physicsClientId=client)
                        for i in moving
                    )
                ]
            )
            motion = np.abs(seen - pose[moving]).max(axis=1)
            broken = ~np.isfinite(motion) | (seen[:, 2] < 0)  # the centre of mass never gets below
            pose[moving] = np.where(broken[:, None], pose[moving], seen)
            still[moving] = np.where(motion < REST_MOTION, still[moving] + 1, 0)
            rest = still[moving] * LOOK >= REST_WINDOW
            status[moving[rest]] = RestStatus.SETTLED
            time[moving[rest]] = now - REST_WINDOW
            status[moving[broken]] = RestStatus.FAILED
            time[moving[broken]] = math.nan
            for i in moving[rest | broken]:
                pybullet.removeBody(bodies[i], physicsClientId=client)
            moving = moving[~(rest | broken)]
        time[np.isinf(time)] = now
        pose[:, :3] -= np.array([_slot_origin(int(slot)) for slot in slots])
        return _Ends(pose[:, :3], pose[:, 3:], status, time)


@contextmanager
def _world(job: DropJob) -> Iterator[_World]:
    client = pybullet.connect(pybullet.DIRECT)
    if client < 0:
        raise EngineError('Bullet has no room for another world in this process')
    try:
        yield _World(job, client)
    finally:
        pybullet.disconnect(physicsClientId=client)


def _flight(release: _Release) -> float:
    """Longest time of flight from the release that is simulated, T."""
    up = release.velocity[:, 2]
    longest: float = (up + np.sqrt(up**2 + 2 * np.abs(release.position[:, 2]))).max()
    return longest


def _slot_origin(slot: int) -> Array:
    side = math.ceil(math.sqrt(CHUNK))
    return np.array([slot % side, slot // side, 0.0]) * SLOT_SPACING


def _poses(
    job: DropJob,
    first_drop: int,
    release: _Release,
    slots: npt.NDArray[np.int64],
    ends: _Ends,
) -> RestingPoses:
    """From bodies in R and T to parts in m and s."""
    failed = ends.status == RestStatus.FAILED
    body = np.where(failed[:, None], [0.0, 0.0, 0.0, 1.0], ends.orientation)
    orientation = canonical(_part_from_body(body, job.axes))
    centre = ends.position * job.radius
    # A hull rests a margin (0.001 R) above Bullet's plane; a part rests on the surface.
    settled = ends.status == RestStatus.SETTLED
    depth = _depth(body, job.hull) * job.radius
    centre[:, 2] = np.where(settled, depth, centre[:, 2])
    position = centre - rotate(orientation, job.centre_of_mass)
    elapsed = ends.time + release.elapsed[slots]
    return RestingPoses(
        first_drop=first_drop,
        position=np.where(failed[:, None], 0.0, position),
        orientation=orientation,
        status=ends.status,
        decided_by=np.full(len(slots), DecidedBy.STILLNESS, dtype=np.uint8),
        time_to_rest=elapsed * job.time_unit,
    )


def _body_from_part(of_part: Array, axes: Array) -> Array:
    """Tray from body, given tray from part: the body's axes are the part's principal axes."""
    return np.asarray((Rotation.from_quat(of_part) * Rotation.from_matrix(axes)).as_quat())


def _part_from_body(of_body: Array, axes: Array) -> Array:
    """Tray from part, given tray from body."""
    return np.asarray((Rotation.from_quat(of_body) * Rotation.from_matrix(axes).inv()).as_quat())


def _depth(xyzw: Array, hull: Array) -> Array:
    """(n,) heights of the centre of mass above the lowest point of the hull (k, 3)."""
    # Not as a matrix product: its rounding depends on how many rows it has, so that a drop's
    # height would depend on how many others are asked for (rule 1).
    x, y, z = down_in_part(xyzw).T[:, :, None]
    reach: Array = (x * hull[:, 0] + y * hull[:, 1] + z * hull[:, 2]).max(axis=1)
    return reach
