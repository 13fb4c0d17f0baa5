"""Bodies on slopes, belts and between planes, compared with formulas.

Tolerances follow from the time step: friction is too strong by up to FRICTION_EXCESS times the
time step, the path of a body that slows down is shorter by its travel in half a step, and a force
differs from its mean by the momentum of one step of gravity.
"""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from placed_bodies import FRICTION_EXCESS, point_path
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL
from resting_aspects_ros.simulation.surroundings.kinds import Chute, Slope, VGroove, Wall
from resting_aspects_ros.simulation.surroundings.scene_settling import WINDOW

YAWS = np.radians([0, 20, 45, 70, 90])
# The angle within which a threshold must be right.
NEAR = math.radians(0.3)
FRICTION = 0.5
BALL_STEPS = 3


@pytest.fixture(scope='module')
def block(solid):
    return solid(trimesh.creation.box((30, 20, 10)))


def test_a_block_stays_on_a_slope_below_the_friction_angle(block, job_in, flat_on):
    job = job_in(block, Slope(math.atan(FRICTION) - NEAR), friction=FRICTION)
    placed = flat_on(job, YAWS)
    before = placed.step(5).position
    after = placed.step(10).position
    assert np.linalg.norm(after - before, axis=1).max() < 1e-3
    # It comes to rest, too; it does not remain unsettled.
    assert (flat_on(job, YAWS).settle() == RestStatus.SETTLED).all()


def test_a_block_slides_on_a_slope_above_the_friction_angle(block, job_in, flat_on):
    job = job_in(block, Slope(math.atan(FRICTION) + NEAR), friction=FRICTION)
    placed = flat_on(job, YAWS)
    excess = _friction_excess(placed)
    assert excess.max() < FRICTION_EXCESS * job.time_step / job.time_unit
    assert (placed.settle() == RestStatus.SLIDING).all()


def test_friction_converges_to_that_of_coulomb_with_the_time_step(block, job_in, flat_on):
    slope = Slope(math.atan(FRICTION) + math.radians(3))
    mean = []
    for refinement in (1, 4):
        job = job_in(block, slope, friction=FRICTION, refinement=refinement)
        excess, step = _friction_excess(flat_on(job, YAWS)), 1 / job.steps_per_t
        # A mean force over 5 T is off by at most the momentum of one step.
        assert -step / 5 <= excess.min() <= excess.max() < FRICTION_EXCESS * step
        mean.append(excess.mean())
    # With a quarter of the step, a quarter of the error; half of it shows that it decreases.
    assert mean[1] < mean[0] / 2


def _friction_excess(placed):
    """By how much the friction on blocks that slide down a slope exceeds Coulomb's, (n,)."""
    down = placed.job.scene.down
    before, after = placed.step(1), placed.step(5)
    acceleration = (after.velocity - before.velocity)[:, 0] / 5
    return (down[0] - acceleration) / (FRICTION * -down[2]) - 1


@pytest.mark.parametrize('degrees', [0, 10])
@pytest.mark.parametrize('friction', [0.25, 0.5])
def test_sliding_distance_downhill(block, job_in, flat_on, degrees, friction):
    angle = math.radians(degrees) + 1e-9
    speed = 0.5
    job = job_in(block, Slope(angle), friction=friction)
    placed = flat_on(job, YAWS, (speed, 0, 0))
    begin = placed.states.position[:, 0]
    slowed = friction * math.cos(angle) - math.sin(angle)
    expected = speed**2 / 2 / slowed
    distance = placed.step(3 * expected / speed).position[:, 0] - begin
    step = 1 / job.steps_per_t
    stronger = FRICTION_EXCESS * step * friction * math.cos(angle)
    assert (distance < expected).all()
    assert (distance > speed**2 / 2 / (slowed + stronger) - speed * step).all()


def test_friction_acts_against_the_motion_in_any_direction(block, job_in, flat_on):
    # Up, across and down a slope, for the same block and all directions.
    directions = np.radians(np.arange(0, 360, 30))
    angle, friction, speed = math.radians(10), 0.4, 0.5
    velocity = speed * np.stack([np.cos(directions), np.sin(directions), 0 * directions], axis=1)
    job = job_in(block, Slope(angle), friction=friction)
    placed = flat_on(job, 0 * directions, velocity)
    begin = placed.states.position[:, :2]
    moved = placed.step(10).position[:, :2] - begin
    step = 1 / job.steps_per_t
    for of_block, v in zip(moved, velocity[:, :2], strict=True):
        expected = point_path(angle, friction, v)
        shorter = point_path(angle, friction * (1 + FRICTION_EXCESS * step), v)
        allowed = np.linalg.norm(shorter - expected) + speed * step
        assert np.linalg.norm(of_block - expected) < allowed


