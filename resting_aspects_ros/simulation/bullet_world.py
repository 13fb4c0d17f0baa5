"""Bullet's world with a level plane; only bullet_* modules import pybullet.

Bullet's margins and thresholds are absolute, so every part is simulated in its own scale: lengths
are in units of the hull radius R, times in units of T = sqrt(R / g), and the mass is 1. Therefore
g is 1.
"""

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.simulation.bullet_client import empty_client, pybullet
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import BodyStates, InitialState
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL, Settling

# Simultaneous impacts at several points, such as those of a cylinder's side, need many solver
# iterations: with a fixed 20, a cylinder came to rest on its ends in 0.37 of the drops, with 320
# or more in 0.40 (n = 8000). Each body therefore iterates until no speed changes by more than the
# square root of the residual, R / T, or until the maximum. A few drops in 100 have an impact that
# reaches the maximum; doubling the maximum does not change any aspect's probability.
SOLVER_RESIDUAL = 1e-10
MAX_SOLVER_ITERATIONS = 1000
# As SOLVER_RESIDUAL, on a surface that moves, which a part touches most of the time. With the
# smaller residual, the action `bowl` takes 2.8 times as long. No class of an L bracket or a box
# becomes more or less frequent (`bowl` and `flip`, 29,600 pairs of actions from the same states:
# chi-square 43 with 47 degrees of freedom).
MOTION_RESIDUAL = 1e-8
# Penetration from an impact is corrected over this time, T. Bullet's default corrects it within a
# few steps, which adds speed: with finer steps, bounces then exceed e^2 h instead of converging to
# it.
PENETRATION_TIME = 0.25
# A contact persists until its points are this far apart, R. This is Bullet's default. For parts
# so thin that a contact on one side would persist on the other, the distance is limited to this
# fraction of the minimum height of the centre of mass.
CONTACT_BREAKING = 0.02
THIN_PART_FRACTION = 0.2
# Impacts slower than this, R / T, do not bounce, which avoids an endless series of small bounces.
RESTITUTION_THRESHOLD = 0.05

# A time step, T, in which nothing moves. Bullet makes no step below about 1e-16.
SHORT = 1e-12
SURFACE_GROUP, PART_GROUP = 1, 2


