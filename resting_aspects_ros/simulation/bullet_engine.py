"""Bullet as the engine of the drops: the one file that imports pybullet.

Everything is simulated in the part's own scale, because Bullet's margins and thresholds are
absolute: lengths in units of the hull radius R, times in T = sqrt(R / g), and the mass is 1,
so that g is 1.
"""

import math
import os
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK, InitialState, releases
from resting_aspects_ros.simulation.settling import LOOK, BodyStates, Settling, resting_poses


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

# Slots are this far apart, R. Bodies never meet (collision mask); apart, they cost least.
SLOT_SPACING = 4.0

# Impacts at several points at once, as of a cylinder's side, take many iterations: with a fixed 20
# a cylinder stood on its ends in 0.37 of drops, with 320 or more in 0.40 (n = 8000). So each body
# has as many as it takes until no speed changes by more than the root of this, R / T, up to a
# most. A few drops in 100 have an impact that reaches it; twice as many move no aspect.
SOLVER_RESIDUAL = 1e-10
MAX_SOLVER_ITERATIONS = 1000
# Overlap from an impact is pushed apart over this time, T. Bullet's default does it within a few
# steps, which adds speed: finer steps then bounce higher than e^2 h instead of converging to it.
OVERLAP_TIME = 0.25
# Points that were in contact are one contact until they are this far apart, R: Bullet's default,
# but for parts so thin that a contact of one side would hold on the other; of those it is this
# share of the lowest height of the centre of mass.
CONTACT_BREAKING = 0.02
THIN = 0.2
# Impacts slower than this, R / T, do not bounce; it ends the endless small bounces.
RESTITUTION_THRESHOLD = 0.05

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
    return resting_poses(job, first_drop, _World(job).drop(release, slots))


class _World:
    """A Bullet world with a surface; bodies are created, stepped and removed only here.

    Of a thread's worlds only the newest is alive.
    """

    def __init__(self, job: DropJob) -> None:
        client = _empty_client()
        self._job = job
        self._client = client
        self._step = 1 / job.steps_per_t
        pybullet.setGravity(0, 0, -1, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            numSubSteps=0,
            numSolverIterations=MAX_SOLVER_ITERATIONS,
            solverResidualThreshold=SOLVER_RESIDUAL,
            # Islands are solved together until there are more than so many. Each body is one, and
            # stops iterating by itself.
            minimumSolverIslandSize=0,
            restitutionVelocityThreshold=RESTITUTION_THRESHOLD,
            erp=self._step / OVERLAP_TIME,
            contactERP=self._step / OVERLAP_TIME,
            contactBreakingThreshold=min(CONTACT_BREAKING, THIN * job.lowest),
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
        # Bullet multiplies the two bodies' values: the part has those of the pair.
        self._set(ground, restitution=1, lateralFriction=1, rollingFriction=0, spinningFriction=0)
        self._collide(ground, _SURFACE_GROUP, _PART_GROUP)
        self._shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=_corners(job.hull.tobytes()), physicsClientId=client
        )

    def _set(self, body: int, **values: float | list[float]) -> None:
        pybullet.changeDynamics(body, -1, physicsClientId=self._client, **values)

    def _collide(self, body: int, group: int, mask: int) -> None:
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self._client)

    def _add(
        self, release: InitialState, slots: npt.NDArray[np.int64], origins: Array
    ) -> list[int]:
        c = self._job.conditions
        # All at once, and put in place after that: one by one they take a tenth of a drop's time.
        bodies: tuple[int, ...] = pybullet.createMultiBody(
            1,
            self._shape,
            batchPositions=origins.tolist(),
            useMaximalCoordinates=1,
            physicsClientId=self._client,
        )
        positions = (release.position[slots] + origins).tolist()
        for body, slot, position in zip(bodies, slots, positions, strict=True):
            self._set(
                body,
                # Together, or the mass becomes 0; without it the inertia is that of the bounding
                # box.
                mass=1,
                localInertiaDiagonal=self._job.moments.tolist(),
                restitution=c.restitution,
                lateralFriction=c.friction,
                rollingFriction=c.rolling_friction * self._job.rolling_length,
                spinningFriction=c.spinning_friction,
                linearDamping=0,
                angularDamping=0,
                # Contacts act when they touch. By default Bullet brakes an approaching part ahead
                # of the contact, and with fine steps nothing is left to bounce (bullet3 issue
                # 4341).
                contactProcessingThreshold=0,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            )
            self._collide(body, _PART_GROUP, _SURFACE_GROUP)
            pybullet.resetBasePositionAndOrientation(
                body, position, release.orientation[slot].tolist(), physicsClientId=self._client
            )
            pybullet.resetBaseVelocity(
                body,
                release.velocity[slot].tolist(),
                release.spin[slot].tolist(),
                physicsClientId=self._client,
            )
        return list(bodies)

    def drop(self, release: InitialState, slots: npt.NDArray[np.int64]) -> Settling:
        """Release a body in each slot and step until all rest, failed, or the time is up."""
        origins = _slot_origins(slots)
        bodies = self._add(release, slots, origins)
        settling = Settling(self._job, release, slots)
        steps = round(LOOK * self._job.steps_per_t)
        looks = 0
        while len(settling.moving):
            for _ in range(steps):
                pybullet.stepSimulation(physicsClientId=self._client)
            looks += 1
            states = self._states(bodies, origins, settling.moving)
            for i in settling.look(looks * steps * self._step, states):
                pybullet.removeBody(bodies[i], physicsClientId=self._client)
        return settling

    def _states(
        self, bodies: list[int], origins: Array, which: npt.NDArray[np.int64]
    ) -> BodyStates:
        ids, client = [bodies[i] for i in which], self._client
        poses = [pybullet.getBasePositionAndOrientation(i, physicsClientId=client) for i in ids]
        speeds = [pybullet.getBaseVelocity(i, physicsClientId=client) for i in ids]
        position, orientation = map(np.array, zip(*poses, strict=True))
        velocity, spin = map(np.array, zip(*speeds, strict=True))
        return BodyStates(position - origins[which], orientation, velocity, spin)


@lru_cache(maxsize=16)
def _corners(hull: bytes) -> list[list[float]]:
    """The hull, (k, 3) float64, for Bullet; the same objects for all chunks of a job.

    PyBullet keeps a reference to each number for ever: of a hull of 3000 corners 0.3 MB a chunk.
    """
    corners: list[list[float]] = np.frombuffer(hull).reshape(-1, 3).tolist()
    return corners


def _empty_client() -> int:
    """Bullet's client of this thread, its world empty. To connect takes 5 ms, so it is kept."""
    if not hasattr(_kept, 'client'):
        _kept.client = _Client()
    number = _kept.client.number
    pybullet.resetSimulation(physicsClientId=number)
    return number


class _Client:
    """A connection to Bullet that ends with its thread."""

    def __init__(self) -> None:
        self.number: int = pybullet.connect(pybullet.DIRECT)
        if self.number < 0:
            raise EngineError('Bullet has no room for another world in this process')
        weakref.finalize(self, pybullet.disconnect, self.number)


class _PerThread(threading.local):
    client: _Client


_kept = _PerThread()


def _slot_origins(slots: npt.NDArray[np.int64]) -> Array:
    side = math.ceil(math.sqrt(CHUNK))
    return np.stack([slots % side, slots // side, np.zeros(len(slots))], axis=1) * SLOT_SPACING
