"""Requests that come at the same time, clients that leave, and suites side by side."""

import re
import signal
import sys

import pytest
from resting_aspects_interfaces.msg import Status


def test_identical_concurrent_requests_share_a_run(suite, counts):
    received = suite.client.poses()
    asked = [suite.client.asking('tetrahedron', 50_000, seed=[3]) for _ in range(12)]
    suite.client.wait(lambda: all(answer.done() for answer in asked), 'answers')
    answers = [answer.result() for answer in asked]
    assert {answer.status.code for answer in answers} == {Status.OK}
    (run_id,) = {answer.distribution.run.run_id for answer in answers}
    assert len({counts(answer.distribution) for answer in answers}) == 1

    def of_the_seed():
        return [batch for batch in received if batch.run.seed == 3 and batch.run.drops == 50_000]

    suite.client.wait(lambda: of_the_seed() and of_the_seed()[-1].last, 'batches')
    assert {batch.run.run_id for batch in of_the_seed()} == {run_id}


def test_concurrent_requests_for_two_parts_are_answered(suite, counts):
    names = ('tetrahedron', 'box_10x20x30')
    asked = {name: suite.client.asking(name, 130, seed=[4]) for name in names}
    suite.client.wait(lambda: all(answer.done() for answer in asked.values()), 'answers')
    for name in names:
        answer = asked[name].result()
        assert answer.status.code == Status.OK
        assert answer.distribution.run.part == name
        assert answer.distribution.drops == sum(counts(answer.distribution)) == 130
    aspects = {name: len(asked[name].result().distribution.aspects) for name in names}
    assert aspects == {'tetrahedron': 4, 'box_10x20x30': 6}


def test_known_answer_does_not_wait_for_an_active_run(suite):
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    long = suite.client.dropping('tetrahedron', 2_000_000, seed=61)
    suite.client.wait(lambda: long.accepted, 'long goal')
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    assert suite.client.parts()['tetrahedron'].known
    assert not long.done
    long.cancel()
    suite.client.wait(lambda: long.done, 'canceled goal')


@pytest.mark.slow
def test_result_is_kept_after_the_client_was_killed(suite, run_command):
    received = suite.client.poses()
    ros = ('--ros-args', '-r', f'__ns:={suite.namespace}')
    command = ('request', 'tetrahedron', '--drops', '400', '--seed', '77')
    client = run_command(sys.executable, '-m', 'resting_aspects_ros.cli', *command, *ros)

    def of_its_run():
        return [batch for batch in received if batch.run.seed == 77]

    suite.client.wait(of_its_run, 'first batch')
    assert not any(batch.last for batch in of_its_run())
    client.end(signal.SIGKILL)

    def known():
        answer = suite.client.ask('tetrahedron', 400, seed=[77], only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    assert suite.client.wait(known, 'distribution').drops == 400
    assert suite.alive


def test_killed_worker_loses_no_drop(suite):
    simulator = suite.processes['drop_simulator']
    drop = suite.client.dropping_in_bullet('tetrahedron', 500, seed=15)
    suite.client.wait(lambda: drop.feedback, 'first feedback')
    assert simulator.send_to_workers(signal.SIGKILL) >= 1
    suite.client.wait(lambda: drop.done, 'goal')
    assert drop.outcome == 'succeeded'
    assert drop.result.drops == 500
    # rclpy hands over no feedback that comes after the result.
    done = [feedback.done for feedback in drop.feedback]
    assert done
    assert done == [125, 250, 375, 500][: len(done)]
    suite.client.wait(
        lambda: re.search(
            r'a worker died near drop \d+ of tetrahedron: its drops are repeated', simulator.output
        ),
        'word of it',
    )


def test_killed_idle_worker_loses_no_drop(suite):
    first = suite.client.dropping_in_bullet('tetrahedron', 5)
    suite.client.wait(lambda: first.done, 'first goal')
    assert suite.processes['drop_simulator'].send_to_workers(signal.SIGKILL) >= 1
    drop = suite.client.dropping_in_bullet('tetrahedron', 5, seed=2)
    suite.client.wait(lambda: drop.done, 'second goal')
    assert drop.result.status.message == ''
    assert drop.outcome == 'succeeded'


def test_repeatedly_killed_workers_fail_the_goal(suite):
    simulator = suite.processes['drop_simulator']
    drop = suite.client.dropping_in_bullet('tetrahedron', 100_000, seed=16)

    def killed_until_done():
        simulator.send_to_workers(signal.SIGKILL)
        return drop.done

    suite.client.wait(killed_until_done, 'goal that fails')
    assert drop.outcome == 'aborted'
    assert drop.result.status.code == Status.FAILED
    assert 'worker processes died in a row' in drop.result.status.message
    assert suite.client.drop('tetrahedron', 5).outcome == 'succeeded'


def test_suites_in_two_namespaces_are_independent(suite, fresh_suite):
    other = fresh_suite()
    here, there = suite.client.poses(), other.client.poses()
    run_id = other.client.ask('tetrahedron', 6, seed=[5501]).distribution.run.run_id
    other.client.wait(lambda: there and there[-1].last, 'batches there')
    answer = suite.client.ask('tetrahedron', 6, seed=[5501], only_known=True)
    assert answer.status.code == Status.NOT_AVAILABLE
    # What is dropped here now comes after anything that could have come from there.
    mine = suite.client.drop('tetrahedron', 1, seed=56).result.run_id
    suite.client.wait(lambda: here and here[-1].run.run_id == mine, 'batches here')
    assert run_id not in {batch.run.run_id for batch in here}
    assert [batch.run.run_id for batch in there] == [run_id]
    log = other.log_of(run_id)
    assert other.logs.samefile(log.parent)
    assert not list(suite.logs.glob(f'*_{run_id}*'))
