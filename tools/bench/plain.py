"""The plain loop: one body in one PyBullet world, stepped from Python and read after each step.

Scale, mass, inertia, friction, contacts and time step are those of the suite in Bullet. The world
is reused for all drops, because creating one takes longer than a drop.
"""

from operator import mul
from typing import Any

import numpy as np
from validation.trial import down_at_rest, released

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.simulation import bullet_world
from resting_aspects_ros.simulation.bullet_world import empty_client
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import TIME_LIMIT
from resting_aspects_ros.simulation.settling import REST_MOTION, REST_WINDOW


def plain_loop(job: DropJob, first: int, drops: int) -> Array:
    """Simulate drops until no coordinate changes by more than REST_MOTION in REST_WINDOW.

    Returns down in part of those that came to rest.
    """
    client = empty_client()
    body = _body(job, client)
    states = released(job, first, drops)
    rows = zip(
        states.position.tolist(),
        states.orientation.tolist(),
        states.velocity.tolist(),
        states.spin.tolist(),
        strict=True,
    )
    window, most = (round(span * job.steps_per_t) for span in (REST_WINDOW, TIME_LIMIT))
    ends: list[list[float]] = []
    for position, orientation, velocity, spin in rows:
        client.resetBasePositionAndOrientation(body, position, orientation)
        client.resetBaseVelocity(body, velocity, spin)
        before, since = [*position, *orientation], 0
        for k in range(most):
            client.stepSimulation()
            at, turned = client.getBasePositionAndOrientation(body)
            # A quaternion and its negative are the same orientation.
            sign = 1 if sum(map(mul, turned, before[3:])) > 0 else -1
            now = [*at, *(sign * q for q in turned)]
            if max(abs(a - b) for a, b in zip(now, before, strict=True)) > REST_MOTION:
                before, since = now, k
            elif k - since >= window:
                ends.append(now)
                break
    return down_at_rest(job, np.array(ends).reshape(-1, 7)[:, 3:])


def _body(job: DropJob, client: Any) -> int:
    """Return the body of the part, in a world with the plane."""
    step = 1 / job.steps_per_t
    client.setGravity(*job.scene.down.tolist())
    client.setPhysicsEngineParameter(
        fixedTimeStep=step,
        numSubSteps=0,
        numSolverIterations=bullet_world.MAX_SOLVER_ITERATIONS,
        solverResidualThreshold=bullet_world.SOLVER_RESIDUAL,
        restitutionVelocityThreshold=bullet_world.RESTITUTION_THRESHOLD,
        erp=step / bullet_world.PENETRATION_TIME,
        contactERP=step / bullet_world.PENETRATION_TIME,
    )
    shape = client.createCollisionShape(client.GEOM_PLANE, planeNormal=(0, 0, 1))
    # With maximal coordinates of both bodies, a step takes a tenth less time.
    plane = client.createMultiBody(0, shape, useMaximalCoordinates=1)
    c = job.conditions
    # Bullet multiplies the values of two bodies.
    client.changeDynamics(plane, -1, restitution=c.restitution, lateralFriction=c.friction)
    hull = client.createCollisionShape(client.GEOM_MESH, vertices=job.hull.tolist())
    body: int = client.createMultiBody(1, hull, useMaximalCoordinates=1)
    client.changeDynamics(
        body,
        -1,
        mass=1,
        localInertiaDiagonal=job.moments.tolist(),
        restitution=1,
        lateralFriction=1,
        rollingFriction=job.conditions.rolling_friction,
        spinningFriction=job.conditions.spinning_friction,
        linearDamping=0,
        angularDamping=0,
        contactProcessingThreshold=0,
        activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING,
    )
    return body
