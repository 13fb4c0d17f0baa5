"""Bodies on slopes, belts and between planes in the kernel, compared with formulas."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from placed_bodies import flat_on, groove_height, in_groove, point_path
from scipy.spatial.transform import Rotation

from resting_aspects_ros.simulation.conditions import BULLET
from resting_aspects_ros.simulation.job import CONTACT_STEPS
from resting_aspects_ros.simulation.kernel import RESIDUAL
from resting_aspects_ros.simulation.release import InitialState
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL, WINDOW, SceneSettling
from resting_aspects_ros.simulation.starts import States
from resting_aspects_ros.simulation.surroundings_kinds import Chute, Corner, Slope, VGroove
from resting_aspects_ros.statistics.poses import RestStatus

YAWS = np.radians([0, 20, 45, 70, 90])
# The angle within which a threshold must be right.
NEAR = math.radians(0.3)
FRICTION = 0.5
# A slide ends within the last time step, T.
STEP = 1 / CONTACT_STEPS


@pytest.fixture(scope='module')
def block(solid):
    return solid(trimesh.creation.box((30, 20, 10)))


@pytest.fixture(scope='module')
def roller(solid):
    """A cylinder along x with a number of sides."""

    def make(sides):
        mesh = trimesh.creation.cylinder(5, 40, sections=sides)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, [0, 1, 0]))
        return solid(mesh)

    return make


# -- Slopes ---------------------------------------------------------------------------------------


def test_a_block_stays_on_a_slope_below_the_friction_angle(block, job_in):
    job = job_in(block, Slope(math.atan(FRICTION) - NEAR), friction=FRICTION)
    placed = flat_on(job, YAWS)
    before = placed.states.position
    assert (placed.settle() == RestStatus.SETTLED).all()
    assert np.abs(placed.states.position - before).max() < 2e-4


def test_a_block_slides_on_a_slope_above_the_friction_angle(block, job_in):
    angle = math.atan(FRICTION) + NEAR
    placed = flat_on(job_in(block, Slope(angle), friction=FRICTION), YAWS)
    expected = math.sin(angle) - FRICTION * math.cos(angle)
    gained = placed.run(5).velocity[:, 0]
    assert np.abs(gained - expected * placed.time).max() < 1e-4 * placed.time[0]
    assert (placed.settle() == RestStatus.SLIDING).all()


def test_friction_acts_against_the_motion_in_any_direction(block, job_in):
    # Up, across and down a slope, for the same block and all directions.
    directions = np.radians(np.arange(0, 360, 30))
    angle, friction, speed = math.radians(10), 0.4, 0.5
    velocity = speed * np.stack([np.cos(directions), np.sin(directions), 0 * directions], axis=1)
    placed = flat_on(job_in(block, Slope(angle), friction=friction), 0 * directions, velocity)
    placed.settle()
    expected = np.array([point_path(angle, friction, v[:2]) for v in velocity])
    assert np.abs(placed.states.position[:, :2] - expected).max() < speed * STEP / 4


@pytest.mark.parametrize(('yaw', 'width'), [(0, 10), (90, 15)])
def test_a_block_tips_where_its_centre_of_mass_is_beyond_its_edge(solid, job_in, yaw, width):
    column = solid(trimesh.creation.box((10, 15, 30)))
    limit = math.atan(width / 30)
    for angle, falls in ((limit - NEAR, False), (limit + NEAR, True)):
        placed = flat_on(job_in(column, Slope(1e-9), friction=2.0), [math.radians(yaw)])
        before = Rotation.from_quat(placed.states.orientation)
        placed.tilt(angle)
        placed.settle()
        turned = Rotation.from_quat(placed.states.orientation) * before.inv()
        assert (turned.magnitude()[0] > 0.5) == falls, math.degrees(angle)


# -- Grooves and walls ----------------------------------------------------------------------------


@pytest.mark.parametrize(('right', 'left'), [(30, 60), (20, 50)])
@pytest.mark.parametrize('rough', ['right', 'left'])
def test_a_roller_that_slides_along_a_groove_feels_the_normal_force(
    roller, job_in, right, left, rough
):
    # In the scene frame both planes of a groove are equally steep; the roll makes the difference.
    b1, b2 = np.radians([right, left])
    groove = VGroove(math.pi - b1 - b2, roll=(b2 - b1) / 2)
    job = job_in(roller(64), groove, {rough: {'friction': 0.1}}, friction=0.0)
    assert job.scene.half_spaces[0].name == 'right'
    angles = [math.acos(-float(plane.normal @ job.scene.down)) for plane in job.scene.half_spaces]
    height = 5e-3 / job.radius / math.sin(groove.opening / 2)
    placed = flat_on(job, [0.0], (1.0, 0, 0))
    placed.states.position[:, 2] = height
    lost = 1 - placed.run(4).velocity[0, 0]
    other = angles[1 if rough == 'right' else 0]
    assert lost == pytest.approx(
        0.1 * math.sin(other) / math.sin(sum(angles)) * placed.time[0], rel=1e-3
    )


def test_a_box_in_a_groove_rests_at_minima_of_its_potential_energy(solid, job_in):
    bar = solid(trimesh.creation.box((40, 12, 8)))
    job = job_in(bar, VGroove(math.radians(120)), friction=0.02)
    corners = np.array([[y, z] for y in (-6, 6) for z in (-4, 4)]) / 1000 / job.radius
    # Friction holds it upside down only within 2.1 degrees.
    placed = in_groove(job, np.radians(np.arange(-180, 180, 6) + 3.0), corners)
    assert (placed.settle() == RestStatus.SETTLED).all()
    matrices = Rotation.from_quat(placed.states.orientation) * Rotation.from_quat(job.axes).inv()
    found = matrices.as_euler('xyz')[:, 0]
    # The height of the centre of mass where a box that is turned by a roll touches both planes. A
    # side lies on one of the planes, which are inclined by 30 degrees.
    grid = np.radians(np.arange(0, 360, 0.05))
    height = groove_height(job, grid, corners)
    least = grid[(height < np.roll(height, 1)) & (height < np.roll(height, -1))]
    assert np.abs((np.degrees(least) - 30 + 15) % 30 - 15).max() < 0.06
    apart = np.abs((found[:, None] - least + math.pi) % (2 * math.pi) - math.pi).min(axis=1)
    assert apart.max() < 2e-3
    assert placed.states.position[:, 2] == pytest.approx(
        groove_height(job, found, corners), abs=1e-4
    )


# -- Belts ----------------------------------------------------------------------------------------


def test_a_block_on_a_belt_slips_until_it_has_the_speed_of_the_belt(block, job_in):
    speed, friction = 0.4, 0.25
    unit = math.sqrt(block.hull_radius * 9.81)  # R / T
    job = job_in(block, Slope(0.0), {'floor': {'speed': speed * unit}}, friction=friction)
    placed = flat_on(job, YAWS)
    gained = placed.run(0.5).velocity[:, 0]
    assert gained == pytest.approx(friction * placed.time, abs=10 * RESIDUAL)
    end = placed.run(speed / friction)
    assert end.velocity[:, 0] == pytest.approx(speed, abs=10 * RESIDUAL)
    assert (placed.settle() == RestStatus.SETTLED).all()


def test_a_belt_that_runs_into_a_wall_slips_below_a_part_at_rest(block, job_in):
    release = {'x_min': -0.05, 'x_max': -0.05, 'y_min': 0.05, 'y_max': 0.05}
    job = job_in(block, Corner(), {'floor': {'speed': 0.1}}, release, friction=0.25)
    placed = flat_on(job, [0.0], x=-2.0, y=3.0)
    assert (placed.settle() == RestStatus.SETTLED).all()
    half = 15 / 1000 / job.radius
    assert placed.states.position[0, 0] == pytest.approx(-half, abs=1e-4)
    assert np.abs(placed.states.velocity).max() < 1e-3


# -- Stillness in Bullet --------------------------------------------------------------------------


def test_a_part_at_rest_settles_although_its_quaternion_changes_sign(block, job_in):
    # Bullet returns a quaternion or its negative, which are the same orientation.
    turn, none = np.array([[0.5, 0.5, 0.5, 0.5]]), np.zeros((1, 3))
    at = States(np.array([[0.0, 3, 1]]), turn, none, none)
    start = InitialState(at.position, turn, none, none, np.zeros(1))
    settling = SceneSettling(job_in(block, Chute(), engine=BULLET), start)
    for k in range(1, round(WINDOW / CHECK_INTERVAL) + 1):
        settling.check(k * CHECK_INTERVAL, dataclasses.replace(at, orientation=turn * (-1) ** k))
    assert settling.status[0] == RestStatus.SETTLED
