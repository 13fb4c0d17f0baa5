"""Bodies on slopes, belts and between planes, compared with formulas."""

import math

import numpy as np
import pybullet
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.simulation.surroundings.kinds import Chute, Slope, VGroove, Wall

YAWS = np.radians([0, 20, 45, 70, 90])
# The angle within which a threshold must be right.
NEAR = math.radians(0.3)
FRICTION = 0.5


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
    angle = math.atan(FRICTION) + NEAR
    placed = flat_on(job_in(block, Slope(angle), friction=FRICTION), YAWS)
    excess = math.sin(angle) - FRICTION * math.cos(angle)
    before, after = placed.step(5), placed.step(5)
    assert ((after.velocity - before.velocity)[:, 0] > excess * 5 / 2).all()
    assert (placed.settle() == RestStatus.SLIDING).all()


@pytest.mark.parametrize('degrees', [0, 10])
@pytest.mark.parametrize('friction', [0.25, 0.5])
def test_sliding_distance_downhill(block, job_in, flat_on, degrees, friction):
    angle = math.radians(degrees) + 1e-9
    speed = 0.5
    placed = flat_on(job_in(block, Slope(angle), friction=friction), YAWS, (speed, 0, 0))
    begin = placed.states.position[:, 0]
    expected = speed**2 / 2 / (friction * math.cos(angle) - math.sin(angle))
    distance = placed.step(3 * expected / speed).position[:, 0] - begin
    # Bullet's friction is up to 2 % too strong while a block yaws a little.
    strength = friction * math.cos(angle)
    assert distance == pytest.approx(expected, rel=0.025 * strength / (strength - math.sin(angle)))


def test_friction_acts_against_the_motion_in_any_direction(block, job_in, flat_on):
    # Up, across and down a slope, for the same block and all directions.
    directions = np.radians(np.arange(0, 360, 30))
    angle, friction, speed = math.radians(10), 0.4, 0.5
    velocity = speed * np.stack([np.cos(directions), np.sin(directions), 0 * directions], axis=1)
    placed = flat_on(job_in(block, Slope(angle), friction=friction), 0 * directions, velocity)
    begin = placed.states.position[:, :2]
    moved = placed.step(10).position[:, :2] - begin
    expected = np.array([_path(angle, friction, v) for v in velocity[:, :2]])
    assert (
        np.linalg.norm(moved - expected, axis=1).max()
        < 0.04 * np.linalg.norm(expected, axis=1).max()
    )


def _path(angle, friction, velocity, step=1e-3):
    """The displacement of a point mass with Coulomb friction on a slope until it stops."""
    at, speed = np.zeros(2), np.array(velocity)
    for _ in range(20_000):
        norm = np.linalg.norm(speed)
        if norm < step:
            break
        slowed = -friction * math.cos(angle) * speed / norm
        speed = speed + step * (slowed + np.array([math.sin(angle), 0]))
        at = at + step * speed
    return at


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
            down = (math.sin(tilt), 0, -math.cos(tilt))
            pybullet.setGravity(*down, physicsClientId=placed.world._client)
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
    placed.world._place(placed.bodies[0], [0, 0, height], [0, 0, 0, 1], [0] * 3, [0] * 3)
    totals = []
    client = placed.world._client
    for _ in range(20):
        placed.step(0.5)
        forces = {}
        for point in pybullet.getContactPoints(placed.bodies[0], physicsClientId=client):
            forces[point[2]] = forces.get(point[2], 0) + point[9]
        totals.append([forces.get(k, 0.0) for k in range(2)])
    found = np.mean(totals[10:], axis=0)
    angles = [math.acos(-float(body.normal @ job.scene.down)) for body in job.scene.bodies]
    a1, a2 = angles
    expected = [math.sin(a2) / math.sin(a1 + a2), math.sin(a1) / math.sin(a1 + a2)]
    assert sorted(np.degrees(angles)) == pytest.approx(sorted((right, left)))
    assert found == pytest.approx(expected, rel=0.02)


def test_a_block_on_a_belt_slips_until_it_has_the_speed_of_the_belt(block, job_in, flat_on):
    speed, friction = 0.4, 0.25
    unit = math.sqrt(block.hull_radius * 9.81)  # R / T
    job = job_in(block, Slope(0.0), {'floor': {'speed': speed * unit}}, friction=friction)
    placed = flat_on(job, YAWS)
    slip = speed / friction
    middle = placed.step(slip / 2).velocity
    assert middle[:, 0] == pytest.approx(speed / 2, rel=0.03)
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