@pytest.mark.parametrize(('yaw', 'width'), [(0, 10), (90, 15)])
def test_a_block_tips_where_its_centre_of_mass_is_beyond_its_edge(
    solid, job_in, flat_on, yaw, width
):
    # The energy barrier 0.3 degrees below the limit is 1e-5 m g R: less than that of the fall of
    # a block that is put down. So it is tilted when it is at rest.
    column = solid(trimesh.creation.box((10, 15, 30)))
    limit = math.atan(width / 30)
    for angle, falls in ((limit - NEAR, False), (limit + NEAR, True)):
        placed = flat_on(job_in(column, Slope(1e-9), friction=2.0), [math.radians(yaw)])
        before = Rotation.from_quat(placed.step(5).orientation)
        for tilt in np.linspace(0.8 * angle, angle, 40):
            placed.tilt(tilt)
            placed.step(0.5)
        turned = Rotation.from_quat(placed.step(15).orientation) * before.inv()
        assert (turned.magnitude()[0] > 0.5) == falls, math.degrees(angle)


@pytest.mark.slow
@pytest.mark.parametrize(('right', 'left'), [(30, 60), (45, 45), (20, 50)])
def test_normal_forces_on_a_ball_between_frictionless_planes(solid, job_in, flat_on, right, left):
    # In the scene frame both planes of a groove are equally steep; the roll makes the difference.
    b1, b2 = np.radians([right, left])
    groove = VGroove(math.pi - b1 - b2, roll=(b2 - b1) / 2)
    ball = solid(trimesh.creation.icosphere(4, 10.0))
    job = job_in(ball, groove, friction=0.0)
    height = 1.0005 / math.sin(groove.opening / 2)
    placed = flat_on(job, [0.0])
    placed._place(placed.bodies[0], [0, 0, height], [0, 0, 0, 1], [0] * 3, [0] * 3)
    placed.step(5)
    impulse, steps = np.zeros(2), 5 * job.steps_per_t
    for _ in range(steps):
        forces = placed.advance_one()
        impulse += [forces.get(plane, 0.0) for plane in range(2)]
    angles = [math.acos(-float(body.normal @ job.scene.down)) for body in job.scene.bodies]
    a1, a2 = angles
    expected = [math.sin(a2) / math.sin(a1 + a2), math.sin(a1) / math.sin(a1 + a2)]
    assert sorted(np.degrees(angles)) == pytest.approx(sorted((right, left)))
    # The ball ends within the momentum of a few steps of that with which it began.
    assert impulse / steps == pytest.approx(expected, abs=BALL_STEPS / steps)


def test_a_block_on_a_belt_slips_until_it_has_the_speed_of_the_belt(block, job_in, flat_on):
    speed, friction = 0.4, 0.25
    unit = math.sqrt(block.hull_radius * 9.81)  # R / T
    job = job_in(block, Slope(0.0), {'floor': {'speed': speed * unit}}, friction=friction)
    placed = flat_on(job, YAWS)
    slip = speed / friction
    step = 1 / job.steps_per_t
    gained = placed.step(slip / 2).velocity[:, 0] / (speed / 2) - 1
    # The friction of the first step acts on a block that does not yet touch the belt.
    assert ((gained > -2 * step / slip) & (gained < FRICTION_EXCESS * step)).all()
    placed.step(slip / 2 * 0.96)
    assert (placed.states.velocity[:, 0] < speed).all()
    end = placed.step(slip * 0.1)
    assert end.velocity[:, 0] == pytest.approx(speed, rel=1e-3)
    assert (placed.settle() == RestStatus.SETTLED).all()


def test_a_block_on_a_belt_that_runs_along_a_wall_rests_relative_to_the_belt(
    block, job_in, flat_on
):
    job = job_in(block, Wall(), {'floor': {'speed': 0.1}}, friction=0.25)
    placed = flat_on(job, YAWS, y=3.0)
    assert (placed.settle() == RestStatus.SETTLED).all()
    assert placed.settling.time.max() < 10


def test_a_block_in_a_chute_leans_at_the_wall(block, job_in, flat_on):
    chute = Chute(roll=math.radians(45))
    job = job_in(block, chute, friction=0.1)
    width = 10 / 1000 / job.radius
    placed = flat_on(job, [0.0], y=width + 0.5)
    assert (placed.settle() == RestStatus.SETTLED).all()
    assert placed.settling.position[0, 1] == pytest.approx(width, abs=3 * 0.001)


def test_a_part_at_rest_settles_although_its_quaternion_changes_sign(block, job_in, flat_on):
    # Bullet returns a quaternion or its negative, which are the same orientation.
    placed = flat_on(job_in(block, Chute()), [0.0], y=3.0)
    at = placed.states
    for k in range(round(WINDOW / CHECK_INTERVAL)):
        seen = dataclasses.replace(at, orientation=at.orientation * (-1) ** (k + 1))
        placed.settling.check((k + 1) * CHECK_INTERVAL, seen)
    assert placed.settling.status[0] == RestStatus.SETTLED
