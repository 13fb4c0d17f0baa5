"""What only real processes show: signals, exit codes, kills, and a replay at full speed."""

import json
import os
import random
import re
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import RestingPoses, Status
from ros_graph import Diagnostics
from rosbags.highlevel import AnyReader

from resting_aspects_ros.api.conditions import with_surroundings
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.main import main
from resting_aspects_ros.client import NotAvailableError, RestingAspectsClient, connection
from resting_aspects_ros.logs.bag import recorded_outcome
from resting_aspects_ros.logs.writer import recover_log
from resting_aspects_ros.ros.conversions import conditions_msg, poses_from
from resting_aspects_ros.ros.interface import POSES, RESTING_POSES
from resting_aspects_ros.statistics.distribution import count_poses

MANY = 2_000_000  # drops of a run that does not end by itself
# Shorter timeouts, which do not change the tested behaviour.
QUICK = {
    'aspect_classifier': {
        'ros.goal_client.RETRY_PERIOD': 1.0,
        'ros.goal_client.STARTUP_TIMEOUT': 1.0,
        'ros.goal_client.DISCOVERY_TIMEOUT': 1.0,
    },
    'drop_recorder': {'nodes.drop_recorder.node.IDLE_WITHOUT_SOURCE': 1.0},
}
TRACEBACK = re.compile('Traceback|Exception ignored|never retrieved')
SLOW = pytest.mark.slow


@pytest.fixture(scope='module')
def suite(processes):
    return processes(QUICK)


# -- starting and stopping ------------------------------------------------------------------------


def test_command_answers_a_request_and_ends_in_order_during_a_run(
    run_command, connect, namespace, wait, tmp_path, capfd
):
    """`resting_aspects nodes` is the suite in one process."""
    ros = ('--ros-args', '-r', f'__ns:={namespace}')
    logs = tmp_path / 'logs'
    command = (sys.executable, '-m', 'resting_aspects_ros.cli', 'nodes', *ros)
    nodes = run_command(*command, '-p', f'log_folder:={logs}')
    wait(lambda: nodes.output.count('ready') == 3 or not nodes.running, 'three nodes')
    assert nodes.running, nodes.output
    arguments = ('request', 'tetrahedron', '--drops', '30', '--seed', '3', '--json')
    assert main([*arguments, *ros]) == 0
    assert json.loads(capfd.readouterr().out)['drops'] == 30
    client = connect(namespace)
    received = client.poses()
    drop = client.dropping('tetrahedron', MANY, seed=4)

    def log():
        runs = {batch.run.run_id for batch in received if batch.run.seed == 4}
        return [(run, each) for run in runs for each in logs.glob(f'*_{run}')]

    client.wait(lambda: drop.feedback and log(), 'first feedback, and a log')
    ((run_id, folder),) = log()
    nodes.send_to_group(signal.SIGINT)  # a terminal sends it to the workers, too
    assert nodes.end(0) == 0
    assert not TRACEBACK.search(nodes.output), nodes.output
    wait(lambda: nodes.group() == [], 'end of all its processes')
    assert re.search(
        rf'run {run_id} of tetrahedron was interrupted: the closed log {folder} has \d+ of {MANY}',
        nodes.output,
    )


def test_node_that_cannot_start_prints_one_error_line(start_process, namespace):
    process = start_process('drop_simulator', namespace, {'workers': 2000}, ready='')
    assert process.end(0) == 2
    (line,) = [line for line in process.output.splitlines() if line.startswith('error: ')]
    assert 'workers out of range. Min: 0, Max: 1024' in line
    assert not TRACEBACK.search(process.output)


@SLOW
def test_workers_end_with_a_killed_simulator(start_process, connect, namespace, wait):
    simulator = start_process('drop_simulator', namespace, {'workers': 1})
    client = connect(namespace)
    client.drop('tetrahedron', 1, surroundings='bowl_track')  # the kernel has threads
    assert simulator.send_to_workers(0) == 1
    simulator.end(signal.SIGKILL)
    wait(lambda: simulator.group() == [], 'end of its workers')


