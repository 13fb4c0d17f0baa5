"""All nodes in one process: `resting_aspects nodes`, asked by `resting_aspects request`."""

import json
import re
import signal
import sys

import pytest

from resting_aspects_ros.cli.main import main

COMMAND = [sys.executable, '-m', 'resting_aspects_ros.cli']


@pytest.fixture
def nodes(run_command, wait, namespace, tmp_path):
    """The suite in one process."""
    ros = ('--ros-args', '-r', f'__ns:={namespace}', '-p', f'log_folder:={tmp_path / "logs"}')
    process = run_command(*COMMAND, 'nodes', *ros)
    wait(lambda: process.output.count('ready') == 3 or not process.running, 'three nodes')
    assert process.running, process.output
    return process


@pytest.fixture
def request_json(namespace, capfd):
    """Run `resting_aspects request ... --json` and give the document."""

    def request_json(*expected):
        assert (
            main(['request', *expected, '--json', '--ros-args', '-r', f'__ns:={namespace}']) == 0
        )
        return json.loads(capfd.readouterr().out)

    return request_json


def assert_ended_in_order(process, code, wait, traceback):
    assert code == 0
    assert not traceback(process.output), process.output
    assert 'rror' not in process.output
    wait(lambda: process.group() == [], 'end of all its processes')


@pytest.fixture
def end_during_a_run(nodes, connect, namespace, wait, traceback, tmp_path):
    """End the nodes during a run, and check their output and the files they leave."""

    def end_during_a_run(end):
        client = connect(namespace)
        # From the last drop of a chunk on: feedback comes after one drop.
        drop = client.dropping('tetrahedron', 2_000_000, first_drop=499)

        def log():
            runs = {batch.run.run_id for batch in received if batch.run.drops == 2_000_000}
            found = [(run, log) for run in runs for log in (tmp_path / 'logs').glob(f'*_{run}')]
            return next(iter(found), None)

        received = client.poses()
        client.wait(lambda: drop.feedback and log(), 'first feedback, and a log')
        assert not drop.done
        assert len(nodes.group()) > 1  # it has a process that reads files
        assert_ended_in_order(nodes, end(), wait, traceback)
        run_id, folder = log()
        expected = (
            rf'run {run_id} of tetrahedron was interrupted: the closed log '
            rf'{folder} has \d+ of 2000000 drops'
        )
        assert re.search(expected, nodes.output)

    return end_during_a_run


def test_request_is_answered_and_ctrl_c_ends_all(
    nodes, request_json, wait, tmp_path, end_during_a_run
):
    document = request_json('tetrahedron', '--drops', '30', '--seed', '3')
    assert (document['part'], document['drops'], document['seed']) == ('tetrahedron', 30, 3)
    counted = sum(aspect['count'] for aspect in document['aspects'])
    assert counted + sum(document[k] for k in ('unclassified', 'unsettled', 'failed')) == 30
    assert request_json('tetrahedron', '--drops', '30', '--only-known') == document
    wait(lambda: list(tmp_path.glob('logs/tetrahedron_*/metadata.yaml')), 'log')

    def ctrl_c():
        nodes.send_to_group(signal.SIGINT)  # a terminal sends it to the workers, too
        return nodes.end(0)

    end_during_a_run(ctrl_c)


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_command_stops_cleanly_during_a_run(nodes, end_during_a_run, number):
    end_during_a_run(lambda: nodes.end(number))


def test_workers_end_with_a_killed_simulator(start, connect, namespace, wait):
    simulator = start('drop_simulator', namespace, {'workers': 1})
    client = connect(namespace)
    drop = client.dropping_in_bullet('tetrahedron', 1)
    client.wait(lambda: drop.done, 'drop')
    assert simulator.send_to_workers(0) == 1
    simulator.end(signal.SIGKILL)
    wait(lambda: simulator.group() == [], 'end of its workers')


@pytest.mark.slow
def test_waiting_nodes_use_little_processor_time(suite):
    """Idle, and while a request waits for a simulator that is held up.

    The window is 2 s, and the bound 0.3 s for each node: rclpy's timers and a look at the topics
    five times a second take about 0.04 s, a loop that waits for nothing takes the whole 2 s.
    """
    window, most = 2.0, 0.3
    suite.client.ask('tetrahedron', 1)

    def used():
        before = {name: process.cpu() for name, process in suite.processes.items()}
        suite.client.spin(window)
        return {name: process.cpu() - before[name] for name, process in suite.processes.items()}

    idle = used()
    assert max(idle.values()) < most, idle

    suite.processes['drop_simulator'].send_to_group(signal.SIGSTOP)
    try:
        asked = suite.client.asking('tetrahedron', 2)
        waiting = used()
    finally:
        suite.processes['drop_simulator'].send_to_group(signal.SIGCONT)
    assert max(waiting.values()) < most, waiting
    suite.client.wait(asked.done, 'answer')
