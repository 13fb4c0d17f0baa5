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

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import Array, canonical, rotate
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.release import CHUNK, Release, depth_of, releases


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

# Slots are this far apart, R. Bodies never meet (collision mask); apart, they cost least.
SLOT_SPACING = 4.0

SOLVER_ITERATIONS = 20
# Overlap from an impact is pushed apart over this time, T. Bullet's default does it within a few
# steps, which adds speed: finer steps then bounce higher than e^2 h instead of converging to it.
OVERLAP_TIME = 0.25
# Impacts slower than this, R / T, do not bounce; it ends the endless small bounces.
RESTITUTION_THRESHOLD = 0.05
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


def drop_chunk(job: DropJob, first_drop: int, end: int) -> RestingPoses:
    """Drop the drops ``first_drop`` to ``end - 1``, all of one chunk, until they rest.

    The poses depend on the job and the index of the drop alone: not on which other drops of the
    chunk are asked for, nor on the process they are made in.
    """
    chunk = first_drop // CHUNK
    if not chunk * CHUNK <= first_drop < end <= (chunk + 1) * CHUNK:
        raise ValueError(f'drops {first_drop} to {end - 1} are not of one chunk of {CHUNK}')
    slots = np.arange(first_drop - chunk * CHUNK, end - chunk * CHUNK)
    release = releases(job, chunk)
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

    def _add(self, release: Release, slot: int) -> int:
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

    def drop(self, release: Release, slots: npt.NDArray[np.int64]) -> _Ends:
        """Release a body in each slot and step until all rest, failed, or the time is up."""
        n, client = len(slots), self._client
        bodies = [self._add(release, int(slot)) for slot in slots]
        pose = np.zeros((n, 7))
        status = np.full(n, RestStatus.UNSETTLED, dtype=np.uint8)
        time = np.full(n, math.inf)
        still = np.zeros(n, dtype=np.int64)  # looks in a row without motion
        moving = np.arange(n)
        steps = round(LOOK * self._job.steps_per_t)
        now, limit = 0.0, TIME_LIMIT + release.flight
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


def _slot_origin(slot: int) -> Array:
    side = math.ceil(math.sqrt(CHUNK))
    return np.array([slot % side, slot // side, 0.0]) * SLOT_SPACING


def _poses(
    job: DropJob,
    first_drop: int,
    release: Release,
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
    depth = depth_of(body, job.hull) * job.radius
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


def _part_from_body(of_body: Array, axes: Array) -> Array:
    """Tray from part, given tray from body."""
    return np.asarray((Rotation.from_quat(of_body) * Rotation.from_matrix(axes).inv()).as_quat())
