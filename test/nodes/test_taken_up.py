"""A run that goes on with another simulator: it ends as runs do."""

import signal
import time

import pytest
from action_msgs.srv import CancelGoal
from resting_aspects_interfaces.msg import AspectDistribution, Status

from resting_aspects_ros.commands.logged_run import read_contents
from resting_aspects_ros.nodes.interface import ALL_LATCHED, ASPECT_DISTRIBUTIONS

MANY = 200_000
QUICK = {'run_tracker.CHECK_PERIOD': 0.2, 'run_tracker.SILENCE': 3.0, 'open_log.END_TIMEOUT': 2.0}


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite({'aspect_classifier': QUICK, 'drop_recorder': QUICK})


@pytest.fixture(scope='module')
def heard(suite):
    return suite.client.poses()


@pytest.fixture(scope='module')
def found(suite):
    return suite.client.listen(
        AspectDistribution, f'{ASPECT_DISTRIBUTIONS}/tetrahedron', ALL_LATCHED
    )


@pytest.fixture
def cancel_all(suite):
    """End the runs of the simulator, as docs/ros.md says."""
    client = suite.client.node.create_client(CancelGoal, 'drop_part/_action/cancel_goal')

    def cancel_all():
        suite.client.wait(client.service_is_ready, 'action')
        answer = client.call_async(CancelGoal.Request())
        suite.client.wait(answer.done, 'answer of the cancel')
        assert answer.result().goals_canceling

    return cancel_all


def batches_of(heard, seed):
    return [batch for batch in heard if batch.run.seed == seed]


def first_batch(suite, heard, seed):
    suite.client.wait(lambda: batches_of(heard, seed), 'first batch')
    return batches_of(heard, seed)[0]


def another_simulator(suite):
    suite.processes['drop_simulator'].end(signal.SIGKILL)
    suite.start_again('drop_simulator')


def end_of(suite, found, run_id):
    """The distribution with which a run ended."""

    def complete():
        return [each for each in found if each.run.run_id == run_id and each.complete]

    return suite.client.wait(complete, 'end of the run')[0]


def test_it_can_be_canceled(suite, heard, found, cancel_all):
    suite.client.dropping('tetrahedron', MANY, seed=21)
    run_id = first_batch(suite, heard, 21).run.run_id
    another_simulator(suite)
    before = len(batches_of(heard, 21))
    suite.client.wait(lambda: len(batches_of(heard, 21)) > before + 2, 'batch of the other')
    cancel_all()
    distribution = end_of(suite, found, run_id)
    contents = read_contents(suite.log_of(run_id))
    assert contents.outcome.whole
    assert contents.outcome.drops == distribution.drops < MANY
    (last,) = [batch for batch in batches_of(heard, 21) if batch.last]
    assert last.first_drop + len(last.poses) == distribution.drops
    known = suite.client.ask(drops=distribution.drops, seed=[21], only_known=True)
    assert known.distribution.run.run_id == run_id
    # Nobody goes on with it.
    until = time.monotonic() + 2 * QUICK['run_tracker.SILENCE']
    suite.client.wait(lambda: time.monotonic() > until, 'a while')
    assert batches_of(heard, 21)[-1].last


def test_it_stops_at_its_precision(suite, heard, found):
    suite.client.dropping('tetrahedron', 0, precision=0.01, seed=22)
    run_id = first_batch(suite, heard, 22).run.run_id
    another_simulator(suite)
    distribution = end_of(suite, found, run_id)
    contents = read_contents(suite.log_of(run_id))
    assert (contents.outcome.whole, contents.outcome.drops) == (True, distribution.drops)
    undisturbed = suite.client.drop('tetrahedron', 0, precision=0.01, seed=22)
    assert undisturbed.result.drops == distribution.drops
    assert undisturbed.result.status.code == Status.OK
