"""A log that the suite recorded, replayed: bytes, QoS, names, and what is counted again."""

import re

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    PartDescription,
    RestingPoses,
)
from ros_graph import Diagnostics
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.logs.topics import POSES_TYPE, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import nanoseconds
from resting_aspects_ros.ros.interface import ALL_LATCHED, POSES, offered_qos

# Drops in three messages.
DROPS, MESSAGE = 1200, 500
DISTRIBUTION, PART = 'aspect_distributions/tetrahedron', 'parts/tetrahedron'
TOPICS = {
    'resting_poses': (RestingPoses, POSES),
    DISTRIBUTION: (AspectDistribution, ALL_LATCHED),
    PART: (PartDescription, ALL_LATCHED),
}


@pytest.fixture(scope='module')
def log(fresh_suite):
    """The folder of a run that the suite recorded; the suite is gone."""
    constants = {'drop_simulator': {'nodes.drop_simulator.actions.MAX_POSES': MESSAGE}}
    suite = fresh_suite(constants)
    run = suite.client.ask('tetrahedron', DROPS, seed=[1]).distribution.run
    folder = suite.log_of(run.run_id)
    for node in suite.nodes.values():
        node.end()
    return folder


@pytest.fixture(scope='module')
def recorded(log):
    """The bytes of each topic in the log, as rosbags reads them, by their names in the suite."""
    found = {name: [] for name in TOPICS}
    with AnyReader([log]) as reader:
        for connection, _, data in reader.messages():
            (name,) = [name for name in TOPICS if connection.topic.endswith(f'/{name}')]
            found[name].append(bytes(data))
    assert len(found['resting_poses']) == 3
    assert len(found[PART]) == 1
    return found


def replayer_services(client):
    """Return a function that calls a service of the replayer: success, word and position."""
    services = {
        name: client.node.create_client(Trigger, f'log_replayer/{name}')
        for name in ('pause', 'resume')
    }
    for service in services.values():  # this calls them, resume last
        client.meet_service(service)

    def call(name):
        answer = client.call(services[name], Trigger.Request())
        word, _, position = answer.message.partition(', at ')
        return answer.success, word, position

    return call


def test_new_classifier_counts_the_replayed_drops(
    start, connect, namespace, replay, log, recorded
):
    last_distribution = deserialize_message(recorded[DISTRIBUTION][-1], AspectDistribution)
    start('aspect_classifier', namespace)
    client = connect(namespace)
    received = client.listen(AspectDistribution, DISTRIBUTION, ALL_LATCHED)
    replay(log, as_fast_as_possible=True)
    found = client.known('tetrahedron', DROPS, surface='rubber_mat', seed=[1])
    assert found.header.stamp != last_distribution.header.stamp
    found.header.stamp = last_distribution.header.stamp
    assert found == last_distribution
    # The recorded ones are published, too.
    client.wait(lambda: last_distribution in received, 'recorded distribution')


def test_late_subscriber_receives_latched_topics_after_the_end(
    connect, namespace, replay, log, recorded
):
    replayer = replay(log, as_fast_as_possible=True)
    client = connect(namespace)
    client.wait(lambda: 'replayed in ' in replayer.output, 'end of the log')
    count = sum(map(len, recorded.values()))
    topics = {
        name: client.listen(kind, name, qos, raw=True) for name, (kind, qos) in TOPICS.items()
    }
    client.wait(lambda: all(topics.values()) and len(topics['resting_poses']) == 3, 'all latched')
    assert topics['resting_poses'] == recorded['resting_poses']
    assert topics[PART] == recorded[PART]
    assert topics[DISTRIBUTION] == recorded[DISTRIBUTION][-1:]
    assert replayer_services(client)('pause')[:2] == (False, 'over')
    _, _, values = Diagnostics(client).wait('log_replayer', lambda _, m, __: m == 'over', 'end')
    assert (values['log'], values['messages published']) == (str(log), str(count))


def test_clock_follows_the_log_and_a_second_one_is_reported(connect, namespace, replay, log):
    client = connect(namespace)
    diagnostics = Diagnostics(client)
    clock = f'{namespace}/clock'
    received = client.listen(Clock, clock, 10)
    recording = Recording(log)
    replay(log, rate=2.0, clock=True, arguments=['-r', f'/clock:={clock}'])
    client.wait(lambda: received and nanoseconds(received[-1].clock) == recording.end, 'last time')
    times = [nanoseconds(message.clock) for message in received]
    assert times == sorted(times)
    assert times[0] >= recording.start
    diagnostics.wait('log_replayer', lambda _, message, __: message == 'over', 'one clock')
    client.node.create_publisher(Clock, clock, 10)
    problem = f'2 nodes publish {clock}'
    diagnostics.wait('log_replayer', lambda _, m, __: problem in m, 'second clock')


def test_services_pause_and_resume(connect, namespace, replay, log):
    client = connect(namespace)
    parts = client.listen(PartDescription, PART, ALL_LATCHED, raw=True)
    replay(log, rate=0.05)
    call = replayer_services(client)
    client.wait(lambda: parts, 'part')
    success, word, position = call('pause')
    assert (success, word) == (True, 'paused')
    assert re.fullmatch(r'\d+\.\d{3} s of \d+\.\d{3} s, message \d+', position)
    assert call('pause') == (True, 'paused', position)
    assert call('resume') == (True, 'replaying', position)


@pytest.mark.parametrize(
    ('log', 'message'),
    [
        ("''", "invalid log ''"),
        ('{tmp}/empty', 'expected at least one message'),
        ('{tmp}/late', 'expected at most 2147483647'),
    ],
)
def test_invalid_log_is_rejected(start, namespace, tmp_path, log, message):
    RunLog(tmp_path, 'empty').close()
    late = RunLog(tmp_path, 'late')
    topic = Topic('/resting_poses', POSES_TYPE, offered_qos(POSES))
    late.write(topic, serialize_message(RestingPoses()), 2**31 * 10**9)
    late.close()
    with pytest.raises(RestingAspectsError, match=message):
        start('log_replayer', namespace, {'log': log.format(tmp=tmp_path), 'clock': 'true'})
