"""A run whose simulator is killed: its other drops come from the next one, as the same run."""

import functools
import signal

import pytest
from resting_aspects_interfaces.msg import RecordedRun, Status

from resting_aspects_ros.commands.logged_run import read_contents
from resting_aspects_ros.nodes.interface import ALL_LATCHED, RECORDED_RUNS

DROPS = 6000
QUICK = {'run_tracker.CHECK_PERIOD': 0.2, 'run_tracker.SILENCE': 3.0, 'open_log.END_TIMEOUT': 2.0}


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite({'aspect_classifier': QUICK, 'drop_recorder': QUICK})


@pytest.fixture(scope='module')
def heard(suite):
    return suite.client.poses()


@pytest.fixture(scope='module')
def log(suite, heard):
    """That of a run whose simulator was killed in the middle, and started again."""
    suite.client.dropping('tetrahedron', DROPS, seed=11)
    suite.client.wait(lambda: heard, 'first batch')
    suite.processes['drop_simulator'].end(signal.SIGKILL)
    suite.start_again('drop_simulator')
    return suite.log_of(heard[0].run.run_id)


def assert_whole(contents, heard):
    run = contents.run.run
    assert contents.outcome.whole
    assert (contents.outcome.drops, run.drops, run.first_drop, run.seed) == (DROPS, DROPS, 0, 11)
    assert run.run_id == heard[0].run.run_id


def test_every_batch_describes_the_run_as_the_first_did(suite, heard, log):
    assert_whole(read_contents(log), heard)
    assert any(batch.first_drop for batch in heard)
    assert all(batch.run == heard[0].run for batch in heard)


def start_again(suite, node, seed):
    """What it says, once it has heard all that the simulator has published."""
    assert suite.processes[node].end() == 0
    suite.start_again(node)
    drop = suite.client.drop(drops=5, seed=seed)  # of one publisher, batches come in their order
    if node == 'drop_recorder':
        suite.log_of(drop.result.run_id)
    else:
        suite.client.wait(lambda: known(suite, 5, seed), 'last run')
    return suite.processes[node].said


def known(suite, drops, seed):
    answer = suite.client.ask(drops=drops, seed=[seed], only_known=True)
    return answer.status.code == Status.OK and answer.distribution


def test_a_classifier_that_is_started_again_knows_all_drops_from_the_log(suite, heard, log):
    said = start_again(suite, 'aspect_classifier', 12)
    distribution = known(suite, DROPS, 11)
    assert (distribution.drops, distribution.run) == (DROPS, heard[0].run)
    assert 'asking again' not in said


def test_a_recorder_that_is_started_again_knows_the_log(suite, heard, log):
    said = start_again(suite, 'drop_recorder', 13)
    assert f'is in {log} already' in said
    assert 'asking again' not in said
    recorded = suite.client.listen(RecordedRun, RECORDED_RUNS, ALL_LATCHED)

    def of_the_run():
        run_id = heard[0].run.run_id
        return [run for run in recorded if run.run_id == run_id and run.log == str(log)]

    suite.client.wait(of_the_run, 'word of the log')
    assert {(run.drops, run.whole, run.error) for run in of_the_run()} == {(DROPS, True, '')}


def test_a_recorder_that_has_heard_only_the_end_asks_for_the_rest(
    suite, heard, log, start, tmp_path
):
    """The second simulator has published no drop of the beginning."""
    late = start('drop_recorder', suite.namespace, {'log_folder': tmp_path}, QUICK)
    path = tmp_path / log.name
    suite.client.wait((path / 'metadata.yaml').exists, 'log')
    assert_whole(read_contents(path), heard)
    assert late.end() == 0


@pytest.fixture
def two_goals(suite, heard, log):
    """Ask twice for the same lost drops, while the workers are held up."""
    ask = functools.partial(
        suite.client.dropping, drops=300, first_drop=1000, seed=11, run_id=heard[0].run.run_id
    )
    simulator = suite.processes['drop_simulator']
    assert simulator.send_to_workers(signal.SIGSTOP)
    goals = []
    for _ in range(2):
        goals.append(ask())
        suite.client.wait(lambda: goals[-1].accepted, 'goal')
    yield goals
    simulator.send_to_workers(signal.SIGCONT)


def test_drops_that_two_ask_for_at_once_are_made_once(suite, heard, two_goals):
    before = len(heard)
    suite.processes['drop_simulator'].send_to_workers(signal.SIGCONT)
    suite.client.wait(lambda: all(goal.done for goal in two_goals), 'both')
    one, other = (goal.result for goal in two_goals)
    assert (one.status.code, one.drops, one.settled) == (Status.OK, 300, other.settled)
    assert (other.status, other.run_id, other.drops) == (one.status, one.run_id, 300)
    last = suite.client.drop(drops=1, seed=14).result.run_id
    suite.client.wait(lambda: heard[-1].run.run_id == last, 'last batch')
    again = [batch for batch in heard[before:] if batch.run == heard[0].run]
    assert [len(batch.poses) for batch in again] == [250, 50]


def test_drops_of_which_one_goal_is_canceled_are_made_for_the_other(suite, two_goals):
    canceled, other = two_goals
    answer = canceled.cancel()
    suite.client.wait(answer.done, 'cancel')
    suite.processes['drop_simulator'].send_to_workers(signal.SIGCONT)
    suite.client.wait(lambda: canceled.done and other.done, 'both')
    assert (canceled.outcome, other.outcome) == ('canceled', 'succeeded')
    assert canceled.result.drops < other.result.drops == 300


def test_a_description_of_another_run_is_refused(suite, heard, log):
    run = heard[0].run
    refused = suite.client.drop(drops=5, seed=11, run_id='another', run=[run]).result.status
    assert refused.code == Status.INVALID
    assert refused.message == f"run.run_id is {run.run_id!r}, allowed is run_id: 'another'"
    refused = suite.client.drop(drops=5, seed=12, run_id=run.run_id, run=[run]).result.status
    assert refused.code == Status.INVALID
    assert refused.message.startswith(f'run {run.run_id} is of tetrahedron under other conditions')
