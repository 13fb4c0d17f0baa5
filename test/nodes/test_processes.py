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
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import RestingPoses, Status
from rosbags.highlevel import AnyReader

from resting_aspects_ros.api.conditions import with_surroundings
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.main import main
from resting_aspects_ros.client import NotAvailableError, RestingAspectsClient, connection
from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.ros.conversions import poses_from
from resting_aspects_ros.ros.interface import POSES
from resting_aspects_ros.simulation.conditions import surfaces_file
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


@pytest.fixture(scope='module')
def suite(processes):
    return processes(QUICK)


@pytest.fixture(scope='module')
def received(suite):
    return suite.client.poses()


@pytest.fixture
def begin(suite, received):
    """Begin a run; return its goal and its run id once a message has arrived."""

    def begin(dropping, seed, drops=MANY):
        goal = dropping('tetrahedron', drops, seed=seed)

        def run_ids():
            return [batch.run.run_id for batch in received if batch.run.seed == seed]

        return goal, suite.client.wait(run_ids, 'first message')[0]

    return begin


def recorded(folder):
    """Return the indices of the drops in a log, in their order."""
    found = []
    with AnyReader([folder]) as reader:
        for connection_, _, data in reader.messages():
            if connection_.topic.endswith('/resting_poses'):
                batch = reader.deserialize(data, connection_.msgtype)
                found += range(batch.first_drop, batch.first_drop + len(batch.status))
    return found


# -- starting and stopping ------------------------------------------------------------------------


@pytest.fixture
def nodes(run_command, wait, namespace, tmp_path):
    """`resting_aspects nodes`, the suite in one process."""
    ros = ('--ros-args', '-r', f'__ns:={namespace}', '-p', f'log_folder:={tmp_path / "logs"}')
    process = run_command(sys.executable, '-m', 'resting_aspects_ros.cli', 'nodes', *ros)
    wait(lambda: process.output.count('ready') == 3 or not process.running, 'three nodes')
    assert process.running, process.output
    return process


@pytest.mark.parametrize(
    'number',
    [
        signal.SIGINT,
        *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGTERM, signal.SIGHUP)),
    ],
)
def test_command_answers_a_request_and_ends_in_order_during_a_run(
    nodes, connect, namespace, wait, traceback, tmp_path, capfd, number
):
    ros = ('--ros-args', '-r', f'__ns:={namespace}')
    arguments = ('request', 'tetrahedron', '--drops', '30', '--seed', '3', '--json')
    assert main([*arguments, *ros]) == 0
    document = json.loads(capfd.readouterr().out)
    assert (document['part'], document['drops'], document['seed']) == ('tetrahedron', 30, 3)
    client = connect(namespace)
    received = client.poses()
    drop = client.dropping('tetrahedron', MANY, seed=4)

    def log():
        runs = {batch.run.run_id for batch in received if batch.run.seed == 4}
        return [(run, each) for run in runs for each in (tmp_path / 'logs').glob(f'*_{run}')]

    client.wait(lambda: drop.feedback and log(), 'first feedback, and a log')
    ((run_id, folder),) = log()
    if number == signal.SIGINT:
        nodes.send_to_group(number)  # a terminal sends it to the workers, too
        number = 0
    assert nodes.end(number) == 0
    assert not traceback(nodes.output), nodes.output
    wait(lambda: nodes.group() == [], 'end of all its processes')
    assert re.search(
        rf'run {run_id} of tetrahedron was interrupted: the closed log {folder} has \d+ of {MANY}',
        nodes.output,
    )


