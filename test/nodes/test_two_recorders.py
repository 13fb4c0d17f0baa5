"""Two recorders that write into the same folder: each run has a log of each."""

import os
import re

import pytest
from mcap.reader import make_reader
from resting_aspects_interfaces.msg import PartDescription, RestingPoses, Status

from resting_aspects_ros import cli
from resting_aspects_ros.logs.bag_metadata import custom_data
from resting_aspects_ros.nodes.convert import part_msg
from resting_aspects_ros.nodes.interface import LATCHED, LEAST_BATCH, POSES, RESTING_POSES

RUNS, BATCHES = 6, 2
# Nobody publishes distributions here, for which a log would wait.
CONSTANTS = {'open_log.END_TIMEOUT': 3.0}


@pytest.fixture(scope='module')
def namespace():
    return f'/two_{os.getpid()}'


@pytest.fixture(scope='module')
def logs(tmp_path_factory):
    return tmp_path_factory.mktemp('logs')


@pytest.fixture(scope='module')
def recorders(start, connect, namespace, logs, part, batches):
    """Two that have recorded some runs; what they said."""
    client = connect(namespace)
    recorders = [start('drop_recorder', namespace, {'log_folder': logs}, CONSTANTS) for _ in 'ab']
    publisher = client.node.create_publisher(RestingPoses, RESTING_POSES, POSES)
    described = client.node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
    client.wait(lambda: publisher.get_subscription_count() == 2, 'both recorders')
    described.publish(part_msg(part('tetrahedron')))
    for k in range(RUNS):
        for batch in batches(BATCHES, f'run{k}'):
            publisher.publish(batch)  # to both at once
    client.wait(lambda: len(list(logs.glob('*/metadata.yaml'))) >= 2 * RUNS, 'logs')
    assert [recorder.end() for recorder in recorders] == [0, 0]
    return recorders


def test_each_run_has_two_logs_that_are_whole(recorders, logs):
    names = sorted(re.sub('.*Z_', '', log.name) for log in logs.iterdir())
    assert names == sorted(f'run{k}{number}' for k in range(RUNS) for number in ('', '_2'))
    for log in logs.iterdir():
        outcome = custom_data(log)
        drops = str(BATCHES * LEAST_BATCH)
        assert (outcome['outcome.whole'], outcome['outcome.drops']) == ('true', drops)
        with next(log.glob('*.mcap')).open('rb') as file:
            topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
        assert sum(topic.endswith(RESTING_POSES) for topic in topics) == BATCHES


def test_it_is_told_once_and_neither_log_is_called_superfluous(recorders, logs):
    words = [re.findall('another drop_recorder is writing .*', each.said) for each in recorders]
    assert len([*words[0], *words[1]]) >= 1
    assert max(map(len, words)) == 1
    for line in [*words[0], *words[1]]:
        assert str(logs) in line
        assert 'its drops are counted once' in line
    for recorder in recorders:
        assert 'may be deleted' not in recorder.said
        assert 'is not recorded' not in recorder.said


def test_no_drop_is_counted_twice(recorders, logs, start, connect, namespace, capsys):
    assert cli.main(['merge', *map(str, sorted(logs.glob('*run0*')))]) == 0
    assert f'tetrahedron, {BATCHES * LEAST_BATCH} drops of 1 run on' in capsys.readouterr().out
    other = f'{namespace}_again'
    start('aspect_classifier', other, {'log_folder': logs})
    client = connect(other)

    def known():
        answer = client.ask(drops=1, only_known=True, surface='rubber_mat')
        return answer.status.code == Status.OK and answer.distribution

    assert client.wait(known, 'logs read').drops == BATCHES * LEAST_BATCH
