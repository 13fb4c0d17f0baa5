"""Vibration of the plate: hops, derivatives, lost parts, and bit-identical repetition."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, chi2_contingency, kstest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation import job as drop_job
from resting_aspects_ros.simulation.actions import (
    MAX_ACCELERATION,
    RAMP_PERIODS,
    Actions,
    Vibration,
)
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.release import initial_states
from resting_aspects_ros.simulation.starts import Action, rest_starts
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import aspect_ids
from resting_aspects_ros.statistics.poses import RestStatus
from resting_aspects_ros.system import config_folder

# A test of chance fails a right engine for one seed in a thousand; the seeds are fixed.
LEVEL = 1e-3
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

amplitudes = st.floats(0, 1e-6)
phases = st.floats(-6, 6)
plates = st.builds(
    Vibration,
    frequency=st.floats(5, 200),
    duration=st.just(2.0),
    plate_size=st.just(1e-3),
    vertical_amplitude=amplitudes,
    horizontal_amplitude=amplitudes,
    horizontal_phase=phases,
    rocking_x=st.floats(1e-5, 0.05),
    rocking_y=st.floats(0, 0.05),
    rocking_phase=phases,
)


@given(plates, st.floats(0, 2))
def test_velocity_is_the_derivative_of_the_pose(plate, time):
    step = 1e-4 / plate.frequency
    (before, after), turned = plate.pose(np.array([time - step, time + step]))
    velocity, spin = plate.velocity(np.array([time]))
    one, other = Rotation.from_quat(turned)
    turn = (other * one.inv()).as_rotvec() / (2 * step)
    fastest = 2 * math.pi * plate.frequency
    np.testing.assert_allclose((after - before) / (2 * step), velocity[0], atol=1e-9 * fastest)
    np.testing.assert_allclose(turn, spin[0], atol=1e-6 * fastest)


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


def test_acceleration_of_ramps_hardly_exceeds_that_of_the_sine():
    plate = Vibration(1.0, 20.0, 0.1, vertical_amplitude=1e-3, rocking_x=1e-5)
    time = np.linspace(0, 20, 200_001)
    acceleration = np.diff(plate.velocity(time)[0][:, 2]) / np.diff(time)
    assert np.abs(acceleration).max() < 1.003 * 1e-3 * (2 * math.pi) ** 2


# -- A block on the plate -------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Push(Action):
    """Parts at places along x, which all start with the same velocity, m/s."""

    places: np.ndarray
    plate: Vibration
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def motion(self):
        return self.plate

    def max_speed(self, at):
        return 1.0

    def applied(self, states, row, at, random):
        at = np.zeros((len(row), 3))
        at[:, 0] = self.places
        return dataclasses.replace(states, position=at, velocity=at * 0 + self.velocity)


def pushed(part, conditions, push):
    """The job of parts in their first aspect, whose yaw is random, and their poses at the end."""
    # With the steps of runs, the conveyed distance of a block is up to 8 % off.
    given = conditions.changed(gravity=GRAVITY)
    starts = rest_starts(part, find_aspects(part).aspects[:1], push, given)
    job = make_job(part, given, 1, starts=starts, refinement=4)
    return job, drop_range(job, 0, len(push.places))


def point_mass(vibration, friction, until, step=4e-6):
    """Horizontal and vertical places (k,) of a point mass on the plate, at times (k,), m and s.

    It does not bounce; friction has the limit of Coulomb, also while the point mass lands.
    """
    times = np.arange(0, until, step)
    plate, _ = vibration.pose(times)
    velocity, _ = vibration.velocity(times)
    (px, _, pz), (vx, _, vz) = plate.T.tolist(), velocity.T.tolist()
    x = z = u = w = 0.0
    found = np.empty((len(times), 2))
    for k in range(len(times)):
        found[k] = x, z
        ahead = min(k + 1, len(times) - 1)
        x, z, w = x + u * step, z + w * step, w - GRAVITY * step
        if z <= pz[ahead]:  # on the plate at the end of the step
            impulse = max(0.0, vz[ahead] - w)
            z, w = pz[ahead], vz[ahead]
            slip = vx[ahead] - u
            u += math.copysign(min(abs(slip), friction * impulse), slip)
    return times, found - np.array([px, pz]).T


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('ratio', [0.98, 1.05, 2.0])
def test_block_hops_if_the_plate_accelerates_by_more_than_g(part, mat, ratio):
    # Without friction, blocks glide off the plate at different times; a lost part is where it was.
    frequency, speed, size = 20.0, 0.5, 0.4
    amplitude = ratio * GRAVITY / (2 * math.pi * frequency) ** 2
    plate = Vibration(
        frequency, 13 / frequency, size, vertical_amplitude=amplitude, rocking_x=1e-5
    )
    frictionless = mat.changed(restitution=0.0, friction=0.0, rolling_friction=0.0)
    places = np.linspace(-0.1, 0.19, 60)
    job, poses = pushed(part('box_10x20x30'), frictionless, Push(places, plate, (speed, 0, 0)))
    assert (poses.status == RestStatus.LOST).all()
    time = poses.time_to_rest
    assert time.max() > 0.45
    assert time.min() < 0.1
    centre = poses.position + rotate(poses.orientation, part('box_10x20x30').centre_of_mass)
    assert centre[:, 0] == pytest.approx(places + speed * time, abs=1e-9)
    height = centre[:, 2] - job.min_height * job.radius - plate.pose(time)[0][:, 2]
    times, expected = point_mass(plate, 0.0, 0.65)
    expected = np.interp(time, times, expected[:, 1])
    if ratio < 1:
        # The plate moves by more than 300 um; it tilts by less than 2 um where the blocks are.
        assert np.abs(height).max() < 4e-6
    else:
        assert expected.max() > 5e-6
        assert np.abs(height - expected).max() < 0.03 * expected.max() + 4e-6


@pytest.mark.slow
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
    inelastic = mat.changed(restitution=0.0, friction=friction, rolling_friction=0.0)
    _, poses = pushed(flat, inelastic, Push(np.zeros(n), plate))
    assert (poses.status == RestStatus.SETTLED).all()
    centre = poses.position + rotate(poses.orientation, flat.centre_of_mass)
    _, expected = point_mass(plate, friction, 0.8)
    expected = expected[-1, 0]
    assert abs(expected) > 1e-4
    assert centre[:, 0] == pytest.approx(expected, rel=0.03, abs=3e-5)
    assert np.abs(centre[:, 1]).max() < 0.02 * abs(expected) + 2e-5


def test_part_rides_on_a_plate_that_moves_gently(part, mat):
    # Less than friction and gravity can hold: 0.15 g along, 0.3 g up and down, and as much tilt.
    square = (2 * math.pi * 20.0) ** 2
    gentle = Vibration(
        frequency=20.0,
        duration=0.5,
        plate_size=0.2,
        vertical_amplitude=0.3 * GRAVITY / square,
        horizontal_amplitude=0.15 * GRAVITY / square,
        horizontal_phase=1.0,
        rocking_x=5e-4,
        rocking_y=2e-4,
        rocking_phase=0.5,
    )
    shape, places = part('box_10x20x30'), np.linspace(-0.05, 0.05, 9)
    job, poses = pushed(shape, mat.changed(restitution=0.0, friction=0.4), Push(places, gentle))
    assert (poses.status == RestStatus.SETTLED).all()
    centre = poses.position + rotate(poses.orientation, shape.centre_of_mass)
    # The plate moves by 190 um along, by 370 um up and down, and by 50 um where it tilts.
    assert np.abs(centre[:, 0] - places).max() < 2e-6
    assert np.abs(centre[:, 1]).max() < 2e-6
    before = initial_states(job, 0, len(places)).orientation
    turned = Rotation.from_quat(poses.orientation) * Rotation.from_quat(job.axes)
    assert (turned * Rotation.from_quat(before).inv()).magnitude().max() < 1e-4


# -- Transitions ----------------------------------------------------------------------------------


def test_parts_start_at_uniform_places_of_the_plate(part, mat):
    job = vibration_job(part('l_bracket'), mat, STRONG)
    n = 5000
    states = initial_states(job, 0, n)
    place = states.position[:, :2] * job.radius / STRONG.plate_size
    assert np.abs(place).max() <= 0.5
    for along in place.T:
        assert kstest(along, 'uniform', args=(-0.5, 1)).pvalue > LEVEL
    assert not states.velocity.any()
    assert not states.spin.any()


@pytest.mark.slow
def test_finer_steps_keep_the_transitions(part, mat):
    shape, n = part('l_bracket'), 1000
    starts, counts = np.arange(n) % 5, []
    for refinement in (1, 4):
        poses = drop_range(vibration_job(shape, mat, STRONG, refinement=refinement), 0, n)
        counts.append(np.zeros((5, 6)))
        np.add.at(counts[-1], (starts, aspect_ids(find_aspects(shape), poses)), 1)
    # Each start aspect is compared; the parts that were lost are the first column.
    found = [chi2_contingency(rows[:, rows.sum(axis=0) > 0]) for rows in np.stack(counts, axis=1)]
    freedom = sum(each.dof for each in found)
    assert chi2.sf(sum(each.statistic for each in found), freedom) > LEVEL


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
        ({'duration': '20mm'}, "invalid duration '20mm': expected a number, in s or with one of "),
        ({'duration': 0.39}, 'invalid duration 0.39: expected at least 0.4 s, two ramps of 5'),
        ({'rocking_x': 5e-6, 'rocking_y': 0}, 'invalid rocking 5e-06: expected rocking_x or'),
        (
            {'vertical_amplitude': 0.05},
            rf'invalid acceleration 12\d\d m/s2 of the plate.* at most {MAX_ACCELERATION:g} m/s2',
        ),
        ({'plate_size': 100.0}, r'invalid acceleration 20\d\d m/s2 of the plate'),
    ],
)
def test_invalid_vibration_is_rejected(changes, expected):
    with pytest.raises(InvalidValueError, match='^' + expected):
        dataclasses.replace(STRONG, **changes)


def test_too_long_or_too_fast_vibration_of_a_part_is_rejected(part, mat):
    shape = part('l_bracket')
    endless = dataclasses.replace(STRONG, duration=3600.0)
    step = min(vibration_job(shape, mat, STRONG).time_step, STRONG.time_step)
    longest = drop_job.MAX_MOTION_STEPS * step
    expected = f'^invalid duration 3600 s: expected at most {longest:.4g} s for this part, which'
    with pytest.raises(InvalidValueError, match=expected):
        vibration_job(shape, mat, endless)
    wild = Vibration(0.5, 20.0, 0.1, vertical_amplitude=0.1, rocking_x=1e-5)
    with pytest.raises(InvalidValueError, match=r'^invalid impact speed '):
        vibration_job(shape, mat.changed(gravity=1e-5), wild)


def test_shipped_vibrations_fit_the_example_parts(part, mat):
    known = Actions(config_folder() / 'actions.yaml')
    shipped = [known.get(name) for name in known.names()]
    vibrations = [each for each in shipped if isinstance(each.action, Vibration)]
    assert len(vibrations) >= 2
    for each in vibrations:
        assert each.source
        assert each.time > each.action.duration
        assert vibration_job(part('l_bracket'), mat, each.action).in_motion(0.0)
