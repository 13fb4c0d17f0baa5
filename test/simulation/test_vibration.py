"""Vibration of the plate: conveying, derivatives, lost parts, and bit-identical repetition."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation.actions import MAX_ACCELERATION, RAMP_PERIODS, Vibration
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.release import initial_states
from resting_aspects_ros.simulation.starts import rest_starts
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.poses import RestStatus

GRAVITY = 9.81
STRONG = Vibration(
    frequency=25.0,
    duration=0.44,
    plate_size=0.3,
    vertical_amplitude=2e-3,
    horizontal_amplitude=5e-4,
    horizontal_phase=0.7,
    rocking_x=1e-3,
    rocking_y=5e-4,
)


def vibration_job(part, conditions, vibration, **options):
    starts = rest_starts(part, find_aspects(part).aspects, vibration, conditions)
    return make_job(part, conditions, 1, starts=starts, **options)


# -- Motion of the plate --------------------------------------------------------------------------


def test_velocity_is_the_derivative_of_the_pose():
    plate = dataclasses.replace(STRONG, rocking_phase=0.4)
    time, step = np.linspace(0, plate.duration, 300), 1e-4 / plate.frequency
    (before, one), (after, other) = (plate.pose(time + late) for late in (-step, step))
    velocity, spin = plate.velocity(time)
    turn = (Rotation.from_quat(other) * Rotation.from_quat(one).inv()).as_rotvec()
    np.testing.assert_allclose((after - before) / (2 * step), velocity, atol=1e-6)
    np.testing.assert_allclose(turn / (2 * step), spin, atol=1e-6)


def test_motion_begins_and_ends_at_rest_and_has_its_amplitudes():
    time = np.array([-1.0, 0.0, STRONG.duration, STRONG.duration + 1])
    position, orientation = STRONG.pose(time)
    np.testing.assert_array_equal(position, 0)
    np.testing.assert_array_equal(orientation, [[0, 0, 0, 1]] * 4)
    np.testing.assert_array_equal(STRONG.velocity(time), np.zeros((2, 4, 3)))
    ramp = RAMP_PERIODS / STRONG.frequency
    position, orientation = STRONG.pose(np.linspace(ramp, STRONG.duration - ramp, 4001))
    assert np.abs(position).max(axis=0) == pytest.approx([5e-4, 0, 2e-3], rel=1e-5)
    turn = Rotation.from_quat(orientation).as_rotvec()
    assert np.abs(turn).max(axis=0) == pytest.approx([1e-3, 5e-4, 0], rel=1e-5)


# -- A block on the plate -------------------------------------------------------------------------


def point_mass(vibration, friction, step=4e-6):
    """How far a plate conveys a point mass, m.

    It does not bounce; friction has the limit of Coulomb, also while the point mass lands.
    """
    times = np.arange(0, vibration.duration + 0.2, step)
    plate, _ = vibration.pose(times)
    velocity, _ = vibration.velocity(times)
    (_, _, pz), (vx, _, vz) = plate.T.tolist(), velocity.T.tolist()
    x = z = u = w = 0.0
    for ahead in range(1, len(times)):
        x, z, w = x + u * step, z + w * step, w - GRAVITY * step
        if z <= pz[ahead]:  # on the plate at the end of the step
            impulse = max(0.0, vz[ahead] - w)
            z, w = pz[ahead], vz[ahead]
            slip = vx[ahead] - u
            u += math.copysign(min(abs(slip), friction * impulse), slip)
    return x


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('amplitude', 'phase'), [(0.9, 2.5), (1.5, 1.0)])
def test_plate_conveys_a_block_as_far_as_a_point_mass(solid, mat, amplitude, phase):
    """With vertical accelerations below and above g, and a horizontal one above friction."""
    frequency, friction, n = 25.0, 0.3, 8
    square = (2 * math.pi * frequency) ** 2
    plate = Vibration(
        frequency,
        0.6,
        1.0,
        vertical_amplitude=amplitude * GRAVITY / square,
        horizontal_amplitude=0.8 * GRAVITY / square,
        horizontal_phase=phase,
        rocking_x=1e-5,
    )
    # So low that friction does not tilt it.
    flat = solid(trimesh.creation.box((30, 30, 2)))
    given = mat.changed(restitution=0.0, friction=friction, rolling_friction=0.0, gravity=GRAVITY)
    starts = rest_starts(flat, find_aspects(flat).aspects[:1], plate, given)
    # With the steps of runs, the conveyed distance is up to 8 % off.
    job = make_job(flat, given, 1, starts=starts, refinement=4)
    poses = drop_range(job, 0, n)
    assert (poses.status == RestStatus.SETTLED).all()
    centre = poses.position + rotate(poses.orientation, flat.centre_of_mass)
    moved = centre - initial_states(job, 0, n).position * job.radius
    expected = point_mass(plate, friction)
    assert abs(expected) > 1e-4
    assert moved[:, 0] == pytest.approx(expected, rel=0.03, abs=3e-5)
    assert np.abs(moved[:, 1]).max() < 0.02 * abs(expected) + 2e-5


# -- Transitions ----------------------------------------------------------------------------------


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('engine', [KERNEL, BULLET])
def test_actions_do_not_depend_on_other_actions(part, mat, assert_same_poses, engine):
    short = dataclasses.replace(STRONG, frequency=50.0, duration=0.2, plate_size=0.06)
    job = vibration_job(part('l_bracket'), mat, short, engine=engine)
    whole = drop_range(job, 0, 12)
    assert len(np.unique(whole.status)) == 2  # some are lost
    for first, end in [(9, 12), (0, 1), (3, 10), (5, 6)]:
        assert_same_poses(drop_range(job, first, end), whole.between(first, end))


@pytest.mark.parametrize(('engine', 'n'), [(KERNEL, 200), (BULLET, 25)])
def test_lost_parts_left_the_plate(part, mat, engine, n):
    shape = part('l_bracket')
    # While the plate moves along, its edge does, too.
    small = dataclasses.replace(STRONG, plate_size=0.05, horizontal_amplitude=0.0)
    poses = drop_range(vibration_job(shape, mat, small, engine=engine), 0, n)
    centre = poses.position + rotate(poses.orientation, shape.centre_of_mass)
    beyond = np.abs(centre[:, :2]).max(axis=1) - 0.05 / 2
    lost = poses.status == RestStatus.LOST
    assert beyond[lost].min() > -1e-4  # it tilts
    assert beyond[~lost].max() < 0
    assert n / 8 < lost.sum() < n
    assert (poses.status[~lost] == RestStatus.SETTLED).all()


# -- Values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'duration': 0.39}, 'invalid duration 0.39: expected at least 0.4 s, two ramps of 5'),
        ({'rocking_x': 5e-6, 'rocking_y': 0}, 'invalid rocking 5e-06: expected rocking_x or'),
        (
            {'vertical_amplitude': 0.05},
            rf'invalid acceleration 12\d\d m/s2 of the plate.* at most {MAX_ACCELERATION:g} m/s2',
        ),
    ],
)
def test_invalid_vibration_is_rejected(changes, expected):
    with pytest.raises(InvalidValueError, match='^' + expected):
        dataclasses.replace(STRONG, **changes)


def test_too_long_vibration_of_a_part_is_rejected(part, mat):
    endless = dataclasses.replace(STRONG, duration=3600.0)
    with pytest.raises(InvalidValueError, match='invalid duration 3600 s: expected at most'):
        vibration_job(part('l_bracket'), mat, endless)