@pytest.mark.parametrize(
    ('node', 'parameters', 'message'),
    [
        ('drop_simulator', {'workers': 2000}, 'workers out of range. Min: 0, Max: 1024'),
        ('drop_simulator', {'parts_folder': 'x' * 300}, "invalid parts_folder 'xxx"),
        ('aspect_classifier', {'surfaces_file': '{tmp}/broken.yaml'}, 'broken.yaml'),
        ('drop_recorder', {'log_folder': 5}, "'log_folder' to '5'"),
        ('feeder_controller', {'pickable_classes': '[a]'}, 'pickable_classes'),
        ('vision_example', {'qos_overrides./image.subscription.depth': '1', 'part': 5}, 'part'),
        ('log_replayer', {}, "invalid log '': expected the folder of a run, or an .mcap file"),
        ('log_replayer', {'log': '{tmp}/broken.yaml'}, 'is damaged, or not an MCAP file'),
    ],
)  # fmt: skip
def test_node_that_cannot_start_prints_one_error_line(
    start_process, namespace, tmp_path, traceback, node, parameters, message
):
    (tmp_path / 'broken.yaml').write_text('rubber_mat: [', encoding='utf-8')
    given = {name: str(value).format(tmp=tmp_path) for name, value in parameters.items()}
    process = start_process(node, namespace, given, ready='')
    assert process.end(0) == 2
    (line,) = [line for line in process.output.splitlines() if line.startswith('error: ')]
    assert message in line
    assert not traceback(process.output)


def test_file_that_is_no_parameter_file_ends_a_node(start_process, namespace):
    arguments = ('--params-file', surfaces_file())
    process = start_process('aspect_classifier', namespace, arguments=arguments, ready='')
    assert process.end(0) == 2
    assert 'Cannot have a value before ros__parameters' in process.output


def test_workers_end_with_a_killed_simulator(start_process, connect, namespace, wait):
    simulator = start_process('drop_simulator', namespace, {'workers': 1})
    client = connect(namespace)
    client.finished(client.dropping_in_bullet('tetrahedron', 1))
    assert simulator.send_to_workers(0) == 1
    simulator.end(signal.SIGKILL)
    wait(lambda: simulator.group() == [], 'end of its workers')


def test_second_recorder_of_a_namespace_needs_another_folder(
    start_process, namespace, tmp_path, traceback
):
    first = start_process('drop_recorder', namespace, {'log_folder': tmp_path})
    second = start_process('drop_recorder', namespace, {'log_folder': tmp_path}, ready='')
    assert second.end(0) == 2
    assert 'in which no other drop_recorder of this namespace writes logs' in second.output
    start_process('drop_recorder', f'{namespace}_other', {'log_folder': tmp_path})
    # After the death of the first its place is free.
    first.end(signal.SIGKILL)
    start_process('drop_recorder', namespace, {'log_folder': tmp_path})


# -- nodes that die -------------------------------------------------------------------------------


@pytest.mark.slow
def test_late_node_receives_the_whole_run(suite, received, start_process, tmp_path, counts):
    """A recorder and a classifier start in the middle of a run, and others after it."""
    drops = 2050
    # In surroundings with an edge, worker processes make the drops, which can be held up.
    asked_for = {'seed': [41], 'surroundings': 'bowl_track'}
    asked = suite.client.asking('tetrahedron', drops, **asked_for)
    suite.client.wait(lambda: any(batch.run.seed == 41 for batch in received), 'first batch')
    simulator = suite.nodes['drop_simulator']
    assert simulator.send_to_workers(signal.SIGSTOP)
    middle = start_process('drop_recorder', suite.namespace, {'log_folder': tmp_path / 'middle'})
    assert not asked.done()
    simulator.send_to_workers(signal.SIGCONT)
    suite.client.wait(asked.done, 'answer')
    expected = asked.result().distribution
    suite.nodes['aspect_classifier'].end()
    after = start_process('drop_recorder', suite.namespace, {'log_folder': tmp_path / 'after'})
    suite.start_again('aspect_classifier')
    for name, recorder in (('middle', middle), ('after', after)):
        pattern = f'{name}/*_{expected.run.run_id}/metadata.yaml'
        suite.client.wait(lambda pattern=pattern: list(tmp_path.glob(pattern)), f'log {name}')
        (metadata,) = tmp_path.glob(pattern)
        assert recorded(metadata.parent) == list(range(drops))
        assert recorder.end() == 0
    distribution = suite.client.known(drops=drops, **asked_for)
    assert (distribution.run, counts(distribution)) == (expected.run, counts(expected))


