"""Actions on parts in surroundings: where they start, and that the motion of a tray is rigid."""

import dataclasses
import math

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.plan import named_action, plan_actions
from resting_aspects_ros.api.roadmap import roadmap_document
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.statistics.poses import RestStatus


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


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore:no part came to rest')
def test_a_step_without_height_to_a_belt_of_equal_speed_keeps_every_aspect():
    counts = ra.reorient(
        'box_10x20x30',
        ra.Step(belt_speed=0.2, step_height=1e-5, lower_speed=0.2),
        2,
        surroundings=ra.surroundings('chute', roll='20deg'),
        drops=1000,
        workers=1,
        restitution=0.0,
    ).matrix.counts
    assert counts.sum() >= 6
    assert (counts[:, :6] == np.diag(counts.sum(axis=1))).all()