def resident(suite):
    """MB of each node."""
    page = os.sysconf('SC_PAGE_SIZE') / 1e6
    return {
        name: int(Path(f'/proc/{process.pid}/statm').read_text().split()[1]) * page
        for name, process in suite.nodes.items()
    }


@SLOW
def test_memory_does_not_grow_under_mixed_requests(suite, surfaces):
    client, rng, codes = suite.client, random.Random(8), set()
    quick = [conditions_msg(surfaces.get().changed(height=1e-3, restitution=0.0))]

    def ask(count):
        for _ in range(count):
            name = rng.choice(['tetrahedron', 'box_10x20x30', 'nothing'])
            seed = rng.randrange(10**9)
            if rng.randrange(5):
                answer = client.ask(name, rng.randint(1, 60), seed=[seed], conditions=quick)
            else:
                goal = client.dropping(name, 20_000, seed=seed, conditions=quick)
                answer = client.canceled(goal).result
            codes.add(answer.status.code)

    ask(30)
    before = resident(suite)
    ask(60)
    after = resident(suite)
    assert codes <= {Status.OK, Status.UNKNOWN_PART, Status.CANCELED}
    for name, mb in after.items():
        assert mb < 1.1 * before[name], (before, after)


# -- nodes that die -------------------------------------------------------------------------------


@SLOW
def test_repeatedly_killed_workers_fail_the_goal(suite):
    client, simulator = suite.client, suite.nodes['drop_simulator']
    goal = client.reorienting('box_10x20x30', 'tap', 100_000, 20, surroundings='bowl_track')
    client.wait(lambda: goal.feedback and goal.feedback[-1].done, 'actions')

    def ended():
        simulator.send_to_workers(signal.SIGKILL)  # there may be none that is alive
        return goal.done

    client.wait(ended, 'goal that fails')
    assert (goal.outcome, goal.result.status.code) == ('aborted', Status.FAILED)
    assert 'died in a row' in goal.result.status.message
    assert sum(goal.result.transitions.actions) > 0
    assert client.drop('tetrahedron', 5).outcome == 'succeeded'


@SLOW
def test_restarted_classifier_answers_a_waiting_client(suite, surfaces, monkeypatch):
    monkeypatch.setattr(connection, 'RETRY_PERIOD', 1.0)
    slow = with_surroundings(surfaces.get(), 'bowl_track')
    received = []
    with RestingAspectsClient(suite.client.node) as client:
        answer = client.get_distribution_async(
            'tetrahedron', drops=700, conditions=slow, seed=82, progress=received.append
        )
        suite.client.wait(lambda: received, 'progress')
        suite.nodes['aspect_classifier'].end(signal.SIGKILL)
        assert not answer.done()
        suite.start_again('aspect_classifier')
        suite.client.wait(answer.done, 'answer of the new classifier')
    assert (answer.result().drops, answer.result().run.seed) == (700, 82)


# Last test of the suite: ROS lists a killed node for another 20 s.
@SLOW
def test_killed_simulator_is_reported(suite):
    client, diagnostics = suite.client, Diagnostics(suite.client)
    received = client.poses()
    client.dropping('tetrahedron', MANY, seed=90)

    def runs():
        return [batch.run.run_id for batch in received if batch.run.seed == 90]

    run_id = client.wait(runs, 'first message')[0]
    progress = []
    with RestingAspectsClient(client.node) as python:
        answer = python.get_distribution_async(
            'box_10x20x30', drops=MANY, seed=91, progress=progress.append
        )
        client.wait(lambda: progress, 'progress')
        suite.nodes['drop_simulator'].end(signal.SIGKILL)
        client.wait(answer.done, 'error')
        with pytest.raises(NotAvailableError, match='the simulator stopped while it '):
            answer.result()
    for node in ('aspect_classifier', 'drop_recorder'):
        # A killed recorder that is still known can be named before.
        diagnostics.wait(
            node, lambda _, message, __: 'no drop_simulator' in message, f'{node} misses it'
        )
    refused = client.ask(drops=MANY, seed=[99]).status
    assert refused.code == Status.NOT_AVAILABLE
    assert 'no drop_simulator answers' in refused.message
    assert not recorded_outcome(suite.log_of(run_id)).whole
    suite.start_again('drop_simulator')
    client.wait(lambda: not client.ask(drops=5, seed=[46]).status.code, 'good answer')


