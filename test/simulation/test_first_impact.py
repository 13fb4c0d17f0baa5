"""The first impact in Bullet of a part that starts in contact, compared with the formula."""

import dataclasses

import numpy as np
import pybullet
import pytest
from scipy.spatial.transform import Rotation

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.actions import Step
from resting_aspects_ros.simulation.bullet_engine import EdgeWorld, WallWorld
from resting_aspects_ros.simulation.bullet_world import World
from resting_aspects_ros.simulation.job import STEPS_PER_T, make_job
from resting_aspects_ros.simulation.release import REST_MARGIN, InitialState
from resting_aspects_ros.simulation.starts import rest_starts

RESTITUTION = 0.6
Z = np.array([0.0, 0.0, 1.0])
# Parts at an edge are all at the same place along it.
ALONG = 0.0, 0.0


def job_of(part, mat, surroundings, step):
    smooth = mat.changed(friction=0.0, rolling_friction=0.0, restitution=RESTITUTION)
    starts = None
    if step is not None:
        starts = rest_starts(part, find_aspects(part).aspects, step, smooth)
    if surroundings is not None:
        changes = {'wall.friction': 0.0} if surroundings == 'wall' else {}
        around = ra.surroundings(surroundings, **changes)
        smooth = dataclasses.replace(smooth, surroundings=around)
    return make_job(part, smooth, 1, refinement=16, starts=starts, engine='bullet')


STEP = Step(belt_speed=0.2, step_height=0.02)
# Surroundings, step, the world, the normal of the surface, and a place near it.
WORLDS = {
    'plane': (None, None, World, Z, (0, 0, 0)),
    'slope': ('slope', None, World, Z, (0, 0, 0)),
    'wall': ('wall', None, World, np.array([0.0, 1.0, 0.0]), (0, 0, 5)),
    'below an edge': (None, STEP, WallWorld, Z, (4, 0, 0)),
    'upper belt': (None, STEP, EdgeWorld, Z, (-4, 0, 0)),
    'below an edge of a slope': ('slope', STEP, WallWorld, Z, (4, 0, 0)),
    'upper belt of a slope': ('slope', STEP, EdgeWorld, Z, (-4, 0, 0)),
}


def on_one_corner(hull, normal, generator):
    """A random orientation in which only one corner is near the surface, and this corner."""
    while True:
        turn = Rotation.random(random_state=generator)
        corners = turn.apply(hull)
        first, second = np.argsort(corners @ normal)[:2]
        if (corners[second] - corners[first]) @ normal > 0.1:
            return turn, corners[first]


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize('where', WORLDS)
def test_impact_in_the_first_step_has_the_inertia_of_the_part(part, mat, where):
    surroundings, step, make, normal, place = WORLDS[where]
    generator = np.random.RandomState(3)
    for _ in range(3):
        job = job_of(part('u_bracket'), mat, surroundings, step)
        world = make(job, ALONG, STEPS_PER_T) if make is EdgeWorld else make(job)
        top = job.edge.step_height / job.radius if make is EdgeWorld else 0.0
        turn, corner = on_one_corner(job.hull, normal, generator)
        spin = generator.normal(size=3) * 0.3
        velocity = generator.normal(size=3) * 0.2 - 1.5 * normal
        above = top + REST_MARGIN - 1e-4 - corner @ normal
        position = np.array(place, dtype=float) + above * normal
        rows = (position, turn.as_quat(), velocity, spin)
        start = InitialState(*(row[None] for row in rows), elapsed=np.zeros(1))
        (body,) = world._add(start)
        pybullet.stepSimulation(physicsClientId=world._client)
        found = world._states([body], np.array([0]))

        arm = np.cross(corner, normal)
        compliance = turn.as_matrix() @ np.diag(1 / job.moments) @ turn.as_matrix().T
        approach = velocity @ normal + spin @ arm
        impulse = -(1 + RESTITUTION) * approach / (1 + arm @ compliance @ arm)
        # In the step, gravity changes the velocity by 1 / steps, gyroscopic torques change the
        # spin by less than 3 / steps, and the penetration is corrected with 4e-4.
        tolerance = 5 / world._steps_per_t + 1e-3
        assert abs(impulse) > 0.3
        np.testing.assert_allclose(found.velocity[0], velocity + impulse * normal, atol=tolerance)
        np.testing.assert_allclose(
            found.spin[0], spin + compliance @ arm * impulse, atol=4 * tolerance
        )
