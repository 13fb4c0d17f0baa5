"""The suite under load: concurrent clients, slow subscribers, cancels and damaged files."""

import random
import shutil
import signal
import sys

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.simulation.conditions import parts_folder

PARTS = ('tetrahedron', 'box_10x20x30', 'l_bracket', 'hex_nut', 'washer')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('parts')
    for name in (*PARTS, 'cylinder_d20_h20'):
        for file in parts_folder().glob(f'{name}.*'):
            shutil.copy(file, folder)
    return folder


@pytest.fixture(scope='module')
def suite(fresh_suite, folder):
    return fresh_suite(
        {'drop_simulator': {'nodes.drop_simulator.part_publisher.SCAN_PERIOD': 0.2}},
        parts_folder=folder,
    )


@pytest.mark.slow
def test_ten_concurrent_clients_request_five_parts(suite, connect, counts):
    clients = [connect(suite.namespace) for _ in range(10)]
    asked = [client.asking(PARTS[k % 5], 150, seed=[1]) for k, client in enumerate(clients)]

    def all_answered():
        for client in clients:
            client.spin(0.01)
        return all(answer.done() for answer in asked)

    suite.client.wait(all_answered, 'answers')
    answers = [answer.result() for answer in asked]
    assert {answer.status.code for answer in answers} == {Status.OK}
    for name, one, other in zip(PARTS, answers[:5], answers[5:], strict=True):
        assert one.distribution.run.part == name
        assert counts(one.distribution) == counts(other.distribution)
        assert sum(counts(one.distribution)) == 150


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize('drops', [1500, pytest.param(100_000, marks=pytest.mark.slow)])
def test_slow_subscriber_receives_a_long_run(suite, connect, quick, drops):
    slow = connect(suite.namespace)
    received = slow.poses()
    # The topic is discovered before the run starts.
    suite.client.drop('tetrahedron', 1, seed=100)
    slow.wait(lambda: received, 'first batch')
    drop = suite.client.dropping('tetrahedron', drops, seed=drops, conditions=quick)

    def done():
        slow.spin(0.001)  # a batch or two
        suite.client.spin(0.2)
        return drop.done

    suite.client.wait(done, 'run', seconds=2000)
    assert drop.result.drops == drops
    slow.wait(lambda: received[-1].last and received[-1].run.seed == drops, 'last batch')
    batches = [batch for batch in received if batch.run.seed == drops]
    ends = [batch.first_drop + len(batch.status) for batch in batches]
    assert [batch.first_drop for batch in batches] == [0, *ends[:-1]]
    assert ends[-1] == drops
    answer = suite.client.ask(drops=drops, seed=[drops], conditions=quick, only_known=True)
    assert answer.distribution.drops == drops


@pytest.mark.slow
@pytest.mark.parametrize('times', [5, 50])
def test_goal_is_canceled_at_random_times(suite, quick, times):
    rng = random.Random(3)
    received = suite.client.poses()
    for k in range(times):
        seed = 10_000 * times + k
        drop = suite.client.dropping('box_10x20x30', 2_000_000, seed=seed, conditions=quick)
        suite.client.wait(lambda d=drop: d.accepted, 'goal')
        suite.client.spin(rng.uniform(0, 0.2))
        drop.cancel()
        suite.client.wait(lambda d=drop: d.done, 'end of the goal')
        assert drop.outcome == 'canceled'
        assert drop.result.status.code == Status.CANCELED

        def batches(seed=seed):
            return [batch for batch in received if batch.run.seed == seed]

        if drop.result.run_id:  # otherwise it was canceled before its run started
            suite.client.wait(lambda b=batches: b() and b()[-1].last, 'last batch')
        assert sum(len(batch.status) for batch in batches()) == drop.result.drops
    assert suite.alive
    assert suite.client.drop('box_10x20x30', 10).outcome == 'succeeded'


@pytest.mark.slow
def test_part_file_is_damaged_during_its_run(suite, folder, quick):
    mesh = folder / 'cylinder_d20_h20.stl'
    whole = mesh.read_bytes()
    drop = suite.client.dropping('cylinder_d20_h20', 2000, seed=4, conditions=quick)
    suite.client.wait(lambda: drop.feedback, 'first drops')
    mesh.write_bytes(b'solid rubbish\0\xff' * 100)
    suite.client.wait(lambda: drop.done, 'run')
    assert (drop.outcome, drop.result.drops) == ('succeeded', 2000)
    refused = suite.client.drop('cylinder_d20_h20', 10, seed=5)
    assert (refused.outcome, refused.result.status.code) == ('aborted', Status.INVALID)
    assert 'cylinder_d20_h20.stl' in refused.result.status.message
    mesh.write_bytes(whole)
    assert suite.client.drop('cylinder_d20_h20', 10, seed=5).outcome == 'succeeded'
    assert suite.alive


@pytest.mark.slow
def test_sigterm_during_runs_stops_all_nodes(run_command, connect, namespace, wait, tmp_path):
    ros = ('--ros-args', '-r', f'__ns:={namespace}', '-p', f'log_folder:={tmp_path}')
    nodes = run_command(sys.executable, '-m', 'resting_aspects_ros.cli', 'nodes', *ros)
    wait(lambda: nodes.output.count('ready') == 3 or not nodes.running, 'nodes')
    client = connect(namespace)
    drops = [client.dropping(name, 2_000_000, seed=6) for name in PARTS]
    asked = [client.asking(name, 1_000_000, seed=[7]) for name in PARTS]
    client.wait(lambda: all(drop.feedback for drop in drops), 'drops')
    client.wait(lambda: len(list(tmp_path.iterdir())) >= len(PARTS), 'logs')
    drops[0].cancel()
    assert nodes.end(signal.SIGTERM) == 0
    wait(lambda: nodes.group() == [], 'end of all its processes')
    assert not [line for line in nodes.output.splitlines() if 'Traceback' in line]
    for log in tmp_path.iterdir():
        assert (log / 'metadata.yaml').is_file(), log
    assert not any(answer.done() for answer in asked)
