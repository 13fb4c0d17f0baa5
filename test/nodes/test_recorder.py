"""The log of every run, read with an independent reader, matches the received messages."""

import os
import resource
from pathlib import Path

import pytest
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription
from rosbags.highlevel import AnyReader
from wire import plain

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.logs.topics import POSES_TYPE, Qos, Topic
from resting_aspects_ros.nodes.drop_recorder.node import absolute_folder
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.run_logs import RunRecorder, whole_log
from resting_aspects_ros.simulation.job import plan_run

DROPS = 520


def read(path):
    """The messages of a bag, each topic's in their order."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


def test_log_contains_every_published_message(fresh_suite):
    # Simulated time stands still, because nothing publishes it; the timers of the nodes do not.
    suite = fresh_suite(arguments=['-p', 'use_sim_time:=true'])
    client, name = suite.client, 'aspect_distributions/tetrahedron'
    received = {
        'resting_poses': client.poses(),
        name: client.listen(AspectDistribution, name, LATCHED),
        'parts/tetrahedron': client.listen(PartDescription, 'parts/tetrahedron', LATCHED),
    }
    topic = f'{suite.namespace}/{name}'
    client.wait(lambda: client.node.count_publishers(topic), 'topic')
    client.wait(lambda: received['parts/tetrahedron'], 'description')
    run = client.ask('tetrahedron', DROPS, seed=[1]).distribution.run
    assert run.started.sec > 10**9  # real time
    client.wait(lambda: received['resting_poses'][-1].last, 'last batch')
    client.wait(lambda: received[name][-1].complete, 'last distribution')
    del received[name][:-1]  # the recorder counts the drops itself, at the end of the run
    folder = suite.log_of(run.run_id)
    messages = read(folder)
    assert read(next(folder.glob('*.mcap'))).keys() == messages.keys()  # without metadata.yaml
    assert set(messages) == {f'{suite.namespace}/{topic}' for topic in received}
    for each in (received[name][0], messages[topic][0]):
        each.header.stamp.sec = each.header.stamp.nanosec = 0
    for topic, expected in received.items():
        recorded = messages[f'{suite.namespace}/{topic}']
        assert [plain(each) for each in recorded] == [plain(each) for each in expected], topic
    assert sum(len(batch.status) for batch in received['resting_poses']) == DROPS


# -- without nodes ------------------------------------------------------------------------------

TOPIC = Topic('/resting_poses', POSES_TYPE, Qos(10))


@pytest.fixture
def record(part, surfaces, tmp_path):
    """Return a function that begins the log of a run, and records drops of it."""

    def record(recorded, asked, failed=print):
        given = {'seed': 1, 'drops': asked, 'run_id': '4f1c', 'started': 10**18}
        run = plan_run(part('hex_nut'), surfaces.get(), **given)[1]
        log = RunRecorder(tmp_path, run, failed=failed)
        if recorded:
            log.write_poses(TOPIC, bytes(100), 1, -5, 0, recorded)
            assert not log.error
        return log

    return record


@pytest.mark.parametrize('name', ['gone', 'not UTF-8'])
def test_folder_that_messages_cannot_contain_is_refused(tmp_path, monkeypatch, name):
    working = tmp_path / os.fsdecode(b'\xff')
    working.mkdir()
    monkeypatch.chdir(working)
    if name == 'gone':
        working.rmdir()
    with pytest.raises(InvalidValueError, match=r'invalid log_folder .*out/logs.*: expected'):
        absolute_folder('out/logs')
    assert absolute_folder('/mnt/disk') == Path('/mnt/disk')


def test_failure_on_a_full_disk_is_reported_once(record):
    problems = []
    log = record(3999, 4000, problems.append)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        for _ in range(2):
            log.write(TOPIC, bytes(100_000), 2, 2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert log.error.endswith('cannot be written: File too large')
    assert not log.being_written
    assert problems == [f'only 3999 drops of run 4f1c of hex_nut are recorded: {log.error}']


def test_incomplete_logs_are_followed_by_a_whole_one(record, tmp_path):
    """As of recorders that were killed, and of one that was started after the run."""
    first, second = record(3, 10), record(4, 10)
    assert second.folder.name == f'{first.folder.name}_2'
    assert second.close(whole=False) is False
    assert whole_log(tmp_path, second.run) is None
    third = record(10, 10)
    third.has_part = True
    assert third.folder.name == f'{first.folder.name}_3'
    assert third.close(whole=True) is True
    assert recorded_outcome(third.folder) == LogOutcome(10, whole=True)
    assert whole_log(tmp_path, third.run) == third.folder
