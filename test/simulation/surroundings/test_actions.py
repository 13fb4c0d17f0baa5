"""Actions on parts in surroundings: where they start, and that the motion of a tray is rigid."""

import dataclasses
import math

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import named_action, plan_actions, plan_drops
from resting_aspects_ros.api.roadmap import roadmap_document
from resting_aspects_ros.api.runner import StartTally, TransitionTally
from resting_aspects_ros.rotations import down_in_part, rotate
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.bullet_engine import WallWorld
from resting_aspects_ros.simulation.release import REST_MARGIN, initial_states
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import aspect_ids
from resting_aspects_ros.statistics.poses import RestStatus
from resting_aspects_ros.statistics.transitions import no_actions


@pytest.fixture(scope='module')
def wall():
    return ra.surroundings('wall', release={'y_min': 0.02, 'y_max': 0.03})


@pytest.fixture(scope='module')
def dropped(wall):
    return ra.drop('box_10x20x30', 1000, surroundings=wall, seed=3, workers=1)


def planned(dropped, wall, action):
    conditions = dataclasses.replace(dropped.run.conditions, surroundings=wall)
    return plan_actions(
        dropped.part, named_action(action), conditions, per_aspect=20, rests=dropped.poses
    )


def test_actions_start_in_poses_in_which_drops_ended(dropped, wall):
    starts = planned(dropped, wall, 'tap').job.starts
    states = starts.states(np.arange(120), np.random.default_rng(1))
    ids = dropped.distribution.aspects.classify(states.orientation)
    assert ids.tolist() == (np.arange(120) % 6 + 1).tolist()
    ends = dropped.poses.orientation
    closest = np.abs(states.orientation @ ends.T).max(axis=1)
    assert np.allclose(closest, 1)


def test_a_tap_without_energy_leaves_every_part(wall):
    none = ra.Kick(speed=0, spin=0)
    made = ra.reorient('box_10x20x30', none, 5, surroundings=wall, drops=1000, seed=3, workers=1)
    assert (made.matrix.counts[:, :6] == 5 * np.eye(6)).all()
    document = made.document()
    assert document['conditions']['surroundings']['kind'] == 'wall'
    assert {'lost', 'sliding'} <= document['drop'].keys()
    # The floor is touched by all parts; the wall only by some.
    poses = roadmap_document(made.part, made.drop, None, {})['poses']
    assert sum(pose['contact_counts']['floor'] for pose in poses) == made.drop.counts.sum()


def test_an_aspect_that_does_not_occur_is_left_out_and_named(dropped, wall):
    one = dropped.poses.between(0, 1)
    (found,) = dropped.distribution.aspects.classify(one.orientation).tolist()
    conditions = dataclasses.replace(dropped.run.conditions, surroundings=wall)
    with pytest.warns(UserWarning, match='no part came to rest in aspect'):
        plan = plan_actions(dropped.part, named_action('tap'), conditions, per_aspect=5, rests=one)
    assert (plan.tally.ids, plan.run.drops) == ((found,), 5)
    some = dropped.poses.between(0, 5)
    plan.tally.add(some, aspect_ids(plan.tally.aspects, some))
    assert plan.tally.complete
    assert plan.tally.matrix.actions.tolist() == (5 * (np.arange(6) + 1 == found)).tolist()
    assert np.isnan(plan.tally.matrix.probability).any(axis=1).sum() == 5
    none = dataclasses.replace(one, status=np.array([RestStatus.SLIDING], dtype=np.uint8))
    with pytest.raises(ra.InvalidValueError, match='no part came to rest in an aspect'):
        plan_actions(dropped.part, named_action('tap'), conditions, per_aspect=5, rests=none)


@pytest.mark.parametrize(
    ('kind', 'says'),
    [('v_groove', 'expected plane, slope, wall or chute'), ('l_chute', r'expected 0.1 m/s')],
)
def test_a_step_where_it_is_not_possible_is_refused(kind, says):
    with pytest.raises(ra.InvalidValueError, match=says):
        ra.reorient('box_10x20x30', 'step_down', 5, surroundings=kind, drops=10)


def test_parts_that_slide_or_are_lost_are_not_counted_as_at_rest(dropped):
    aspects = dropped.distribution.aspects
    status = np.array(list(RestStatus), dtype=np.uint8)
    poses = dataclasses.replace(dropped.poses.between(0, len(status)), status=status)
    ids = np.where(status == RestStatus.SETTLED, 2, 0)
    for tally in (
        StartTally(aspects, 1, len(ids)),
        TransitionTally(no_actions(aspects), len(ids)),
    ):
        tally.add(poses, ids)
        counts = tally.counts if isinstance(tally, StartTally) else tally.matrix.counts
        # Unclassified, unsettled or sliding, failed, lost.
        assert counts.sum(axis=0).tolist() == [0, 1, 0, 0, 0, 0, 0, 2, 1, 1]


