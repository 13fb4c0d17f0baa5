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
from resting_aspects_ros.run_logs.recorder import RunRecorder, whole_log
from resting_aspects_ros.simulation.job import RunDescription

DROPS = 520


def read(path):
    """The messages of a bag, each topic's in their order."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite()


@pytest.fixture(scope='module')
def received(suite):
    """Return all messages about the tetrahedron, received in parallel with the recorder."""
    name = 'aspect_distributions/tetrahedron'
    received = {
        'resting_poses': suite.client.poses(),
        name: suite.client.listen(AspectDistribution, name, LATCHED),
        'parts/tetrahedron': suite.client.listen(PartDescription, 'parts/tetrahedron', LATCHED),
    }
    topic = f'{suite.namespace}/{name}'
    suite.client.wait(lambda: suite.client.node.count_publishers(topic), 'topic')
    suite.client.wait(lambda: received['parts/tetrahedron'], 'description')
    return received


@pytest.fixture(scope='module')
def folder(suite, received):
    """Return the log of a run that was received and recorded."""
    run = suite.client.ask('tetrahedron', DROPS, seed=[1]).distribution.run
    suite.client.wait(lambda: received['resting_poses'][-1].last, 'last batch')
    suite.client.wait(
        lambda: received['aspect_distributions/tetrahedron'][-1].complete, 'last distribution'
    )
    return suite.log_of(run.run_id)


def test_log_contains_every_published_message(suite, folder, received):
    messages = read(folder)
    assert read(next(folder.glob('*.mcap'))).keys() == messages.keys()  # without metadata.yaml
    assert set(messages) == {f'{suite.namespace}/{topic}' for topic in received}
    for topic, expected in received.items():
        recorded = messages[f'{suite.namespace}/{topic}']
        if topic.startswith('aspect_distributions'):
            # The recorder counts the drops itself, at the end of the run.
            expected = expected[-1:]  # noqa: PLW2901
            for each in (recorded[0], expected[0]):
                each.header.stamp.sec = each.header.stamp.nanosec = 0
        assert [plain(each) for each in recorded] == [plain(each) for each in expected], topic
    batches = messages[f'{suite.namespace}/resting_poses']
    assert sum(len(batch.status) for batch in batches) == DROPS
    assert [batch.last for batch in batches] == [False] * (len(batches) - 1) + [True]


# -- without nodes ------------------------------------------------------------------------------

TOPIC = Topic('/resting_poses', POSES_TYPE, Qos(10))


@pytest.fixture
def record(surfaces, tmp_path):
    """Return a function that begins the log of a run, and records drops of it."""

    def record(recorded, asked, failed=print):
        numbers = {'seed': 1, 'first_drop': 0, 'precision': 0.0, 'time_step': 1e-3}
        texts = ('engine', 'engine_version', 'suite_version', 'part_sha256')
        named = {'run_id': '4f1c', 'part': 'nut', **numbers, **dict.fromkeys(texts, 'x')}
        run = RunDescription(**named, drops=asked, conditions=surfaces.get(''), started=10**18)
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
    assert problems == [f'only 3999 drops of run 4f1c of nut are recorded: {log.error}']


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
