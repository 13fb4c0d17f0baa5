"""Vibration of the plate: hops, derivatives, lost parts, and bit-identical repetition."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.stats import chi2_contingency

from resting_aspects_ros.api.transition_counter import TransitionCounter
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.reorientation.transition_matrix import no_actions
from resting_aspects_ros.core.rotations import rotate
from resting_aspects_ros.core.statistics.distribution import aspect_ids
from resting_aspects_ros.simulation import bullet_world, drop_job, initial_state, settling
from resting_aspects_ros.simulation.actions import Actions
from resting_aspects_ros.simulation.config_files import actions_file
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.plan import make_job, plan_run
from resting_aspects_ros.simulation.reorientation import action_starts
from resting_aspects_ros.simulation.vibration import (
    MAX_ACCELERATION,
    RAMP_PERIODS,
    STEPS_PER_PERIOD,
    Vibration,
)

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


def vibration_job(part, conditions, vibration, seed=1, aspects=None, **options):
    chosen = find_aspects(part).aspects[:aspects]
    starts = action_starts(part, chosen, vibration, conditions.gravity)
    return make_job(part, conditions, seed, starts=starts, **options)


# -- Motion of the plate --------------------------------------------------------------------------

amplitudes = st.floats(0, 1e-3)
phases = st.floats(-6, 6)


@given(
    st.floats(5, 200),
    st.floats(10, 30),
    st.tuples(amplitudes, amplitudes, st.floats(1e-5, 0.05), st.floats(0, 0.05)),
    st.tuples(phases, phases),
    st.floats(0, 1),
)
def test_velocity_is_the_derivative_of_the_pose(frequency, periods, sizes, phase, moment):
    vertical, horizontal, rocking_x, rocking_y = sizes
    duration = periods / frequency
    plate = Vibration(
        frequency=frequency,
        duration=duration,
        plate_size=1e-3,
        vertical_amplitude=vertical / 1e3,
        horizontal_amplitude=horizontal / 1e3,
        horizontal_phase=phase[0],
        rocking_x=rocking_x,
        rocking_y=rocking_y,
        rocking_phase=phase[1],
    )
    step = 1e-4 / frequency
    time = moment * duration
    (before, after), turned = plate.pose(np.array([time - step, time + step]))
    velocity, spin = plate.velocity(np.array([time]))
    one, other = Rotation.from_quat(turned)
    turn = (other * one.inv()).as_rotvec() / (2 * step)
    fastest = 2 * math.pi * frequency
    np.testing.assert_allclose((after - before) / (2 * step), velocity[0], atol=1e-9 * fastest)
    np.testing.assert_allclose(turn, spin[0], atol=1e-6 * fastest)


def test_motion_begins_and_ends_at_rest_in_the_tray_frame():
    time = np.array([-1.0, 0.0, STRONG.duration, STRONG.duration + 1])
    position, orientation = STRONG.pose(time)
    np.testing.assert_array_equal(position, 0)
    np.testing.assert_array_equal(orientation, [[0, 0, 0, 1]] * 4)
    for values in STRONG.velocity(time):
        np.testing.assert_array_equal(values, 0)


def test_amplitudes_are_reached_between_the_ramps():
    ramp = RAMP_PERIODS / STRONG.frequency
    time = np.linspace(ramp, STRONG.duration - ramp, 4001)
    position, orientation = STRONG.pose(time)
    assert np.abs(position).max(axis=0) == pytest.approx([5e-4, 0, 2e-3], rel=1e-5)
    turn = Rotation.from_quat(orientation).as_rotvec()
    assert np.abs(turn).max(axis=0) == pytest.approx([1e-3, 5e-4, 0], rel=1e-5)


def test_acceleration_of_ramps_hardly_exceeds_that_of_the_sine():
    plate = Vibration(1.0, 20.0, 0.1, vertical_amplitude=1e-3, rocking_x=1e-5)
    time = np.linspace(0, 20, 200_001)
    acceleration = np.diff(plate.velocity(time)[0][:, 2]) / np.diff(time)
    assert np.abs(acceleration).max() < 1.003 * 1e-3 * (2 * math.pi) ** 2


# -- A block on the plate -------------------------------------------------------------------------


def riding(part, conditions, vibration, slots=1):
    """Positions of centres of mass and orientations on the plate, each eighth step, in m."""
    job = vibration_job(part, conditions, vibration, aspects=1)
    world = bullet_world.World(job)
    which, origins = np.arange(slots), np.zeros((slots, 3))
    bodies = world._add(initial_state.initial_states(job, 0), which, origins)
    places, turns, made = [], [], 0
    while job.in_motion(made / job.steps_per_t):
        world._advance(made, 8)
        made += 8
        seen = world._states(bodies, origins, which)
        at, turned = vibration.pose(np.array([made * job.time_step]))
        back = Rotation.from_quat(turned[0]).inv()
        places.append(back.apply(seen.position * job.radius - at))
        turns.append((back * Rotation.from_quat(seen.orientation)).as_quat())
    return np.array(places), np.array(turns)


def hop_height(amplitude, frequency):
    """How high above the plate a point flies that leaves it where it accelerates by -g, m."""
    rate = 2 * math.pi * frequency
    start = math.asin(GRAVITY / (amplitude * rate**2)) / rate

    def above(t):
        flight = amplitude * (math.sin(rate * start) + rate * math.cos(rate * start) * t)
        return flight - GRAVITY * t**2 / 2 - amplitude * math.sin(rate * (start + t))

    landing = brentq(above, 1e-2 / frequency, 1.0 / frequency)
    return max(above(t) for t in np.linspace(0, landing, 1000))


@pytest.mark.parametrize('ratio', [0.5, 0.98, 1.05, 1.3])
def test_block_hops_if_the_plate_accelerates_by_more_than_g(part, mat, ratio):
    frequency = 20.0
    amplitude = ratio * GRAVITY / (2 * math.pi * frequency) ** 2
    places, _ = riding(
        part('box_10x20x30'),
        mat.changed(restitution=0.0, gravity=GRAVITY),
        Vibration(frequency, 13 / frequency, 0.1, vertical_amplitude=amplitude, rocking_x=1e-5),
    )
    height = places[:, 0, 2] - places[0, 0, 2]
    if ratio < 1:
        # It sinks into its contact by a part of Bullet's margin; the plate moves 300 times as far.
        assert np.abs(height).max() < 1e-6
    else:
        assert height.max() == pytest.approx(hop_height(amplitude, frequency), rel=0.02, abs=5e-7)


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
    places, turns = riding(
        part('box_10x20x30'), mat.changed(restitution=0.0, friction=0.4), gentle, slots=3
    )
    # The plate moves by 190 um along, by 370 um up and down, and by 50 um where it tilts.
    assert np.ptp(places, axis=0).max() < 1e-6
    # A part that did not turn with the plate would turn against it by 5e-4 (a component of a
    # quaternion is half of the angle, to both sides). It creeps by at most a fifth of that: the
    # solver stops at changes of the speed of 1e-4 R / T.
    assert np.ptp(turns, axis=0).max() < 1e-4


def test_part_slips_on_a_plate_that_moves_faster_than_friction(part, mat):
    amplitude = 0.4 * GRAVITY / (2 * math.pi * 20.0) ** 2
    plate = Vibration(20.0, 0.5, 0.2, horizontal_amplitude=amplitude, rocking_x=1e-5)
    places, _ = riding(part('box_10x20x30'), mat.changed(friction=0.2), plate)
    assert np.ptp(places[:, 0, 0]) > 0.2 * amplitude
    assert np.ptp(places[:, 0, 1]) < 1e-3 * amplitude


# -- Transitions ----------------------------------------------------------------------------------


def test_parts_start_at_uniform_places_of_the_plate(part, mat):
    job = vibration_job(part('l_bracket'), mat, STRONG)
    states = initial_state.initial_states(job, 3)
    place = states.position[:, :2] * job.radius / STRONG.plate_size
    assert np.abs(place).max() <= 0.5
    # Four standard errors of the mean and of the mean square of a uniform number.
    assert np.abs(place.mean(axis=0)).max() < 4 / math.sqrt(12 * CHUNK)
    assert np.abs((place**2).mean(axis=0) - 1 / 12).max() < 4 * math.sqrt(1 / 180 / CHUNK)
    assert not states.velocity.any()
    assert not states.spin.any()


def test_weak_vibration_leaves_parts_in_their_aspect(part, mat):
    shape = part('l_bracket')
    weak = dataclasses.replace(STRONG, vertical_amplitude=2e-4, horizontal_amplitude=0.0)
    poses = drop_range(vibration_job(shape, mat, weak), 0, 10)
    assert aspect_ids(find_aspects(shape), poses).tolist() == [1, 2, 3, 4, 5] * 2
    assert (poses.time_to_rest >= weak.duration).all()
    assert (poses.energy_growth < 0.01).all()


@pytest.mark.slow
@pytest.mark.parametrize('chunks', [1, 16])
def test_half_the_time_step_keeps_the_transitions(part, mat, chunks):
    shape = part('l_bracket')
    counts = []
    for refinement in (1, 2):
        job = vibration_job(shape, mat, STRONG, refinement=refinement)
        poses = RestingPoses.join(
            [drop_range(job, k * CHUNK, (k + 1) * CHUNK) for k in range(chunks)]
        )
        counts.append(np.bincount(aspect_ids(find_aspects(shape), poses), minlength=6))
    assert min(counts[0]) > 0  # the parts that were lost are the first column
    assert chi2_contingency(counts).pvalue > LEVEL


def test_actions_do_not_depend_on_other_actions(part, mat, assert_same_poses):
    short = dataclasses.replace(STRONG, frequency=50.0, duration=0.2, plate_size=0.06)
    job = vibration_job(part('l_bracket'), mat, short)
    whole = drop_range(job, 0, 12)
    assert len(np.unique(whole.status)) == 2  # some are lost
    for first, end in [(9, 12), (0, 1), (3, 10), (5, 6)]:
        assert_same_poses(drop_range(job, first, end), whole.between(first, end))


def test_lost_parts_left_the_plate_and_are_counted(part, mat):
    shape = part('l_bracket')
    # While the plate moves along, its edge does, too.
    small = dataclasses.replace(STRONG, plate_size=0.05, horizontal_amplitude=0.0)
    aspects = find_aspects(shape)
    starts = action_starts(shape, aspects.aspects, small, mat.gravity)
    job, run = plan_run(shape, mat, seed=1, drops=25, run_id='', started=0, starts=starts)
    poses = drop_range(job, 0, 25)
    centre = poses.position + rotate(poses.orientation, shape.centre_of_mass)
    beyond = np.abs(centre[:, :2]).max(axis=1) - 0.05 / 2
    lost = poses.status == RestStatus.LOST
    assert beyond[lost].min() > -1e-4  # it tilts
    assert beyond[~lost].max() < 0
    assert 3 < lost.sum() < 25
    assert (poses.status[~lost] == RestStatus.SETTLED).all()
    counter = TransitionCounter(no_actions(aspects), run, 0.0)
    counter.count(poses)
    assert counter.matrix.counts[:, -1].sum() == lost.sum()
    assert counter.matrix.actions.tolist() == [5] * 5


# -- While the plate moves ------------------------------------------------------------------------


@pytest.fixture
def resting(part, mat):
    """The ends of four parts on a plate, and their states at rest before any check."""
    job = vibration_job(part('l_bracket'), mat, STRONG, aspects=1)
    start = initial_state.initial_states(job, 0)
    states = settling.BodyStates(start.position, start.orientation, start.velocity, start.spin)
    which = np.arange(4)
    return job, settling.Settling(job, start, which), states.select(which)


def test_moving_plate_only_loses_or_fails_parts(resting):
    job, ends, states = resting
    states.position[0, 2] = math.nan
    states.position[1, 2] = -0.6
    states.position[2, 0] = STRONG.plate_size / job.radius
    states.velocity[3] = 1e3
    assert sorted(ends.check(1.0, states)) == [0, 1, 2]
    assert ends.status[:3].tolist() == [RestStatus.FAILED, RestStatus.FAILED, RestStatus.LOST]
    assert ends.time[2] == 1.0
    assert ends.moving.tolist() == [3]
    assert ends.growth[3] == 0


def test_decisions_begin_with_the_first_check_after_the_motion(resting):
    job, ends, states = resting
    end = STRONG.duration / job.time_unit
    states.velocity[0] = 10.0
    for now in (0.5, 1.0, end - 0.1, end + 0.1):
        assert len(ends.check(now, states)) == 0
    states.velocity[0] = 0.0
    assert sorted(ends.check(end + 0.6, states)) == [0, 1, 2, 3]
    assert (ends.status == RestStatus.SETTLED).all()
    assert (ends.growth <= 0).all()


def test_height_above_a_tilted_plate_decides_about_falling_through(part, mat):
    # A plate of 2 m that tilts by 0.1 rad: its edge moves by 4 R.
    plate = Vibration(1.0, 12.0, 2.0, rocking_y=0.1)
    job = vibration_job(part('l_bracket'), mat, plate, aspects=1)
    start = initial_state.initial_states(job, 0)
    ends = settling.Settling(job, start, np.arange(2))
    at, turned = plate.pose(np.array([5.25]))
    place = np.array([[0.9, 0.0, 0.01], [0.9, 0.0, -0.02]])
    position = (rotate(turned, place) + at) / job.radius
    assert position[0, 2] < -settling.MAX_DEPTH
    states = settling.BodyStates(
        position, start.orientation[:2], start.velocity[:2], start.spin[:2]
    )
    assert ends.check(5.25 / job.time_unit, states).tolist() == [1]


# -- Time steps and values ------------------------------------------------------------------------


def test_time_step_resolves_the_vibration(part, mat):
    shape = part('l_bracket')
    quick = Vibration(400.0, 0.1, 0.1, vertical_amplitude=1e-5, rocking_x=1e-5)
    assert vibration_job(shape, mat, quick).time_step <= 1 / (400.0 * STEPS_PER_PERIOD)
    slow = vibration_job(shape, mat, dataclasses.replace(STRONG, frequency=25.0))
    assert slow.steps_per_t == drop_job.MOTION_STEPS_PER_T
    wide = Vibration(10.0, 1.0, 0.1, vertical_amplitude=0.1, rocking_x=1e-5)
    job = vibration_job(shape, mat, wide)
    travel = 3 * 0.1 * 2 * math.pi * 10.0 * job.time_step / job.radius
    assert 0.95 * drop_job.TRAVEL_PER_STEP < travel <= drop_job.TRAVEL_PER_STEP


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'duration': '200ms'}, "invalid duration '200ms': expected a plain number in s, "),
        ({'frequency': 0.0}, 'invalid frequency 0.0: expected more than 0 and at most 1000 Hz'),
        ({'vertical_amplitude': math.nan}, 'invalid vertical_amplitude nan: expected 0 to 0.1 m'),
        ({'plate_size': 0}, 'invalid plate_size 0: expected more than 0 and at most 100 m'),
        ({'rocking_phase': 7.0}, 'invalid rocking_phase 7.0: expected -6.28'),
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
    longest = drop_job.MAX_MOTION_STEPS * vibration_job(shape, mat, STRONG).time_step
    expected = f'^invalid duration 3600 s: expected at most {longest:.4g} s for this part, which'
    with pytest.raises(InvalidValueError, match=expected):
        vibration_job(shape, mat, endless)
    # The convergence check may still repeat the longest with finer steps.
    most = dataclasses.replace(STRONG, duration=0.999 * longest)
    assert vibration_job(shape, mat, most, refinement=2).refinement == 2
    wild = Vibration(0.5, 20.0, 0.1, vertical_amplitude=0.1, rocking_x=1e-5)
    with pytest.raises(InvalidValueError, match=r'^invalid impact speed '):
        vibration_job(shape, mat.changed(gravity=1e-5), wild)


def test_shipped_vibrations_fit_the_example_parts(part, mat):
    known = Actions.read(actions_file())
    shipped = [known.get(name) for name in known.names()]
    vibrations = [each for each in shipped if isinstance(each.action, Vibration)]
    assert len(vibrations) >= 2
    for each in vibrations:
        assert each.source
        assert each.time > each.action.duration
        for name in ('l_bracket', 'hex_nut'):
            assert vibration_job(part(name), mat, each.action).in_motion(0.0)