def test_a_tray_that_rocks_moves_its_walls_with_its_floor():
    # Rocking by less than friction and weight hold: parts keep their aspect, because the floor and
    # the walls keep their angle.
    release = {'x_min': 0.0, 'x_max': 0.0, 'y_min': 0.0, 'y_max': 0.0}
    tray = ra.surroundings('tray', length=0.08, width=0.08, release=release)
    rocking = ra.Vibration(frequency=10.0, duration=1.2, rocking_x=0.004, plate_size=1.0)
    result = ra.reorient(
        'box_10x20x30',
        rocking,
        3,
        surroundings=tray,
        drops=250,
        seed=3,
        workers=1,
        friction=0.6,
        restitution=0.0,
    )
    assert result.matrix.counts[:2, :2].sum() == 6
    assert not result.matrix.counts[:, -1].any()


def test_initial_states_inside_a_wall_are_refused(wall, part):
    # The half length along y is 10 mm, so that the second state is 4 mm inside the wall at y = 0.
    states = ra.GivenStates(
        position=[[0, 0.02, 0.1], [0, 0.006, 0.1]], orientation=[[0.0, 0.0, 0.0, 1.0]] * 2
    )
    with pytest.raises(ra.InvalidValueError, match=r'initial state 1: .* 4 mm inside the wall'):
        ra.drop(part('box_10x20x30'), initial_states=states, surroundings=wall, workers=1)


def test_a_part_at_rest_on_a_slope_stays_where_it_was_put():
    """Initial states are in the tray frame; the floor of the slope contains its origin."""
    box = ra.load_part('box_10x20x30')
    angle = math.radians(5)
    half = np.array([[0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)]])
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    place = np.array([0.1, 0.0, -0.1 * np.tan(angle)])  # on the slope
    states = ra.GivenStates(position=[place + 0.0151 * normal], orientation=half)
    slope = ra.surroundings('slope', angle=angle)
    made = ra.drop(box, initial_states=states, surroundings=slope, workers=1)
    assert made.distribution.drops == 1
    centre = rotate(made.poses.orientation, box.centre_of_mass) + made.poses.position
    # It falls by 0.1 mm and stays; the friction angle is 14 degrees.
    np.testing.assert_allclose(centre[0], place + 0.015 * normal, atol=5e-4)


def test_floor_of_a_slope_is_where_aspects_are_counted():
    result = ra.drop(
        'tetrahedron', 50, surroundings=ra.surroundings('slope', angle=0.1), workers=1
    )
    on_floor = result.distribution.aspects.floor_normal
    assert np.allclose(on_floor, [np.sin(0.1), 0, np.cos(0.1)])
    down = down_in_part(result.poses.orientation, on_floor)
    ids = result.distribution.aspects.locate(down)[0]
    assert np.bincount(ids, minlength=5)[1:].tolist() == result.distribution.counts.tolist()


def belt_step(part, mat, kind, step, **changes):
    """The plan of a step of a box from a belt in surroundings."""
    shape = part('box_10x20x30')
    conditions = dataclasses.replace(mat, surroundings=ra.surroundings(kind, **changes))
    dropping = plan_drops(shape, conditions, drops=1000, seed=3)
    rests = drop_range(dropping.job, 0, 1000)
    return plan_actions(shape, NamedAction('step', step), conditions, per_aspect=2, rests=rests)


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore:no part came to rest')
def test_a_step_without_height_to_a_belt_of_equal_speed_keeps_every_aspect(part, mat):
    step = ra.Step(belt_speed=0.2, step_height=1e-5, lower_speed=0.2)
    plan = belt_step(part, mat, 'chute', step, roll='20deg')
    poses = drop_range(plan.job, 0, plan.run.drops)
    plan.tally.add(poses, aspect_ids(plan.tally.aspects, poses))
    counts = plan.tally.matrix.counts
    assert counts.sum() == plan.run.drops
    assert (counts[:, :6] == np.diag(counts.sum(axis=1))).all()


@pytest.mark.filterwarnings('ignore:no part came to rest')
def test_a_box_on_the_lower_belt_accelerates_by_friction_times_gravity(part, mat):
    step = ra.Step(belt_speed=0.1, step_height=0.01, lower_speed=0.3)
    job = belt_step(part, mat, 'slope', step, angle=0.0, floor={'restitution': 0.0}).job
    world = WallWorld(job)
    states = initial_states(job, 0, 5)
    states.position[:, 0] = 4.0
    states.position[:, 2] -= job.edge.step_height / job.radius - REST_MARGIN
    # Relative to the lower belt, which is 0.2 m/s faster.
    slip = 0.2 * job.time_unit / job.radius
    states.velocity[:] = [-slip, 0, 0]
    bodies = world._add(states)
    time = slip / job.conditions.friction / 2
    steps = round(time * job.steps_per_t)
    world._advance(0, steps)
    gained = world._states(bodies, np.arange(5)).velocity[:, 0] + slip
    expected = job.conditions.friction * steps / job.steps_per_t
    # A contact whose normal force becomes 0 while Bullet's solver iterates keeps the friction that
    # it had before, so that a slide has more friction than Coulomb's, up to 2 % with 640 steps.
    assert gained == pytest.approx(expected, rel=0.03)