def test_killed_worker_loses_no_drop(suite, begin):
    simulator = suite.nodes['drop_simulator']
    drop, _ = begin(suite.client.dropping_in_bullet, 15, 500)
    assert simulator.send_to_workers(signal.SIGKILL) >= 1
    suite.client.finished(drop)
    assert (drop.outcome, drop.result.drops) == ('succeeded', 500)
    done = [feedback.done for feedback in drop.feedback]
    assert done == [125, 250, 375, 500][: len(done)]


@pytest.mark.parametrize('action', [False, True])
def test_repeatedly_killed_workers_fail_the_goal(suite, action):
    client, simulator = suite.client, suite.nodes['drop_simulator']
    if action:
        goal = client.reorienting('box_10x20x30', 'tap', 100_000, 20, surroundings='bowl_track')
        client.wait(lambda: goal.feedback and goal.feedback[-1].done, 'actions')
    else:
        goal = client.dropping_in_bullet('tetrahedron', 100_000, seed=16)

    def ended():
        simulator.send_to_workers(signal.SIGKILL)  # there may be none that is alive
        return goal.done

    client.wait(ended, 'goal that fails')
    assert (goal.outcome, goal.result.status.code) == ('aborted', Status.FAILED)
    assert 'died in a row' in goal.result.status.message
    if action:
        found = goal.result.transitions
        assert (found.complete, found.ended, sum(found.actions) > 0) == (False, True, True)
    assert client.drop('tetrahedron', 5).outcome == 'succeeded'


def test_killed_recorder_is_replaced_by_one_that_writes_a_whole_log(
    suite, begin, start_process, tmp_path
):
    """What the first wrote stays; the second writes a whole log beside it, and a third none."""

    def recorder():
        return start_process('drop_recorder', suite.namespace, {'log_folder': tmp_path})

    def logs():
        return sorted(tmp_path.glob(f'*{run_id}*'))

    drops = 5000  # by far more than are made before the workers are stopped
    first = recorder()
    drop, run_id = begin(suite.client.dropping_in_bullet, 10, drops)
    simulator = suite.nodes['drop_simulator']
    assert simulator.send_to_workers(signal.SIGSTOP)
    suite.client.wait(logs, 'log')
    first.end(signal.SIGKILL)
    assert not drop.done
    second = recorder()
    simulator.send_to_workers(signal.SIGCONT)
    suite.client.finished(drop)
    suite.client.wait(lambda: f'run {run_id} of tetrahedron is in ' in second.output, 'whole log')
    interrupted, whole = logs()
    assert whole.name == f'{interrupted.name}_2'
    assert not (interrupted / 'metadata.yaml').exists()
    assert recorded(whole) == list(range(drops))
    assert recorded_outcome(whole) == LogOutcome(drops, whole=True)
    assert second.end() == 0
    third = recorder()
    suite.client.wait(lambda: f'is already in {whole}' in third.output, 'word of it')
    assert third.end() == 0
    assert logs() == [interrupted, whole]


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