BATCHES, BATCH = 200, 250


def reported_drops(process):
    """Return how many drops a recorder reports as written."""
    found = re.findall(r' (\d+) drops are in .*\n', process.output)
    return max(map(int, found), default=0)


@SLOW
def test_killed_recorder_loses_no_reported_drops(
    connect, start_process, namespace, batches, wait, tmp_path
):
    client = connect(namespace)
    published = list(batches(BATCHES, 'killed'))
    publisher = client.node.create_publisher(RestingPoses, RESTING_POSES, POSES)
    for data in published:
        publisher.publish(data)  # it has them still for the recorder
    debug = ('--log-level', f'{namespace[1:]}.drop_recorder:=debug')
    given = {'log_folder': tmp_path}
    recorder = start_process('drop_recorder', namespace, given, arguments=debug, ready='')
    some = BATCH * random.randint(1, BATCHES // 2)
    wait(lambda: reported_drops(recorder) >= some, 'batches', step=lambda: time.sleep(0.001))
    recorder.end(signal.SIGKILL)
    (log,) = tmp_path.glob('*_killed')
    recover_log(log)
    with AnyReader([log]) as reader:
        of_poses = [each for each in reader.connections if each.topic.endswith(RESTING_POSES)]
        recovered = [bytes(data) for *_, data in reader.messages(of_poses)]
    assert recovered == published[: len(recovered)]
    # A batch may be written but not reported yet.
    assert len(recovered) - 1 <= reported_drops(recorder) / BATCH <= len(recovered)


# -- replays --------------------------------------------------------------------------------------


@SLOW
def test_replay_at_full_speed_loses_nothing(
    start_process, connect, namespace, wait, batches, write_log, part, tmp_path
):
    written = list(batches(160))
    once = count_poses(
        find_aspects(part('tetrahedron')),
        poses_from(deserialize_message(written[0], RestingPoses)),
    )
    start_process('aspect_classifier', namespace, {'log_folder': "''"})
    client = connect(namespace)
    received = client.listen(RestingPoses, 'resting_poses', POSES, raw=True)
    given = {'log': write_log(tmp_path, written, gap=0.4), 'as_fast_as_possible': True}
    replayer = start_process('log_replayer', namespace, given)
    wait(lambda: 'replayed in ' in replayer.output, 'end of the log')  # the client does not spin
    assert f': {len(written) + 1} messages; ' in replayer.output
    client.wait(lambda: len(received) == len(written), 'all batches')
    assert received == written
    found = client.known(drops=160 * BATCH, surface='rubber_mat', seed=[1])
    assert [aspect.count for aspect in found.aspects] == (160 * once.counts).tolist()
    assert replayer.end() == 0


@SLOW
def test_damage_during_a_replay_ends_it(
    start_process, connect, namespace, batches, write_log, tmp_path
):
    log = write_log(tmp_path, batches(20), gap=0.2)
    path = Path(shutil.copy(next(log.glob('*.mcap')), tmp_path / 'copy.mcap'))
    client = connect(namespace)
    received = client.poses()
    replayer = start_process('log_replayer', namespace, {'log': path, 'loop': True})
    client.wait(lambda: received, 'first batch')
    with path.open('r+b') as file:
        file.write(b'no log any more')
    client.wait(lambda: not replayer.running, 'its end')
    assert replayer.end(0) == 1
    assert f"error: log '{path}' is damaged" in replayer.output
    assert not TRACEBACK.search(replayer.output)
