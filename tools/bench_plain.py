"""The plain loop: one body in one PyBullet world, stepped from Python.

Scale, mass, inertia, friction, contacts and time step are those of the suite. The world is reused
for all drops, because creating one takes longer than a drop.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from bench_case import (
    Trial,
    drop_until_decided,
    drop_until_still,
    full_starts,
    steps_in,
    still_trial,
)

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation import bullet_world
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK, BodyStates
from resting_aspects_ros.simulation.settling import (
    REST_MOTION,
    REST_WINDOW,
    TIME_LIMIT,
)

# The last import, because the import of the engine suppresses the message that pybullet prints.
import pybullet  # isort:skip


class PlainBody:
    """A bench_case.Body in its own PyBullet world."""

    def __init__(self, job: DropJob, client: int) -> None:
        self.client = client
        step = 1 / job.steps_per_t
        pybullet.setGravity(0, 0, -1, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=step,
            numSubSteps=0,
            numSolverIterations=bullet_world.MAX_SOLVER_ITERATIONS,
            solverResidualThreshold=bullet_world.SOLVER_RESIDUAL,
            restitutionVelocityThreshold=bullet_world.RESTITUTION_THRESHOLD,
            erp=step / bullet_world.PENETRATION_TIME,
            contactERP=step / bullet_world.PENETRATION_TIME,
            physicsClientId=client,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        self.ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
        pybullet.changeDynamics(
            self.ground, -1, restitution=1, lateralFriction=1, physicsClientId=client
        )
        hull = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=job.hull.tolist(), physicsClientId=client
        )
        # With maximal coordinates, a step takes a tenth less time.
        self.id = pybullet.createMultiBody(
            1, hull, useMaximalCoordinates=1, physicsClientId=client
        )
        c = job.conditions
        pybullet.changeDynamics(
            self.id,
            -1,
            mass=1,
            localInertiaDiagonal=job.moments.tolist(),
            restitution=c.restitution,
            lateralFriction=c.friction,
            rollingFriction=c.rolling_friction,
            spinningFriction=c.spinning_friction,
            linearDamping=0,
            angularDamping=0,
            contactProcessingThreshold=0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=client,
        )

    def place(self, position: Array, orientation: Array) -> None:
        """Place the body at rest."""
        pybullet.resetBasePositionAndOrientation(
            self.id, position.tolist(), orientation.tolist(), physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(self.id, [0, 0, 0], [0, 0, 0], physicsClientId=self.client)

    def start(
        self, position: list[float], orientation: list[float], velocity: list[float]
    ) -> None:
        """Place the body with a velocity."""
        pybullet.resetBasePositionAndOrientation(
            self.id, position, orientation, physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(self.id, velocity, [0, 0, 0], physicsClientId=self.client)

    def surround(
        self, gravity: list[float], planes: list[tuple[list[float], float]], residual: float
    ) -> None:
        """Replace the ground by planes through the origin, by normals and factors of friction."""
        client = self.client
        pybullet.setGravity(*gravity, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            solverResidualThreshold=residual, physicsClientId=client
        )
        pybullet.removeBody(self.ground, physicsClientId=client)
        for normal, friction in planes:
            plane = pybullet.createCollisionShape(
                pybullet.GEOM_PLANE, planeNormal=normal, physicsClientId=client
            )
            body = pybullet.createMultiBody(
                0, plane, useMaximalCoordinates=1, physicsClientId=client
            )
            pybullet.changeDynamics(
                body, -1, restitution=1, lateralFriction=friction, physicsClientId=client
            )

    def step(self, steps: int) -> None:
        """Simulate this number of time steps."""
        for _ in range(steps):
            pybullet.stepSimulation(physicsClientId=self.client)

    def pose(self) -> list[float]:
        """Return position and orientation xyzw."""
        pose = pybullet.getBasePositionAndOrientation(self.id, physicsClientId=self.client)
        return [*pose[0], *pose[1]]

    def states(self) -> BodyStates:
        """Return pose and motion."""
        pose = pybullet.getBasePositionAndOrientation(self.id, physicsClientId=self.client)
        motion = pybullet.getBaseVelocity(self.id, physicsClientId=self.client)
        return BodyStates(*(np.array([numbers]) for numbers in (*pose, *motion)))


@contextmanager
def plain_body(job: DropJob) -> Iterator[PlainBody]:
    """Yield a body in a world of its own."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        yield PlainBody(job, client)
    finally:
        pybullet.disconnect(physicsClientId=client)


def plain_loop(job: DropJob, chunks: range) -> Trial:
    """Simulate drops; the pose is read after each step."""
    with plain_body(job) as body:
        return _drop_until_still(body, job, chunks)


def plain_loop_checks(job: DropJob, chunks: range) -> Trial:
    """Simulate drops; the pose is read only at every check."""
    with plain_body(job) as body:
        return drop_until_still(body, job, chunks)


def plain_loop_energy(job: DropJob, chunks: range) -> Trial:
    """Simulate drops; the pose is read at every check, and the suite's rule ends a drop."""
    with plain_body(job) as body:
        return drop_until_decided(body, job, chunks)


def _drop_until_still(body: PlainBody, job: DropJob, chunks: range) -> Trial:
    """Simulate drops until no coordinate changes by more than REST_MOTION in REST_WINDOW."""
    window, max_steps = steps_in(job, REST_WINDOW), steps_in(job, TIME_LIMIT)
    step: Callable[..., None] = pybullet.stepSimulation
    read: Callable[..., tuple[tuple[float, ...], tuple[float, ...]]]
    read = pybullet.getBasePositionAndOrientation
    starts = full_starts(job, chunks)
    ends: list[list[float]] = []
    steps = 0
    started = time.perf_counter()
    for start in starts:
        for slot in range(CHUNK):
            body.place(start.position[slot], start.orientation[slot])
            before, since = body.pose(), 0
            for k in range(max_steps):
                step(physicsClientId=body.client)
                position, orientation = read(body.id, physicsClientId=body.client)
                now = [*position, *orientation]
                if max(abs(a - b) for a, b in zip(now, before, strict=True)) > REST_MOTION:
                    before, since = now, k
                elif k - since >= window:
                    ends.append(now)
                    break
            steps += k + 1
    return still_trial(job, len(starts) * CHUNK, time.perf_counter() - started, steps, ends)
