"""Goals for the same drops at the same time: they are made once, for as long as one wants them."""

import pytest
from resting_aspects_interfaces.msg import Status

DROPS = 4000
MANY = 200_000  # until it is canceled


@pytest.fixture(scope='module')
def heard(suite):
    return suite.client.poses()


@pytest.fixture
def two(suite, heard):
    """Two goals for the same drops; the second is sent when the first has made some."""

    def two(drops, seed, **fields):
        first = suite.client.dropping('tetrahedron', drops, seed=seed, **fields)
        suite.client.wait(lambda: first.feedback, 'first drops')
        second = suite.client.dropping('tetrahedron', drops, seed=seed, **fields)
        suite.client.wait(lambda: second.accepted, 'second goal')
        return first, second

    return two


def runs_of(heard, seed):
    return {batch.run.run_id for batch in heard if batch.run.seed == seed}


@pytest.mark.parametrize(('seed', 'precision'), [(71, 0.0), (72, 0.02)])
def test_one_run_answers_both(suite, heard, two, seed, precision):
    drops = two(DROPS, seed, precision=precision)
    suite.client.wait(lambda: all(drop.done for drop in drops), 'both results')
    first, second = (drop.result for drop in drops)
    assert first.status.code == second.status.code == Status.OK
    assert first == second
    assert runs_of(heard, seed) == {first.run_id}
    # Who came second is told how far it is, too, up to its end.
    done = [feedback.done for feedback in drops[1].feedback]
    assert done
    assert done == sorted(set(done))
    assert done[-1] == first.drops
    totals = [{feedback.total for feedback in drop.feedback} for drop in drops]
    assert totals[0] == totals[1]
    assert all(feedback.drops_per_second > 0 for feedback in drops[1].feedback)


def test_a_cancel_of_the_second_leaves_the_first_alone(suite, heard, two):
    first, second = two(MANY, 73)
    second.cancel()
    suite.client.wait(lambda: second.done, 'end of the second', seconds=5)
    assert second.outcome == 'canceled'
    assert second.result.status.code == Status.CANCELED
    assert second.result.drops == 0
    before = len(first.feedback)
    suite.client.wait(lambda: len(first.feedback) > before + 2, 'more of the first')
    first.cancel()
    suite.client.wait(lambda: first.done, 'end of the first')
    assert runs_of(heard, 73) == {first.result.run_id}


def test_a_cancel_of_the_first_leaves_the_second_its_drops(suite, heard, two):
    first, second = two(DROPS, 74)
    first.cancel()
    suite.client.wait(lambda: first.done and second.done, 'both results')
    assert first.result.status.code == Status.CANCELED
    assert second.result.status.code == Status.OK
    assert second.result.drops == DROPS
    assert runs_of(heard, 74) == {first.result.run_id, second.result.run_id}


@pytest.mark.parametrize(
    'other', [{'seed': 76}, {'drops': 5001}, {'precision': 0.01}, {'first_drop': 1}]
)
def test_other_drops_are_another_run(suite, other):
    asked = {'drops': 5000, 'seed': 75}
    first = suite.client.dropping('tetrahedron', **asked)
    second = suite.client.dropping('tetrahedron', **asked | other)
    suite.client.wait(lambda: first.done and second.done, 'both results')
    assert first.result.status.code == second.result.status.code == Status.OK
    assert first.result.run_id != second.result.run_id
