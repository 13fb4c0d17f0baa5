"""The plain way: one body in one PyBullet world, stepped from a Python loop.

Scale, mass, inertia, friction and contacts are the suite's, and so is the step. The world is kept
for all drops: to make one for each takes longer than the drop.
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
from resting_aspects_ros.simulation import bullet_engine
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.settling import (
    REST_MOTION,
    REST_WINDOW,
    TIME_LIMIT,
    BodyStates,
)

# Of all imports the last, when the engine has silenced its greeting.
import pybullet  # isort:skip


class PlainBody:
    """A body of bench_case.Body in a world of its own."""

    def __init__(self, job: DropJob, client: int) -> None:
        self.client = client
        step = 1 / job.steps_per_t
        pybullet.setGravity(0, 0, -1, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=step,
            numSubSteps=0,
            numSolverIterations=bullet_engine.MAX_SOLVER_ITERATIONS,
            solverResidualThreshold=bullet_engine.SOLVER_RESIDUAL,
            restitutionVelocityThreshold=bullet_engine.RESTITUTION_THRESHOLD,
            erp=step / bullet_engine.PENETRATION_TIME,
            contactERP=step / bullet_engine.PENETRATION_TIME,
            physicsClientId=client,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
        pybullet.changeDynamics(
            ground, -1, restitution=1, lateralFriction=1, physicsClientId=client
        )
        hull = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=job.hull.tolist(), physicsClientId=client
        )
        # In maximal coordinates because a step then takes a tenth less.
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
        """Put it there, without motion."""
        pybullet.resetBasePositionAndOrientation(
            self.id, position.tolist(), orientation.tolist(), physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(self.id, [0, 0, 0], [0, 0, 0], physicsClientId=self.client)

    def step(self, steps: int) -> None:
        """Let time pass."""
        for _ in range(steps):
            pybullet.stepSimulation(physicsClientId=self.client)

    def pose(self) -> list[float]:
        """Position, orientation xyzw."""
        pose = pybullet.getBasePositionAndOrientation(self.id, physicsClientId=self.client)
        return [*pose[0], *pose[1]]

    def states(self) -> BodyStates:
        """Pose and motion."""
        pose = pybullet.getBasePositionAndOrientation(self.id, physicsClientId=self.client)
        motion = pybullet.getBaseVelocity(self.id, physicsClientId=self.client)
        return BodyStates(*(np.array([numbers]) for numbers in (*pose, *motion)))


@contextmanager
def _body(job: DropJob) -> Iterator[PlainBody]:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        yield PlainBody(job, client)
    finally:
        pybullet.disconnect(physicsClientId=client)


def plain_loop(job: DropJob, chunks: range) -> Trial:
    """Read after each step."""
    with _body(job) as body:
        return _drop_until_still(body, job, chunks)


def plain_loop_looks(job: DropJob, chunks: range) -> Trial:
    """Read at every look only."""
    with _body(job) as body:
        return drop_until_still(body, job, chunks)


def plain_loop_energy(job: DropJob, chunks: range) -> Trial:
    """Read at every look, and ended by the suite's own rule."""
    with _body(job) as body:
        return drop_until_decided(body, job, chunks)


def _drop_until_still(body: PlainBody, job: DropJob, chunks: range) -> Trial:
    """A drop is over when for REST_WINDOW nothing has moved by more than REST_MOTION."""
    window, most = steps_in(job, REST_WINDOW), steps_in(job, TIME_LIMIT)
    step: Callable[..., None] = pybullet.stepSimulation
    read: Callable[..., tuple[tuple[float, ...], tuple[float, ...]]]
    read = pybullet.getBasePositionAndOrientation
    starts = full_starts(job, chunks)
    ends: list[list[float]] = []
    steps = 0
    begun = time.perf_counter()
    for start in starts:
        for slot in range(CHUNK):
            body.place(start.position[slot], start.orientation[slot])
            before, since = body.pose(), 0
            for k in range(most):
                step(physicsClientId=body.client)
                position, orientation = read(body.id, physicsClientId=body.client)
                now = [*position, *orientation]
                if max(abs(a - b) for a, b in zip(now, before, strict=True)) > REST_MOTION:
                    before, since = now, k
                elif k - since >= window:
                    ends.append(now)
                    break
            steps += k + 1
    return still_trial(job, len(starts) * CHUNK, time.perf_counter() - begun, steps, ends)
