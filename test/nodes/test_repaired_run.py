"""Drops of a run that are published again, for consumers that lost them."""

import functools
import signal

import pytest
from resting_aspects_interfaces.msg import RecordedRun, Status

from resting_aspects_ros.ros.interface import ALL_LATCHED, RECORDED_RUNS

DROPS = 1500


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite()


@pytest.fixture(scope='module')
def received(suite):
    return suite.client.poses()


@pytest.fixture(scope='module')
def run(suite, received):
    """A run that is over."""
    drop = suite.client.dropping_in_bullet('tetrahedron', DROPS, seed=11)
    suite.client.wait(lambda: drop.done, 'run')
    suite.client.wait(lambda: any(batch.last for batch in received), 'last batch')
    assert received[0].run.run_id == drop.result.run_id
    return received[0].run


@pytest.mark.slow
def test_restarted_recorder_finds_its_log(suite, run):
    log = suite.log_of(run.run_id)
    assert suite.processes['drop_recorder'].end() == 0
    suite.start_again('drop_recorder')
    recorded = suite.client.listen(RecordedRun, RECORDED_RUNS, ALL_LATCHED)

    def of_the_run():
        return [each for each in recorded if each.run_id == run.run_id and each.log == str(log)]

    suite.client.wait(of_the_run, 'message about the log')
    assert {(run.drops, run.whole, run.error) for run in of_the_run()} == {(DROPS, True, '')}
    recorder = suite.processes['drop_recorder']
    suite.client.wait(lambda: f'is already in {log}' in recorder.output, 'log line')
    assert 'requested again' not in recorder.output


@pytest.fixture
def two_goals(suite, run):
    """Ask twice for the same lost drops, while the workers are held up."""
    ask = functools.partial(
        suite.client.dropping_in_bullet,
        drops=300,
        first_drop=1000,
        seed=11,
        run_id=run.run_id,
    )
    simulator = suite.processes['drop_simulator']
    assert simulator.send_to_workers(signal.SIGSTOP)
    goals = []
    for _ in range(2):
        goals.append(ask())
        suite.client.wait(lambda: goals[-1].accepted, 'goal')
    yield goals
    simulator.send_to_workers(signal.SIGCONT)


@pytest.mark.slow
def test_concurrent_repairs_are_simulated_once(suite, received, run, two_goals):
    before = len(received)
    suite.processes['drop_simulator'].send_to_workers(signal.SIGCONT)
    suite.client.wait(lambda: all(goal.done for goal in two_goals), 'both')
    one, other = (goal.result for goal in two_goals)
    assert (one.status.code, one.drops, one.settled) == (Status.OK, 300, other.settled)
    assert (other.status, other.run_id, other.drops) == (one.status, one.run_id, 300)
    last = suite.client.drop(drops=1, seed=14).result.run_id
    suite.client.wait(lambda: received[-1].run.run_id == last, 'last batch')
    again = [batch for batch in received[before:] if batch.run == run]
    assert [len(batch.poses) for batch in again] == [250, 50]


@pytest.mark.slow
def test_canceled_repair_does_not_affect_the_other(suite, two_goals):
    canceled, other = two_goals
    answer = canceled.cancel()
    suite.client.wait(lambda: answer.done() and canceled.done, 'cancel')
    suite.processes['drop_simulator'].send_to_workers(signal.SIGCONT)
    suite.client.wait(lambda: other.done, 'the other')
    assert (canceled.outcome, other.outcome) == ('canceled', 'succeeded')
    assert canceled.result.drops < other.result.drops == 300


@pytest.mark.slow
def test_only_runs_of_this_simulator_are_repaired(suite, run):
    refused = suite.client.drop(drops=5, seed=11, run_id='another').result.status
    assert refused.code == Status.NOT_AVAILABLE
    assert refused.message.startswith('run another was not made by this simulator')
    refused = suite.client.drop(drops=5, seed=12, run_id=run.run_id).result.status
    assert refused.code == Status.INVALID
    assert refused.message.startswith(f'invalid request for drops of run {run.run_id}: expected ')
