"""Mechanics of both engines on the plane, which resting poses do not show, against formulas.

For the law of the kernel see test_law_of_contact.py. The settings of Bullet determine how it flies
and bounces.
"""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from placed_bodies import Placed
from scipy.spatial.transform import Rotation

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation import job as drop_job
from resting_aspects_ros.simulation.actions import Step
from resting_aspects_ros.simulation.bullet_engine import EdgeWorld, WallWorld
from resting_aspects_ros.simulation.bullet_world import World
from resting_aspects_ros.simulation.conditions import BULLET
from resting_aspects_ros.simulation.job import STEPS_PER_T, make_job
from resting_aspects_ros.simulation.release import REST_MARGIN, InitialState
from resting_aspects_ros.simulation.scene import depth_of
from resting_aspects_ros.simulation.starts import rest_starts

# -- The kernel -----------------------------------------------------------------------------------


def test_spinning_friction_stops_a_spinning_part(solid, mat):
    # A ball, as friction at several points would stop a spin, too: torque mu N.
    conditions = mat.changed(rolling_friction=0.0, spinning_friction=0.03, friction=0.0)
    job = make_job(solid(trimesh.creation.icosphere(2, 10.0)), conditions, 1)
    turn = np.array([[0.0, 0, 0, 1]])
    position = np.array([[0.0, 0, depth_of(turn, job.hull)[0]]])
    placed = Placed(job, position, turn, spin=(0, 0, 2.0))
    lost = 2 - placed.run(3).spin[0, 2]
    assert lost == pytest.approx(0.03 / job.moments.mean() * placed.time[0], rel=0.01)


# -- Bullet ---------------------------------------------------------------------------------------


class Flight:
    """One body in Bullet from a given state, in R and T, looked at as it moves."""

    def __init__(
        self,
        job,
        position,
        orientation=(0, 0, 0, 1),
        velocity=(0, 0, 0),
        spin=(0, 0, 0),
        world=None,
    ):
        self.job, self.world = job, world or World(job)
        state = (position, orientation, velocity, spin)
        rows = [np.array([row], dtype=np.float64) for row in state]
        self.body = self.world._add(InitialState(*rows, elapsed=np.zeros(1)))

    def step(self, time=0.0):
        """Simulate for a time; returns the state."""
        for _ in range(round(time * self.world._steps_per_t)):
            self.world._bullet.stepSimulation()
        return self.world._states(self.body, np.zeros(1, dtype=int))


def momentum_and_energy(job, states):
    """Angular momentum in the tray and rotational energy, with the part's own inertia."""
    turn = Rotation.from_quat(states.orientation[0])
    spin = turn.inv().apply(states.spin[0])
    return turn.apply(spin * job.moments), float(spin @ (job.moments * spin)) / 2


def test_flight_in_bullet_conserves_angular_momentum_and_energy(part, mat):
    # Its moments all differ, and are far from those of its bounding box, which are Bullet's
    # default; about the axis of the middle one, which it nearly spins about, it turns over.
    job = make_job(part('u_bracket'), mat.changed(spin=15.0), 1, engine=BULLET)
    a, b, c = job.moments
    assert a < 0.9 * b < 0.8 * c
    flight = Flight(job, [0, 0, 50], [0.1, 0.5, -0.7, 0.5], [0.2, 0, 1], [0.05, 0.8, 0.05])
    momentum, energy = momentum_and_energy(job, flight.step())
    end = flight.step(3)
    after, energy_after = momentum_and_energy(job, end)
    # No damping: Bullet's default would take 1 - exp(-2 0.04 3) = 21 % of the energy. The
    # engine's implicit step takes some 0.1 %.
    assert energy_after == pytest.approx(energy, rel=5e-3)
    assert np.linalg.norm(after - momentum) < 5e-3 * np.linalg.norm(momentum)
    np.testing.assert_allclose(end.velocity[0], [0.2, 0, 1 - 3], atol=1e-9)
    # The semi-implicit step falls g t dt / 2 further than the parabola.
    fallen = 50 + 3 - 9 / 2 - end.position[0, 2]
    assert abs(fallen) < 1.01 * 3 / 2 / job.steps_per_t


@pytest.fixture(scope='module')
def octahedron(solid):
    corners = np.vstack([np.eye(3), -np.eye(3)]) * 10
    return solid(trimesh.convex.convex_hull(corners))


# The impact is seen at the end of a step, 1.4 / 160 of T, so a height of 1 comes out within some
# 2 % of it, which are of the rebound 2 % / e^2. With Bullet's defaults it would not converge with
# finer steps: a part is braked ahead of the contact, the more so the finer the steps, and pushed
# out of its overlap faster.
@pytest.mark.parametrize(
    ('restitution', 'steps', 'tolerance'),
    [(0.0, 160, 0.06), (0.3, 160, 0.06), (0.9, 160, 0.06), (0.64, 1280, 0.01)],
)
def test_bounce_height_in_bullet_is_restitution_squared(
    octahedron, mat, monkeypatch, restitution, steps, tolerance
):
    monkeypatch.setattr(drop_job, 'STEPS_PER_T', steps)
    conditions = mat.changed(restitution=restitution, height=0.01)
    job = make_job(octahedron, conditions, 1, engine=BULLET)
    assert job.steps_per_t == steps
    # A corner points down; it falls by R. The energy after the impact is the height of the bounce.
    after = Flight(job, [0, 0, 2.0]).step(math.sqrt(2) + 0.1)
    bounce = after.position[0, 2] - 1 + after.velocity[0, 2] ** 2 / 2
    assert bounce == pytest.approx(restitution**2, rel=tolerance, abs=tolerance / 6)


def test_friction_in_bullet_is_the_value_of_the_pair(part, mat):
    conditions = mat.changed(friction=0.3, restitution=0.0, rolling_friction=0.0)
    job = make_job(part('box_10x20x30'), conditions, 1, engine=BULLET)
    lying = np.ptp(job.hull, axis=0) / 2
    flat = int(lying.argmin())
    orientation = Rotation.align_vectors([[0, 0, 1.0]], [np.eye(3)[flat]])[0].as_quat()
    start = [0, 0, lying[flat] + REST_MARGIN]
    flight = Flight(job, start, orientation, [1, 0, 0])
    before = flight.step(0.5).velocity[0, 0]  # to lie
    assert before - flight.step(1).velocity[0, 0] == pytest.approx(0.3, rel=0.02)


# -- The first impact in Bullet of a part that starts in contact ----------------------------------


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
    'wall': ('wall', None, World, np.array([0.0, 1.0, 0.0]), (0, 0, 5)),
    'below an edge': (None, STEP, WallWorld, Z, (4, 0, 0)),
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
        flight = Flight(job, position, turn.as_quat(), velocity, spin, world)
        found = flight.step(1 / world._steps_per_t)

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