# Last tests of the suite: ROS lists a killed node for another 20 s.
@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_stopped_simulator_is_reported(suite, begin, diagnostics_of, number):
    client, diagnostics = suite.client, diagnostics_of(suite.client)
    asked = client.asking('tetrahedron', MANY, seed=[43 + number])
    _, run_id = begin(client.dropping, 90 + number)
    progress = []
    with RestingAspectsClient(client.node) as python:
        answer = python.get_distribution_async(
            'box_10x20x30', drops=MANY, seed=number, progress=progress.append
        )
        client.wait(lambda: progress, 'progress')
        suite.nodes['drop_simulator'].end(number)
        client.wait(asked.done, 'answer of the interrupted request')
        assert asked.result().status.code == Status.NOT_AVAILABLE
        assert 'the simulator stopped while it ' in asked.result().status.message
        client.wait(answer.done, 'error')
        with pytest.raises(NotAvailableError, match='the simulator stopped'):
            answer.result()
    for node in ('aspect_classifier', 'drop_recorder'):
        level, message, _ = diagnostics.wait(
            node, lambda _, __, values: values['drop_simulators'] == '0', f'{node} misses it'
        )
        assert level == DiagnosticStatus.WARN
        # A killed recorder that is still known can be named before.
        assert 'no drop_simulator' in message
        assert suite.nodes[node].running
    refused = client.ask(drops=MANY, seed=[99]).status
    assert refused.code == Status.NOT_AVAILABLE
    assert 'no drop_simulator answers' in refused.message
    assert not recorded_outcome(suite.log_of(run_id)).whole
    suite.start_again('drop_simulator')
    client.wait(lambda: not client.ask(drops=5, seed=[46 + number]).status.code, 'good answer')
    for node in ('aspect_classifier', 'drop_recorder'):
        diagnostics.wait(node, lambda level, *_: level == DiagnosticStatus.OK, f'{node} is well')


# -- replays --------------------------------------------------------------------------------------


def test_replay_at_full_speed_loses_nothing(
    start_process, connect, namespace, wait, listen_raw, batches, write_log, part, tmp_path
):
    written = list(batches(160))
    drops = 160 * 250
    once = count_poses(
        find_aspects(part('tetrahedron')),
        poses_from(deserialize_message(written[0], RestingPoses)),
    )
    start_process('aspect_classifier', namespace, {'log_folder': "''"})
    client = connect(namespace)
    received = listen_raw(client, RestingPoses, 'resting_poses', POSES)
    log = write_log(tmp_path, written, gap=0.4)
    given = {'log': log, 'as_fast_as_possible': True}
    replayer = start_process('log_replayer', namespace, given)
    wait(lambda: 'replayed in ' in replayer.output, 'end of the log')  # the client does not spin
    assert f': {len(written) + 1} messages; ' in replayer.output
    client.wait(lambda: len(received) == len(written), 'all batches')
    assert [data for data, _ in received] == written
    found = client.known(drops=drops, surface='rubber_mat', seed=[1])
    assert [aspect.count for aspect in found.aspects] == (160 * once.counts).tolist()
    assert replayer.end() == 0


def test_damage_during_a_replay_ends_it(
    start_process, connect, namespace, batches, write_log, traceback, tmp_path
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
    assert not traceback(replayer.output)


# -- long use -------------------------------------------------------------------------------------

# How long mixed requests go on: 30 minutes by hand, 2 with all other tests.
MINUTES = float(os.environ.get('RESTING_ASPECTS_HARD_USE_MINUTES', '2'))


def resident(suite):
    """MB of each node."""
    page = os.sysconf('SC_PAGE_SIZE') / 1e6
    return {
        name: int(Path(f'/proc/{process.pid}/statm').read_text().split()[1]) * page
        for name, process in suite.nodes.items()
    }


@pytest.mark.slow
@pytest.mark.timeout(MINUTES * 60 + 300)
def test_memory_does_not_grow_under_mixed_requests(processes, quick):
    suite = processes()
    client, rng, codes = suite.client, random.Random(8), []

    def ask(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            name = rng.choice(['tetrahedron', 'box_10x20x30', 'nothing'])
            if rng.randrange(5):
                seed = [rng.randrange(10**9)]
                answer = client.ask(name, rng.randint(1, 60), seed=seed, conditions=quick)
            else:
                goal = client.dropping(name, 20_000, seed=rng.randrange(10**9), conditions=quick)
                answer = client.canceled(goal).result
            codes.append(answer.status.code)

    ask(MINUTES * 60 / 3)
    before = resident(suite)
    ask(MINUTES * 60 * 2 / 3)
    after = resident(suite)
    assert set(codes) <= {Status.OK, Status.UNKNOWN_PART, Status.CANCELED}
    for name, mb in after.items():
        assert mb < 1.1 * before[name], (before, after, len(codes))