class World:
    """A Bullet world with a surface; only this class creates, steps and removes bodies.

    All worlds of a thread share one Bullet client, so only the newest world of a thread is valid.
    """

    _residual = SOLVER_RESIDUAL

    def __init__(self, job: DropJob) -> None:
        client = empty_client()
        residual = self._residual
        if job.motion is not None:
            residual = max(residual, MOTION_RESIDUAL)
        self._job = job
        self._client = client
        pybullet.setGravity(*job.down.tolist(), physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            numSubSteps=0,
            numSolverIterations=MAX_SOLVER_ITERATIONS,
            solverResidualThreshold=residual,
            # Bullet solves small islands together until they exceed this size. With 0, each body
            # is an island of its own and stops iterating independently.
            minimumSolverIslandSize=0,
            restitutionVelocityThreshold=RESTITUTION_THRESHOLD,
            contactBreakingThreshold=min(CONTACT_BREAKING, THIN_PART_FRACTION * job.min_height),
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        self._set_steps(job.steps_per_t)
        self._add_surface()
        self._shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=_corners(job.hull.tobytes()), physicsClientId=client
        )

    def _add_surface(self) -> None:
        """Add the bodies that the parts can touch."""
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self._client)
        self._ground = self._add_static(plane)

    def _pair_values(self) -> dict[str, float]:
        """Return restitution and friction of the part; those of the surface are 1."""
        c = self._job.conditions
        return {
            'restitution': c.restitution,
            'lateralFriction': c.friction,
            'rollingFriction': c.rolling_friction * self._job.rolling_length,
            'spinningFriction': c.spinning_friction,
        }

    def _set_steps(self, steps_per_t: int) -> None:
        """Set the number of time steps per T."""
        self._steps_per_t, self._step = steps_per_t, 1 / steps_per_t
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            erp=self._step / PENETRATION_TIME,
            contactERP=self._step / PENETRATION_TIME,
            physicsClientId=self._client,
        )

    def _add_static(self, shape: int) -> int:
        # With useMaximalCoordinates, Bullet would ignore the velocity that _place gives it.
        body: int = pybullet.createMultiBody(0, shape, physicsClientId=self._client)
        # Bullet multiplies the values of the two bodies; the part has the values of the pair.
        self._set(body, restitution=1, lateralFriction=1, rollingFriction=0, spinningFriction=0)
        self._collide(body, SURFACE_GROUP, PART_GROUP)
        return body

    def _place(self, body: int, *state: list[float]) -> None:
        """Set position, orientation, velocity and spin of a body."""
        client = self._client
        pybullet.resetBasePositionAndOrientation(body, *state[:2], physicsClientId=client)
        pybullet.resetBaseVelocity(body, *state[2:], physicsClientId=client)

    def _set(self, body: int, **values: float | list[float]) -> None:
        pybullet.changeDynamics(body, -1, physicsClientId=self._client, **values)

    def _collide(self, body: int, group: int, mask: int) -> None:
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self._client)

    def _add(self, states: InitialState) -> list[int]:
        """Add the parts, which a collision mask keeps from touching each other."""
        pair = self._pair_values()
        # Creating all bodies at once and placing them afterwards is faster: creating them one by
        # one takes a tenth of the time of a drop.
        bodies: tuple[int, ...] = pybullet.createMultiBody(
            1,
            self._shape,
            batchPositions=states.position.tolist(),
            useMaximalCoordinates=1,
            physicsClientId=self._client,
        )
        for body in bodies:
            self._set(
                body,
                # Mass and inertia must be set together: without the mass it becomes 0, without
                # the inertia Bullet uses the inertia of the bounding box.
                mass=1,
                localInertiaDiagonal=self._job.moments.tolist(),
                **pair,
                linearDamping=0,
                angularDamping=0,
                # Contacts act only on touch. By default, Bullet slows an approaching part before
                # the contact, and with fine steps no speed is left to bounce (bullet3 issue 4341).
                contactProcessingThreshold=0,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            )
        rows = (states.position, states.orientation, states.velocity, states.spin)
        starts = list(zip(*(each.tolist() for each in rows), strict=True))
        self._apply_inertia(bodies, starts)
        for body, start in zip(bodies, starts, strict=True):
            self._collide(body, PART_GROUP, SURFACE_GROUP)
            self._place(body, *start)
        return list(bodies)

    def _apply_inertia(self, bodies: Iterable[int], starts: list[tuple[list[float], ...]]) -> None:
        """Make a very short step without contacts, after which new bodies have their inertia.

        Bullet computes the inertia in world axes only at the end of a step. In the first step, a
        body would have that of its bounding box in the orientation in which it was created.
        """
        for body, (position, orientation, *_) in zip(bodies, starts, strict=True):
            self._collide(body, 0, 0)
            self._place(body, position, orientation, [0.0] * 3, [0.0] * 3)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=SHORT, physicsClientId=self._client)
        pybullet.stepSimulation(physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=self._step, physicsClientId=self._client)

    def drop(self, states: InitialState) -> Settling:
        """Release parts and step until each is at rest, failed or timed out."""
        return self._settled(self._add(states), Settling(self._job, states))

    def _settled(self, bodies: list[int], settling: Settling) -> Settling:
        now = 0.0
        while len(settling.moving):
            now = self._until_check(now)
            moving = self._states(bodies, settling.moving)
            for i in settling.check(now, moving):
                pybullet.removeBody(bodies[i], physicsClientId=self._client)
        return settling

    def _until_check(self, now: float) -> float:
        """Step the world from the time ``now``, T, to the next check; returns the time of it."""
        made, steps = (round(t * self._steps_per_t) for t in (now, CHECK_INTERVAL))
        self._advance(made, steps)
        return (made + steps) * self._step

    def _advance(self, made: int, steps: int) -> None:
        """Step the world, in which ``made`` steps were made, and move the surface with it."""
        if not self._job.in_motion(made * self._step):
            for _ in range(steps):
                pybullet.stepSimulation(physicsClientId=self._client)
            return
        *states, last = self._job.surface_states(made, steps)
        for state in states:
            self._place(self._ground, *state)
            pybullet.stepSimulation(physicsClientId=self._client)
        self._place(self._ground, *last)

    def _states(
        self, bodies: list[int] | dict[int, int], which: npt.NDArray[np.int64]
    ) -> BodyStates:
        ids, client = [bodies[i] for i in which.tolist()], self._client
        poses = [pybullet.getBasePositionAndOrientation(i, physicsClientId=client) for i in ids]
        speeds = [pybullet.getBaseVelocity(i, physicsClientId=client) for i in ids]
        position, orientation = map(np.array, zip(*poses, strict=True))
        velocity, spin = map(np.array, zip(*speeds, strict=True))
        return BodyStates(position, orientation, velocity, spin)


@lru_cache(maxsize=16)
def _corners(hull: bytes) -> list[list[float]]:
    """Return the hull vertices, (k, 3) float64, for Bullet; the same objects for every world.

    PyBullet never releases its reference to each number. Without the cache, a hull of 3000
    vertices would leak 0.3 MB per world.
    """
    corners: list[list[float]] = np.frombuffer(hull).reshape(-1, 3).tolist()
    return corners
