"""Concurrent goals for the same drops share one run until all of them are canceled."""

import signal

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.nodes.drop_simulator.node import MAX_GOALS

DROPS = 1000
MANY = 200_000  # until it is canceled


@pytest.fixture(scope='module')
def received(suite):
    received = suite.client.poses()
    drop = suite.client.dropping_in_bullet('tetrahedron', 1)
    suite.client.wait(lambda: drop.done, 'start of the worker processes')
    return received


@pytest.fixture
def goals(suite, received):
    """Return goals for the same drops, all accepted before the first drop is made."""

    def goals(count, *asked, **fields):
        simulator = suite.processes['drop_simulator']
        assert simulator.send_to_workers(signal.SIGSTOP)
        try:
            made = []
            for _ in range(count):
                made.append(suite.client.dropping_in_bullet('tetrahedron', *asked, **fields))
                suite.client.wait(lambda: made[-1].accepted, 'goal')
        finally:
            simulator.send_to_workers(signal.SIGCONT)
        return made

    return goals


def runs_of(received, seed):
    return {batch.run.run_id for batch in received if batch.run.seed == seed}


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('seed', 'precision'), [(7171, 0.0), (7172, 0.02)])
def test_concurrent_goals_share_one_run(suite, received, goals, seed, precision):
    drops = goals(2, DROPS, seed=seed, precision=precision)
    suite.client.wait(lambda: all(drop.done for drop in drops), 'both results')
    first, second = (drop.result for drop in drops)
    assert first.status.code == second.status.code == Status.OK
    assert first == second
    suite.client.wait(lambda: runs_of(received, seed), 'batches')
    assert runs_of(received, seed) == {first.run_id}
    # The second goal receives feedback too. The last feedback can arrive after the result.
    done = [feedback.done for feedback in drops[1].feedback]
    assert done == sorted(set(done))
    assert 0 < done[-1] <= first.drops
    totals = [{feedback.total for feedback in drop.feedback} for drop in drops]
    assert totals[0] == totals[1]
    assert all(feedback.drops_per_second > 0 for feedback in drops[1].feedback)


@pytest.mark.slow
def test_canceling_the_second_goal_keeps_the_first(suite, received, goals):
    first, second = goals(2, MANY, seed=7173)
    suite.client.wait(lambda: second.feedback, 'some drops')
    second.cancel()
    suite.client.wait(lambda: second.done, 'end of the second')
    assert second.outcome == 'canceled'
    assert second.result.status.code == Status.CANCELED
    assert second.result.drops < MANY
    before = len(first.feedback)
    suite.client.wait(lambda: len(first.feedback) > before + 2, 'more of the first')
    first.cancel()
    suite.client.wait(lambda: first.done, 'end of the first')
    assert runs_of(received, 7173) == {first.result.run_id} == {second.result.run_id}


def test_canceling_the_first_goal_keeps_the_others(suite, received, goals):
    first, *others = goals(3, 2 * DROPS, seed=7174)
    suite.client.wait(lambda: first.feedback, 'some drops')
    first.cancel()
    suite.client.wait(lambda: all(drop.done for drop in (first, *others)), 'results')
    assert [drop.outcome for drop in (first, *others)] == ['canceled', 'succeeded', 'succeeded']
    assert {drop.result.drops for drop in others} == {2 * DROPS}
    assert runs_of(received, 7174) == {drop.result.run_id for drop in (first, *others)}


def test_all_are_canceled_together(suite, received, goals):
    drops = goals(3, MANY, seed=7177)
    suite.client.wait(lambda: drops[0].feedback, 'some drops')
    for drop in drops:
        drop.cancel()
    suite.client.wait(lambda: all(drop.done for drop in drops), 'results')
    assert {drop.outcome for drop in drops} == {'canceled'}
    assert runs_of(received, 7177) == {drops[0].result.run_id}


@pytest.mark.slow
def test_joining_goal_does_not_count_towards_the_maximum(suite, received, goals):
    drops = goals(MAX_GOALS + 4, 500, seed=7178)
    suite.client.wait(lambda: all(drop.done for drop in drops), 'results')
    assert {drop.result.status.code for drop in drops} == {Status.OK}


def test_other_drops_are_not_shared(suite):
    asked = {'part': 'tetrahedron', 'drops': 300, 'seed': 7175}
    others = (
        {},
        {'seed': 7176},
        {'drops': 301},
        {'precision': 0.1},
        {'first_drop': 1},
        {'surface': 'steel'},
        {'part': 'box_10x20x30'},
    )
    drops = [suite.client.dropping(**asked | each) for each in others]
    suite.client.wait(lambda: all(drop.done for drop in drops), 'all results')
    assert {drop.result.status.code for drop in drops} == {Status.OK}
    assert len({drop.result.run_id for drop in drops}) == len(others)
