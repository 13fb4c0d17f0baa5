"""Drops and actions at points: counts that follow from each point alone."""

from functools import partial

import numpy as np
import pytest
from scipy.stats import chi2_contingency

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import given_conditions
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.points import Monitor, Simulation, point_seed, run_tasks

MAT = given_conditions('rubber_mat', {'height': 0.03})
POINTS = [MAT.changed(restitution=r) for r in (0.1, 0.2, 0.3)]
TAP = Setting(MAT, None, named_action('tap'))
STILL = TAP.changed({'action.speed': 0.0, 'action.spin': 0.0})


@pytest.fixture(scope='module')
def part():
    return ra.load_part('tetrahedron')


def drop_points(part, points, workers):
    """Return the counts of 630 drops of a part at points."""
    simulation = Simulation.of(part, workers)
    settings = map(Setting, points)
    return run_tasks([partial(simulation.counts, at, 630, 1, '') for at in settings], workers)


@pytest.fixture(scope='module')
def counted(part, here):
    return drop_points(part, POINTS, here())


@pytest.fixture(scope='module')
def box(here):
    return Simulation.of(ra.load_part('box_10x20x30'), here())


def same_shares(*rows):
    """Whether a chi-square test finds no difference between rows of counts."""
    table = np.array(rows)
    return chi2_contingency(table[:, table.sum(axis=0) > 0]).pvalue > 1e-3


def test_counts_of_a_point_do_not_depend_on_other_points(part, counted, here):
    backward = drop_points(part, POINTS[:0:-1], here())
    assert np.array_equal(backward, counted[:0:-1])
    assert (counted[0] != counted[1]).any()


def test_counts_are_those_of_a_run_with_the_seed_of_the_point(part, counted, here):
    seed = point_seed(1, part, Setting(POINTS[1]))
    run = ra.drop(part, 630, surface=POINTS[1], seed=seed, workers=here(), keep_poses=False)
    assert (run.distribution.counts == counted[1][:4]).all()


def test_every_part_that_is_dropped_and_moved_is_counted_once(box):
    seen = []
    found = box.dropped_and_acted(TAP, 150, 1, Monitor(seen.append))
    assert found.sum() == seen[-1] == 150
    assert (found >= 0).all()
    assert seen == sorted(seen)
    # An action without effect leaves the distribution of the drops.
    before = box.dropped(STILL, 300, 2, Monitor())
    assert same_shares(before, box.dropped_and_acted(STILL, 300, 1, Monitor()))


@pytest.fixture(scope='module')
def matrix(box, here):
    options = {'surface': MAT, 'drops': 10, 'seed': 4, 'workers': here()}
    return ra.reorient(box.part, TAP.action, 200, **options).matrix


def test_action_after_drops_is_that_of_reorient(box, matrix):
    before = box.dropped(TAP, 600, 3, Monitor())
    found = box.dropped_and_acted(TAP, 600, 3, Monitor())
    # The expected counts have the sampling error of the matrix, too.
    expected = before[:6] @ matrix.probability[:, :6]
    assert same_shares(found[:6], expected.round().astype(int))


def test_actions_from_each_aspect_are_those_of_reorient(box, matrix):
    found = box.acted(TAP, 200, 3, Monitor())
    assert found.sum(axis=1).tolist() == [200] * 6
    for row, expected in zip(found, matrix.counts, strict=True):
        assert same_shares(row[:-1], expected)


def test_strong_action_is_impossible(box):
    strong = TAP.changed({'action.speed': 20.0})
    for method in (box.dropped_and_acted, box.acted):
        with pytest.raises(InvalidValueError, match='it moves box_10x20x30'):
            method(strong, 10, 1, Monitor())


@pytest.mark.slow
def test_actions_start_from_the_resting_poses_in_surroundings(box):
    groove = Setting(MAT, ra.surroundings('v_groove', opening='90deg'), named_action('tap'))
    still = groove.changed({'action.speed': 0.0, 'action.spin': 0.0})
    rests = box.dropped(still, 500, 2, Monitor())
    found = [box.dropped_and_acted(each, 250, 1, Monitor()) for each in (groove, still)]
    assert [each.sum() for each in found] == [250, 250]
    in_aspect = [[each[:6].sum() + 1, each[6:].sum() + 1] for each in (rests, found[1])]
    assert same_shares(*in_aspect)


@pytest.mark.slow
def test_parts_fall_over_an_edge_in_surroundings(box):
    """A step on a wall is possible for drops that are moved, as for reorient."""
    wall = Setting(MAT, ra.surroundings('wall'), named_action('step_down'))
    found = box.dropped_and_acted(wall, 10, 1, Monitor())
    assert found.sum() == 10
    pocket = Setting(MAT, ra.surroundings('pocket'), named_action('step_down'))
    with pytest.raises(InvalidValueError, match='expected plane, slope, wall or chute'):
        box.dropped_and_acted(pocket, 10, 1, Monitor())
