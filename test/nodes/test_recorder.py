"""The log of every run, read with an independent reader, matches the received messages."""

import csv
import os
import re
import signal
import sys
from datetime import datetime, timezone

import numpy as np
import pytest
from mcap.reader import make_reader
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, Status
from rosbags.highlevel import AnyReader

from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.interface import LATCHED, MIN_BATCH
from resting_aspects_ros.simulation.conditions import parts_folder

DROPS = 2 * MIN_BATCH + 20


def read(path):
    """The messages of a bag, each topic's in their order."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


def plain(message):
    """A message of rclpy or of rosbags as plain data that can be compared."""
    if hasattr(message, 'get_fields_and_field_types'):
        names = message.get_fields_and_field_types()
        return {name: plain(getattr(message, name)) for name in names}
    if hasattr(message, '__msgtype__'):
        names = [name for name in vars(message) if name != '__msgtype__']
        return {name: plain(getattr(message, name)) for name in names if not name.isupper()}
    if isinstance(message, bytes | np.ndarray) or hasattr(message, 'typecode'):
        return np.asarray(bytearray(message) if isinstance(message, bytes) else message).tolist()
    if isinstance(message, list | tuple):
        return [plain(entry) for entry in message]
    return message


@pytest.fixture(scope='module')
def suite(fresh_suite):
    # One whose last distribution was replaced before it was read is closed after this.
    return fresh_suite({'drop_recorder': {'run_logs.recorder.END_TIMEOUT': 2.0}})


@pytest.fixture(scope='module')
def received(suite):
    """Return all messages about the tetrahedron, received in parallel with the recorder."""
    name = 'aspect_distributions/tetrahedron'
    suite.client.wait(
        lambda: suite.client.node.count_publishers(f'{suite.namespace}/{name}'), 'topic'
    )
    received = {
        'resting_poses': suite.client.poses(),
        name: suite.client.listen(AspectDistribution, name, LATCHED),
        'parts/tetrahedron': suite.client.listen(PartDescription, 'parts/tetrahedron', LATCHED),
    }
    suite.client.wait(lambda: received['parts/tetrahedron'], 'description')
    return received


@pytest.fixture(scope='module')
def run(suite, received):
    """Return the description of a run that was received and recorded."""
    run = suite.client.ask('tetrahedron', DROPS, seed=[1]).distribution.run
    suite.client.wait(lambda: received['resting_poses'][-1].last, 'last batch')
    suite.client.wait(
        lambda: received['aspect_distributions/tetrahedron'][-1].complete, 'last distribution'
    )
    return run


@pytest.fixture(scope='module')
def folder(suite, run):
    return suite.log_of(run.run_id)


def test_run_folder_is_named_after_part_start_and_run_id(folder, run):
    started = datetime.fromtimestamp(run.started.sec, timezone.utc)
    assert folder.name == f'tetrahedron_{started:%Y%m%dT%H%M%SZ}_{run.run_id}'
    assert re.fullmatch(r'tetrahedron_\d{8}T\d{6}Z_[0-9a-f]+', folder.name)
    assert sorted(file.name for file in folder.iterdir()) == [
        'metadata.yaml',
        f'{folder.name}_0.mcap',
    ]


@pytest.mark.parametrize('way', ['the bare file', 'metadata.yaml'])
def test_log_contains_every_published_message(suite, folder, received, way):
    messages = read(next(folder.glob('*.mcap')) if way == 'the bare file' else folder)
    assert set(messages) == {f'{suite.namespace}/{topic}' for topic in received}
    for topic, expected in received.items():
        recorded = messages[f'{suite.namespace}/{topic}']
        if topic.startswith('aspect_distributions'):
            # Latched with depth 1: on a busy machine each reader may miss one that was replaced.
            common = {one.drops for one in recorded} & {other.drops for other in expected}
            assert DROPS in common
            recorded = [one for one in recorded if one.drops in common]
            expected = [other for other in expected if other.drops in common]  # noqa: PLW2901
        assert len(recorded) == len(expected), topic
        for one, other in zip(recorded, expected, strict=True):
            assert plain(one) == plain(other), topic


def test_log_ends_with_all_drops_counted(suite, folder, received, run):
    messages = read(folder)
    batches = messages[f'{suite.namespace}/resting_poses']
    assert sum(len(batch.poses) for batch in batches) == DROPS
    assert [batch.last for batch in batches] == [False, False, True]
    last = messages[f'{suite.namespace}/aspect_distributions/tetrahedron'][-1]
    assert (last.complete, last.drops, last.run.run_id) == (True, DROPS, run.run_id)


def test_distributions_grow_during_a_run(received, run):
    distributions = received['aspect_distributions/tetrahedron']
    assert {message.run.run_id for message in distributions} == {run.run_id}
    drops = [message.drops for message in distributions]
    assert drops == sorted(set(drops))
    assert drops[0] >= MIN_BATCH
    assert [message.complete for message in distributions] == [count == DROPS for count in drops]


def test_late_subscriber_receives_the_newest_distribution(suite, run):
    late = suite.client.listen(AspectDistribution, 'aspect_distributions/tetrahedron', LATCHED)
    suite.client.wait(lambda: late, 'latched distribution')
    assert (late[0].run, late[0].complete, late[0].drops) == (run, True, DROPS)


def test_mesh_file_is_attached_unchanged(folder):
    with next(folder.glob('*.mcap')).open('rb') as file:
        (attachment,) = make_reader(file).iter_attachments()
    assert (attachment.name, attachment.media_type) == ('tetrahedron.stl', 'model/stl')
    assert attachment.data == (parts_folder() / 'tetrahedron.stl').read_bytes()


def test_runs_that_end_while_the_recorder_is_stopped(suite):
    recorder = suite.processes['drop_recorder']
    recorder.send(signal.SIGSTOP)
    try:
        drops = [suite.client.dropping('tetrahedron', 40, seed=seed) for seed in (2, 3)]
        suite.client.wait(lambda: all(drop.done for drop in drops), 'goals')
    finally:
        recorder.send(signal.SIGCONT)
    for drop in drops:
        messages = read(suite.log_of(drop.result.run_id))
        (batch,) = messages[f'{suite.namespace}/resting_poses']
        assert (batch.run.run_id, len(batch.poses)) == (drop.result.run_id, 40)
        assert recorded_outcome(suite.log_of(drop.result.run_id)).whole


def test_canceled_run_has_a_complete_log(suite):
    drop = suite.client.dropping('tetrahedron', 2_000_000, seed=5)
    suite.client.wait(lambda: drop.feedback, 'first feedback')
    drop.cancel()
    suite.client.wait(lambda: drop.done, 'canceled goal')
    batches = read(suite.log_of(drop.result.run_id))[f'{suite.namespace}/resting_poses']
    assert sum(len(batch.poses) for batch in batches) == drop.result.drops
    assert batches[-1].last


MAIN = 'from resting_aspects_ros.cli.main import main; raise SystemExit(main())'


@pytest.mark.slow
@pytest.mark.parametrize('canceled', [False, True])
def test_drop_repeats_the_drops_of_a_log(suite, surfaces, run_script, tmp_path, canceled):
    """The run has a precision and custom conditions; a cancel may end it early."""
    conditions = surfaces.get('steel').changed(height=0.07, friction=0.31, spin=2.0)
    drop = suite.client.dropping(
        'hex_nut',
        precision=0.01 if canceled else 0.1,
        drops=0,
        seed=2**64 - 1,
        conditions=[conditions_msg(conditions)],
    )
    if canceled:
        suite.client.wait(lambda: drop.feedback, 'first feedback')
        drop.cancel()
    suite.client.wait(lambda: drop.done, 'goal')
    folder = suite.log_of(drop.result.run_id)
    arguments = ('drop', '--from-log', folder, '--poses', tmp_path / 'again.csv')
    command = run_script(MAIN, *arguments)
    suite.client.wait(lambda: not command.running, 'end of the command')
    assert command.end() == 0, command.output
    batches = read(folder)[f'{suite.namespace}/resting_poses']
    poses = [pose.pose for batch in batches for pose in batch.poses]
    logged = [
        [getattr(pose.position, axis) for axis in 'xyz']
        + [getattr(pose.orientation, axis) for axis in 'xyzw']
        for pose in poses
    ]
    with (tmp_path / 'again.csv').open(newline='') as file:
        made = [[float(value) for value in row[1:8]] for row in list(csv.reader(file))[1:]]
    assert len(made) == drop.result.drops
    assert made == logged


def test_folder_name_that_is_not_utf8_is_rejected(run_command, wait, tmp_path):
    folder = tmp_path / '\udcff'  # no UTF-8
    folder.mkdir()
    start = f'import os; os.chdir({os.fsencode(folder)!r})\n'
    start += (
        'from resting_aspects_ros.nodes.drop_recorder.node import main; raise SystemExit(main())'
    )
    recorder = run_command(sys.executable, '-c', start)
    wait(lambda: not recorder.running, 'its end')
    assert recorder.end() == 2
    reason = r"\udcff/out/logs': expected UTF-8 text, as ROS messages require"
    assert reason in recorder.output
    assert not list(folder.iterdir())


def test_unwritable_folder_is_reported(suite, start, tmp_path):
    (tmp_path / 'file').write_bytes(b'')
    recorder = start('drop_recorder', suite.namespace, {'log_folder': tmp_path / 'file' / 'logs'})
    answer = suite.client.ask('tetrahedron', 3, seed=[6])
    assert answer.status.code == Status.OK
    run_id = answer.distribution.run.run_id
    suite.client.wait(
        lambda: f'run {run_id} of tetrahedron is not recorded: ' in recorder.output, 'error'
    )
    assert str(tmp_path / 'file') in recorder.output
    assert recorder.running
    suite.log_of(run_id)  # of the recorder that can write
    assert recorder.end() == 0


@pytest.mark.slow
def test_restarted_recorder_records_the_whole_run(suite, received, start, tmp_path):
    """What the first wrote stays; the second writes a whole log beside it, and a third none."""

    def recorder():
        return start('drop_recorder', suite.namespace, {'log_folder': tmp_path})

    def logs():
        return sorted(tmp_path.glob(f'*{run_id}*'))

    first = recorder()
    drop = suite.client.dropping_in_bullet('tetrahedron', 2000, seed=10)
    suite.client.wait(lambda: any(b.run.seed == 10 for b in received['resting_poses']), 'batch')
    simulator = suite.processes['drop_simulator']
    assert simulator.send_to_workers(signal.SIGSTOP)
    run_id = next(b.run.run_id for b in received['resting_poses'] if b.run.seed == 10)
    suite.client.wait(logs, 'log')
    first.end(signal.SIGKILL)
    assert not drop.done
    second = recorder()
    simulator.send_to_workers(signal.SIGCONT)
    suite.client.wait(lambda: drop.done, 'goal')
    suite.client.wait(lambda: f'run {run_id} of tetrahedron is in ' in second.output, 'whole log')
    interrupted, whole = logs()
    assert f'is in {whole}' in second.output
    assert whole.name == f'{interrupted.name}_2'
    assert not (interrupted / 'metadata.yaml').exists()
    batches = read(whole)[f'{suite.namespace}/resting_poses']
    assert sum(len(batch.poses) for batch in batches) == 2000
    assert recorded_outcome(whole) == LogOutcome(2000, whole=True)
    assert second.end() == 0
    third = recorder()
    suite.client.wait(lambda: f'is already in {whole}' in third.output, 'word of it')
    assert third.end() == 0
    assert logs() == [interrupted, whole]


# Last: it ends the recorder.
def test_recorder_closes_its_log_when_it_ends_during_a_run(suite, received, traceback):
    drop = suite.client.dropping('tetrahedron', 2_000_000, seed=9)

    def of_the_run():
        return [batch for batch in received['resting_poses'] if batch.run.seed == 9]

    suite.client.wait(lambda: len(of_the_run()) >= 2, 'second batch')
    run_id = of_the_run()[0].run.run_id
    recorder = suite.processes['drop_recorder']
    assert recorder.end() == 0
    assert not traceback(recorder.output)
    drop.cancel()
    suite.client.wait(lambda: drop.done, 'canceled goal')
    folder = suite.log_of(run_id)
    for path in (folder, next(folder.glob('*.mcap'))):
        batches = read(path)[f'{suite.namespace}/resting_poses']
        assert len(batches) >= 1
        for one, other in zip(batches, of_the_run(), strict=False):
            assert plain(one) == plain(other)
    drops = sum(len(batch.poses) for batch in batches)
    assert recorded_outcome(folder) == LogOutcome(drops, whole=False)
