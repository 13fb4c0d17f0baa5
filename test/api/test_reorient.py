"""Reorientation, retention and given initial states in the Python interface."""

import json

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.pages import reorientation_page
from resting_aspects_ros.api.runner import find_convergence
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.simulation.conditions import Noise
from resting_aspects_ros.simulation.starts import GivenStates

KICK = ra.Kick(speed=0.4, spin=15.0)


@pytest.fixture(scope='module')
def tetrahedron():
    return ra.load_part('tetrahedron')


@pytest.fixture(scope='module')
def tapped(tetrahedron, workers):
    return ra.reorient(tetrahedron, KICK, 50, drops=100, seed=3, workers=workers)


def test_every_action_is_counted_once_by_any_number_of_workers(tapped, tetrahedron):
    assert tapped.complete
    assert tapped.matrix.actions.tolist() == [50] * 4
    assert 0 < np.trace(tapped.matrix.counts) < 200
    again = ra.reorient(tetrahedron, KICK, 50, drops=100, seed=3, workers=1)
    np.testing.assert_array_equal(again.matrix.counts, tapped.matrix.counts)
    np.testing.assert_array_equal(again.drop.counts, tapped.drop.counts)


def test_part_stays_in_a_low_aspect_under_a_weak_kick(crate, workers):
    """0.1 m/s lifts by 0.5 mm; the sides of 20 x 30 and 10 x 30 mm need 4.8 and 2.1 mm."""
    weak = ra.Kick(speed=0.1, speed_spread=0.0, horizontal_spread=0.0)
    result = ra.reorient(crate, weak, 20, drops=10, workers=workers)
    assert result.matrix.counts[:4, :4].tolist() == (20 * np.eye(4)).tolist()


def test_strong_kick_forgets_the_start(crate, workers):
    """Total variation between rows by class, against what chance explains."""
    n = 40
    result = ra.reorient(crate, 'toss', n, drops=10, seed=2, workers=workers)
    rows = result.matrix.by_class()
    shares = rows.counts / rows.actions[:, None]
    # Five standard errors of a difference of two shares near 1/2, of 2 n actions each.
    limit = 5 * np.sqrt(2 * 0.25 / (2 * n))
    assert np.abs(shares[:, None] - shares).max() < limit


def test_kick_without_energy_changes_nothing_until_precise(tetrahedron, workers):
    result = ra.reorient(tetrahedron, ra.Kick(), precision=0.1, drops=10, workers=workers)
    lower, upper = result.matrix.bounds()
    assert result.complete
    assert (upper - lower).max() <= 0.2
    assert result.matrix.actions.min() >= 250
    assert np.trace(result.matrix.counts) == result.matrix.counts.sum()
    assert len(result.long_run.closed) == 4


def test_document_and_page_have_the_matrix_and_the_long_run(tapped):
    document = json.loads(tapped.to_json([1, 2]))
    assert document['counts'] == tapped.matrix.counts.tolist()
    assert sum(document['long_run']) == pytest.approx(1)
    action = {'name': 'kick', 'kind': 'kick', 'time': 1.0, 'speed': 0.4, 'spin': 15.0}
    spread = {'speed_spread': pytest.approx(0.08), 'horizontal_spread': pytest.approx(0.04)}
    assert document['action'] == action | spread
    assert [a['count'] for a in document['aspects']] == tapped.drop.counts.tolist()
    assert document['wanted']['aspects'] == [1, 2]
    assert document['wanted']['probability'][:2] == [1, 1]
    # All sides of the tetrahedron are one class.
    view = tapped.by_class()
    assert view.matrix.counts[0, 0] == tapped.matrix.counts[:, :4].sum()
    assert view.long_run.shares.tolist() == [1]
    plan = ra.plan_reorientation([tapped], [1, 2])
    page = reorientation_page([tapped], wanted=(1, 2), plan=plan)
    matrix, long_run, way, best = (
        item for section in page.sections for item in section.items if isinstance(item, Table)
    )
    assert [row[-1] for row in matrix.rows] == ['200']
    assert long_run.rows[0][:2] == ['1 to 4', '100 %']
    assert [row[1] for row in (*way.rows[:2], *best.rows[:2])] == ['wanted'] * 4


