"""Parts that are dropped and then moved once by an action."""

import numpy as np
import pytest
from scipy.stats import chi2_contingency

import resting_aspects_ros as ra
from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.api.plan_actions import named_action
from resting_aspects_ros.studies.action_points import act_at_points
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.point_runs import drop_points

MAT = given_conditions('rubber_mat', {'height': 0.02})
TAP = Setting(MAT, None, named_action('tap'))


@pytest.fixture(scope='module')
def part():
    return ra.load_part('box_10x20x30')


@pytest.fixture(scope='module')
def points():
    return [TAP, TAP.changed({'action.speed': 0.0, 'action.spin': 0.0})]


@pytest.fixture(scope='module')
def counted(part, points, here):
    return act_at_points(part, points, 150, 1, here(lookahead=1))


def test_every_part_is_counted_once(counted):
    assert counted.drops.tolist() == [150, 150]
    assert not counted.skipped


def test_counts_do_not_depend_on_the_other_points_and_workers(part, points, counted, here):
    seen = []
    again = act_at_points(part, points[1:], 150, 1, here(lookahead=4), progress=seen.append)
    assert again.counts.tolist() == counted.counts[1:].tolist()
    assert seen[-1] == 150
    assert seen == sorted(seen)


def test_action_without_effect_leaves_the_distribution_of_the_drops(part, counted, here):
    rests = drop_points(part, [MAT], 300, 2, workers=here(lookahead=1)).by_class()[0]
    table = np.array([rests, counted.by_class()[1]])
    table = table[:, table.sum(axis=0) > 0]
    assert chi2_contingency(table).pvalue > 1e-3


def test_strong_action_is_impossible(part, here):
    strong = TAP.changed({'action.speed': 20.0})
    found = act_at_points(part, [strong], 10, 1, here(lookahead=1))
    assert 'it moves box_10x20x30' in found.skipped[0]
    assert found.drops.tolist() == [0]


def test_point_that_is_stopped_has_no_counts(part, here):
    done = []
    found = act_at_points(
        part, [TAP], 150, 1, here(lookahead=1), progress=done.append, stopped=lambda: done
    )
    assert found.drops.tolist() == [0]


@pytest.mark.slow
def test_actions_start_from_the_resting_poses_in_surroundings(part, here):
    groove = Setting(MAT, ra.surroundings('v_groove', opening='90deg'), named_action('tap'))
    still = groove.changed({'action.speed': 0.0, 'action.spin': 0.0})
    found = act_at_points(part, [groove, still], 250, 1, here(lookahead=1))
    rests = drop_points(part, [still.drop_conditions], 500, 2, workers=here(lookahead=1))
    assert found.drops.tolist() == [250, 250]
    in_aspect = np.array([
        [rests.counts.sum(), rests.other.sum()],
        [found.counts[1].sum(), found.other[1].sum()],
    ])  # fmt: skip
    assert chi2_contingency(in_aspect + 1).pvalue > 1e-3
