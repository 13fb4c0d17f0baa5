"""A run that goes on with another simulator: it ends as runs do."""

import re
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from action_msgs.srv import CancelGoal
from resting_aspects_interfaces.msg import AspectDistribution, Status

from resting_aspects_ros.client import CanceledError, RestingAspectsClient
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


def test_who_asks_for_drops_that_are_under_way_waits_for_them(suite, heard):
    """And is told at once when somebody else cancels them."""
    drop = suite.client.dropping('tetrahedron', MANY, seed=31)
    run_id = first_batch(suite, heard, 31).run.run_id
    asked = suite.client.asking('tetrahedron', MANY, seed=[31])
    other = suite.client.asking('tetrahedron', MANY, seed=[31])
    suite.client.spin(1.0)
    assert not asked.done()
    drop.cancel()
    suite.client.wait(lambda: asked.done() and other.done(), 'word of the cancel', seconds=3)
    status = asked.result().status
    assert (other.result().status, status.code) == (status, Status.CANCELED)
    assert re.fullmatch(
        rf'canceled(, or broken off,)? after \d+ of {MANY} drops; those are kept', status.message
    )
    assert {batch.run.run_id for batch in batches_of(heard, 31)} == {run_id}


def test_a_whole_run_of_another_is_the_answer(suite, heard):
    drop = suite.client.dropping('tetrahedron', 3000, seed=32)
    run_id = first_batch(suite, heard, 32).run.run_id
    answer = suite.client.ask('tetrahedron', 3000, seed=[32])
    assert answer.status.code == Status.OK
    assert (answer.distribution.drops, answer.distribution.run.run_id) == (3000, run_id)
    suite.client.wait(lambda: drop.done, 'result')


def test_one_that_another_simulator_left_is_taken_up_soon_for_who_asks(fresh_suite):
    """Much sooner than where nobody waits, which is after a minute."""
    suite = fresh_suite()
    heard = suite.client.poses()
    suite.client.dropping('tetrahedron', 9000, seed=33)
    run_id = first_batch(suite, heard, 33).run.run_id
    another_simulator(suite)
    answer = suite.client.ask('tetrahedron', 9000, seed=[33], seconds=40)
    assert answer.status.code == Status.OK
    assert (answer.distribution.drops, answer.distribution.run.run_id) == (9000, run_id)


def test_a_classifier_that_is_started_again_begins_no_second_run(suite, heard, cancel_all):
    suite.client.asking('tetrahedron', MANY, seed=[34])
    run_id = first_batch(suite, heard, 34).run.run_id
    suite.processes['aspect_classifier'].end(signal.SIGKILL)
    suite.start_again('aspect_classifier')
    asked = suite.client.asking('tetrahedron', MANY, seed=[34])
    suite.client.spin(3.0)
    assert not asked.done()
    cancel_all()
    suite.client.wait(asked.done, 'word of the cancel', seconds=3)
    assert asked.result().status.code == Status.CANCELED
    assert {batch.run.run_id for batch in batches_of(heard, 34)} == {run_id}


def test_a_client_hears_of_a_cancel_while_the_classifier_is_started_again(
    suite, heard, cancel_all
):
    """And its question, which it asks again, does not begin the run anew."""
    with (
        ThreadPoolExecutor(1) as pool,
        RestingAspectsClient(ros_args=['-r', f'__ns:={suite.namespace}']) as client,
    ):
        progress = []
        ask = partial(client.get_distribution, drops=MANY, seed=35, progress=progress.append)
        answer = pool.submit(ask, 'tetrahedron')
        suite.client.wait(lambda: progress, 'progress')
        suite.processes['aspect_classifier'].end(signal.SIGKILL)
        cancel_all()
        suite.start_again('aspect_classifier')
        suite.client.wait(answer.done, 'word of the cancel', seconds=15)
        with pytest.raises(CanceledError, match=r'canceled perhaps, after \d+ drops'):
            answer.result()
    suite.client.spin(3.0)
    assert len({batch.run.run_id for batch in batches_of(heard, 35)}) == 1
    assert batches_of(heard, 35)[-1].last