def test_best_plan_prefers_the_quicker_way_for_each_class(crate, workers):
    toss = ra.Kick(speed=1.0, spin=40.0)
    slow = ra.NamedAction('slow', toss, time=10.0)
    quick = ra.NamedAction('quick', toss, time=1.0)
    still = ra.NamedAction('still', ra.Kick(), time=0.1)
    results = [
        ra.reorient(crate, action, 10, drops=10, workers=workers)
        for action in (slow, quick, still)
    ]
    found = ra.plan_reorientation(results, [1, 2])
    assert [found.names[k] for k in found.plan.action[2:]] == ['quick'] * 4
    sections = {each.anchor: each for each in reorientation_page(results, wanted=[1]).sections}
    assert sections['actions'].items[0].rows[-1][0] == 'wanted'  # also of a part of a class
    # Aspects of a class take the same time.
    assert found.plan.time[2::2].tolist() == found.plan.time[3::2].tolist()


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        ({'action': 'jolt'}, "invalid action 'jolt': expected one of kick"),
        ({'per_aspect': 0}, 'invalid number of actions per aspect 0'),
        ({'frition': 0.3}, "invalid condition 'frition'.*did you mean 'friction'"),
        ({'action': ra.Kick(speed=20.0)}, 'invalid action kick: it moves tetrahedron with up to'),
    ],
)
def test_wrong_requests_are_named(tetrahedron, workers, wrong, message):
    with pytest.raises(ra.InvalidValueError, match=message):
        ra.reorient(tetrahedron, **{'workers': workers, **wrong})


def test_convergence_shows_the_entry_that_moves_most(tapped):
    names = ['aspect 1', 'unclassified', 'unsettled', 'failed', 'lost']
    many = 1000 * tapped.matrix.by_class().counts
    same = find_convergence(many, many, 1e-5, 1000, 0.95)
    assert same.shift == 0
    assert 'explained by chance' in same.text(names)
    # Each count in the next column, the last in the first.
    moved = find_convergence(many, np.roll(many, 1, axis=1), 1e-5, 1000, 0.95)
    assert (moved.row, moved.column) in [(0, 0), (0, 1)]
    assert moved.lower <= moved.shift <= moved.upper
    assert 'not explained by chance' in moved.text(names)


# -- Retention ------------------------------------------------------------------------------------


def test_no_part_leaves_below_its_barrier(crate, workers):
    result = ra.retention(crate, 5, restitution=0.3, workers=workers)
    assert result.complete
    for curve in result.curves:
        assert curve.parts.tolist() == [5] * len(curve.lift)
        assert curve.left[curve.lift < 0.95 * curve.barrier].sum() == 0
        assert curve.left[-4:].any()
        assert curve.lift[-1] <= 2 * crate.hull_radius * (1 + 1e-12)
        assert (np.diff(curve.lift) > 0).all()


def test_retention_that_is_stopped_or_impossible_has_no_curves(crate, workers):
    result = ra.retention(crate, 5, workers=workers, stopped=lambda: True)
    assert result.curves == ()
    assert not result.complete
    with pytest.raises(ra.InvalidValueError, match='invalid maximum lift height'):
        ra.retention(crate, 5, max_lift=-0.01, workers=workers)


# -- Given initial states -------------------------------------------------------------------------


def test_part_that_is_put_down_stays(crate, workers):
    aspects = ra.find_aspects(crate).aspects
    states = GivenStates(
        position=[[0.1 * k, 0.2, a.com_height] for k, a in enumerate(aspects)],
        orientation=[a.orientation for a in aspects],
    )
    result = ra.drop(crate, initial_states=states, replicates=3, workers=workers)
    expected = np.hstack([3 * np.eye(6), np.zeros((6, 4))])
    np.testing.assert_array_equal(result.by_state.counts, expected)
    assert result.distribution.drops == 18
    document = json.loads(result.to_json())
    assert document['initial_states']['counts'] == expected.tolist()
    # The poses are where the parts were put, in the order of the states.
    centre = result.poses.position[:6]
    assert np.abs(centre[:, 0] - [0.1 * k for k in range(6)]).max() < 0.04


def test_replicates_differ_by_their_noise_only(crate, workers):
    states = GivenStates([[0, 0, 0.05]], [[0.1, 0.2, 0.3, 0.9]], [[0.2, 0, 0]], [[3.0, 1, 2]])
    same = ra.drop(crate, initial_states=states, replicates=4, workers=workers)
    # The place of a part in the world changes roundings, so the poses agree only nearly.
    assert same.by_state.counts.max() == 4
    noisy = ra.drop(
        crate, initial_states=states, replicates=40, noise=Noise(orientation=1.0), workers=workers
    )
    assert (noisy.by_state.counts[0] > 0).sum() > 1


@pytest.mark.parametrize('wrong', [{'drops': 5}, {'replicates': 0}, {'initial_states': None}])
def test_states_exclude_other_numbers_of_drops(crate, workers, wrong):
    states = GivenStates([[0, 0, 0.05]], [[0, 0, 0, 1]])
    given = {'initial_states': states, 'replicates': 5, 'workers': workers}
    with pytest.raises(ra.InvalidValueError, match=r'initial|replicates'):
        ra.drop(crate, **given | wrong)
