"""A log that the suite recorded, replayed: bytes, QoS, names, and what is counted again."""

import io
import re
import shutil
import signal
import struct
from contextlib import suppress

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    PartDescription,
    RestingPoses,
    Status,
)
from rosbags.highlevel import AnyReader
from std_msgs.msg import String
from std_srvs.srv import Trigger

from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.interface import ALL_LATCHED, LATCHED, MIN_BATCH, POSES

DROPS = 2 * MIN_BATCH + 200
DISTRIBUTION, PART = 'aspect_distributions/tetrahedron', 'parts/tetrahedron'
TOPICS = {
    'resting_poses': (RestingPoses, POSES),
    DISTRIBUTION: (AspectDistribution, ALL_LATCHED),
    PART: (PartDescription, ALL_LATCHED),
}


@pytest.fixture(scope='module')
def log(fresh_suite):
    """The folder of a run that the suite recorded; the suite is gone."""
    suite = fresh_suite()
    run = suite.client.ask('tetrahedron', DROPS, seed=[1]).distribution.run
    folder = suite.log_of(run.run_id)
    for process in suite.processes.values():
        assert process.end() == 0
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


@pytest.fixture(scope='module')
def last_distribution(recorded):
    distribution = deserialize_message(recorded[DISTRIBUTION][-1], AspectDistribution)
    assert (distribution.complete, distribution.drops) == (True, DROPS)
    return distribution


@pytest.fixture
def received(connect, namespace, listen_raw):
    """Return a client that subscribes before the replay, and its received messages."""
    client = connect(namespace)
    topics = {name: listen_raw(client, kind, name, qos) for name, (kind, qos) in TOPICS.items()}
    return client, topics


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


def assert_same(distribution, recorded):
    """Assert that two distributions are equal except for the publication stamp."""
    assert distribution.header.stamp != recorded.header.stamp
    distribution.header.stamp = recorded.header.stamp
    assert distribution == recorded


@pytest.mark.parametrize(
    'way', [{'as_fast_as_possible': True}, pytest.param({'rate': 2.0}, marks=pytest.mark.slow)]
)
def test_new_classifier_counts_the_replayed_drops(
    start, connect, namespace, replay, log, recorded, last_distribution, way
):
    classifier = start('aspect_classifier', namespace)
    client = connect(namespace)
    received = client.listen(AspectDistribution, DISTRIBUTION, ALL_LATCHED)
    stamps = {
        str(deserialize_message(data, AspectDistribution).header.stamp)
        for data in recorded[DISTRIBUTION]
    }
    replayer = replay(log, **way)

    def counted():
        new = [one for one in received if str(one.header.stamp) not in stamps]
        return new and new[-1].complete and new[-1]

    assert_same(client.wait(counted, 'complete distribution'), last_distribution)
    answer = client.ask('tetrahedron', DROPS, surface='rubber_mat', seed=[1], only_known=True)
    assert answer.status.code == Status.OK
    assert_same(answer.distribution, last_distribution)
    assert client.parts()['tetrahedron'].known
    # The recorded ones are published, too.
    client.wait(lambda: last_distribution in received, 'recorded distribution')
    assert 'publishers' not in replayer.output
    assert (replayer.end(), classifier.end()) == (0, 0)


def test_replayed_messages_are_identical(received, replay, log, recorded):
    client, topics = received
    replay(log, rate=2.0)
    client.wait(
        lambda: topics[DISTRIBUTION] and topics[DISTRIBUTION][-1][0] == recorded[DISTRIBUTION][-1],
        'end',
    )
    # No topic waits for another.
    client.wait(lambda: len(topics['resting_poses']) == 3 and topics[PART], 'poses and part')
    for name in ('resting_poses', PART):
        assert [data for data, _ in topics[name]] == recorded[name], name
    # Of depth 1: before the client and the replayer have found each other one may be replaced.
    found = [data for data, _ in topics[DISTRIBUTION]]
    assert found == recorded[DISTRIBUTION][-len(found) :]


def test_topics_have_the_replayer_namespace_and_recorded_qos(received, replay, log, namespace):
    client, _ = received
    replay(log)
    for name, qos in (('resting_poses', POSES), (DISTRIBUTION, LATCHED), (PART, LATCHED)):
        topic = f'{namespace}/{name}'
        client.wait(lambda topic=topic: client.node.count_publishers(topic), topic)
        (offer,) = client.node.get_publishers_info_by_topic(topic)
        assert offer.qos_profile.reliability == qos.reliability
        assert offer.qos_profile.durability == qos.durability
        # DDS does not report the depth: the test of late subscribers checks it.


def test_late_subscriber_receives_latched_topics_after_the_end(
    connect, namespace, replay, wait, listen_raw, log, recorded, diagnostics_of, traceback
):
    replayer = replay(log, as_fast_as_possible=True)
    wait(lambda: 'replayed in ' in replayer.output, 'end of the log')
    count = sum(map(len, recorded.values()))
    assert f': {count} messages; latched topics stay available' in replayer.output
    client = connect(namespace)
    topics = {name: listen_raw(client, kind, name, qos) for name, (kind, qos) in TOPICS.items()}
    client.wait(lambda: all(topics.values()) and len(topics['resting_poses']) == 3, 'all latched')
    before = replayer.cpu()
    client.spin(2.0)
    # As in test_nodes_command: a loop that waits for nothing takes the whole 2 s.
    assert replayer.cpu() - before < 0.3
    assert [data for data, _ in topics['resting_poses']] == recorded['resting_poses']
    assert [data for data, _ in topics[PART]] == recorded[PART]
    assert [data for data, _ in topics[DISTRIBUTION]] == recorded[DISTRIBUTION][-1:]
    call = replayer_services(client)
    assert [call(name)[:2] for name in ('pause', 'resume')] == [(False, 'over')] * 2
    _, _, values = diagnostics_of(client).wait('log_replayer', lambda _, m, __: m == 'over', 'end')
    assert (values['log'], values['messages published']) == (str(log), str(count))
    assert replayer.end(signal.SIGTERM) == 0
    assert not traceback(replayer.output)


@pytest.mark.slow
def test_late_subscriber_receives_the_recorded_depth(
    connect, namespace, replay, wait, listen_raw, batches, write_log, tmp_path
):
    written = list(batches(30))
    replayer = replay(write_log(tmp_path, written, depth=20), as_fast_as_possible=True)
    wait(lambda: 'replayed in ' in replayer.output, 'end of the log')
    client = connect(namespace)
    received = listen_raw(client, RestingPoses, 'resting_poses', POSES)
    client.wait(lambda: received and received[-1][0] == written[-1], 'last batch')
    assert [data for data, _ in received] == written[-20:]


def whole_batches(content):
    """The batches that are whole in the bytes of a file: messages of many poses."""
    found = []
    with suppress(EndOfFile, struct.error):
        for record in StreamReader(io.BytesIO(content)).records:
            found += [record.data] if isinstance(record, Message) else []
    return [data for data in found if len(data) > 200 * 80]


def test_truncated_log_is_replayed_up_to_the_damage(
    start, connect, namespace, replay, log, recorded, tmp_path
):
    """Cut in the middle of its last batch, without an index."""
    content = next(log.glob('*.mcap')).read_bytes()
    size = min(
        size for size in range(0, len(content), 97) if len(whole_batches(content[:size])) == 2
    )
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[: size + 1000])
    assert whole_batches(cut.read_bytes()) == recorded['resting_poses'][:2]
    start('aspect_classifier', namespace)
    client = connect(namespace)
    received = client.listen(AspectDistribution, DISTRIBUTION, ALL_LATCHED)
    replayer = replay(cut, rate=4.0)
    known = {
        deserialize_message(d, AspectDistribution).header.stamp.nanosec
        for d in recorded[DISTRIBUTION]
    }

    def counted():
        return [m for m in received if m.header.stamp.nanosec not in known and m.drops == 500]

    found = client.wait(counted, 'two batches')[0]
    assert not found.complete
    assert f"log '{cut}' was not closed: the messages in it are used" in replayer.output


def test_other_topics_are_replayed_in_the_suite_namespace(
    connect, namespace, replay, log, recorded, wait, tmp_path
):
    note = Topic('/cell/camera/note', 'std_msgs/msg/String', Qos(1, durability='transient_local'))
    far = Topic('/far/note', note.type, note.qos)
    poses = Topic('/cell/resting_poses', 'resting_aspects_interfaces/msg/RestingPoses', Qos(1))
    with RunLog(tmp_path, 'run') as written:
        for k, topic in enumerate((note, far)):
            written.write(topic, serialize_message(String(data=topic.name)), k)
        written.write(poses, recorded['resting_poses'][0], 10**18)
    client = connect(namespace)
    received = client.listen(String, 'camera/note', LATCHED)
    replayer = replay(written.path, as_fast_as_possible=True)
    client.wait(lambda: received, 'note')
    assert received[0].data == note.name
    expected = 'not replayed: /far/note: not in /cell, the namespace of the suite in the log'
    assert replayer.output.count(expected) == 1
    assert not client.node.count_publishers('/far/note')


@pytest.mark.slow
def test_simulator_in_the_same_namespace_is_warned_of_once(
    start, connect, namespace, replay, log, diagnostics_of
):
    simulator = start('drop_simulator', namespace)
    replayer = replay(log, as_fast_as_possible=True)
    client = connect(namespace)
    expected = 'a drop_simulator in this namespace publishes on the same topics'
    diagnostics = diagnostics_of(client)
    for _ in range(2):  # two looks
        diagnostics.wait('log_replayer', lambda _, message, __: expected in message, 'warning')
        diagnostics.forget()
    assert replayer.output.count(expected) == 1
    assert simulator.running


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_replayer_stops_cleanly_during_a_replay(replay, log, traceback, number):
    replayer = replay(log, rate=0.01)
    assert replayer.end(number) == 0
    assert not traceback(replayer.output)
    assert 'replayed in' not in replayer.output


@pytest.mark.slow
def test_damage_during_the_replay_is_an_error(
    replay, log, connect, namespace, tmp_path, traceback
):
    path = shutil.copy(next(log.glob('*.mcap')), tmp_path)
    client = connect(namespace)
    received = client.poses()
    replayer = replay(path, rate=0.5, loop=True)
    client.wait(lambda: received, 'first batch')
    with open(path, 'r+b') as file:  # noqa: PTH123
        file.write(b'no log any more')
    client.wait(lambda: not replayer.running, 'its end')
    assert replayer.end(number=0) == 1
    (line,) = [line for line in replayer.output.splitlines() if line.startswith('error: ')]
    assert line.startswith(f"error: log '{path}' is damaged")
    assert not traceback(replayer.output)


def test_services_pause_and_resume(received, replay, log):
    client, topics = received
    replayer = replay(log, rate=0.05)
    call = replayer_services(client)
    assert call('resume')[:2] == (True, 'not paused')
    client.wait(lambda: topics[PART], 'part')
    success, message, position = call('pause')
    assert (success, message) == (True, 'paused')
    assert re.fullmatch(r'\d+\.\d{3} s of \d+\.\d{3} s, message \d+', position)
    assert call('pause') == (True, 'already paused', position)
    assert call('resume') == (True, 'resumed', position)
    for word in ('paused', 'resumed'):
        expected = f']: {word}, at {position}'
        client.wait(lambda expected=expected: expected in replayer.output, expected)
    assert not re.search(r'\]: (already paused|not paused)', replayer.output)


@pytest.mark.slow
def test_drops_of_a_loop_are_counted_once(start, received, replay, log, recorded, diagnostics_of):
    client, topics = received
    expected = diagnostics_of(client)
    start('aspect_classifier', client.node.get_namespace())
    replay(log, rate=1000.0, loop=True)
    expected.wait('log_replayer', lambda _, __, values: int(values['round']) > 3, 'third round')
    client.wait(lambda: len(topics['resting_poses']) >= 6, 'two rounds')
    poses = [data for data, _ in topics['resting_poses']]
    assert poses[:6] == 2 * recorded['resting_poses']

    def known():
        answer = client.ask('tetrahedron', DROPS, surface='rubber_mat', seed=[1], only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    assert client.wait(known, 'distribution').drops == DROPS


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({}, "invalid log '': expected the folder of a run, or an .mcap file"),
        ({'log': '/no/such.mcap'}, "log '/no/such.mcap' cannot be read: No such file"),
        ({'log': '{tmp}'}, "folder '{tmp}' is not a log: it has no .mcap file"),
        ({'log': '{tmp}/text/a.mcap'}, "'{tmp}/text/a.mcap' is damaged, or not an MCAP file"),
        ({'log': '{tmp}/empty'}, "log '{tmp}/empty': expected at least one message"),
        ({'log': '{log}', 'rate': '0.0'}, 'rate out of range Min: 0.001, Max: 1000.0, value: 0.0'),
        (
            {'log': '{log}', 'rate': '.nan'},
            'rate out of range Min: 0.001, Max: 1000.0, value: nan',
        ),
        (
            {'log': '{log}', 'rate': '2.0', 'as_fast_as_possible': 'true'},
            'invalid rate 2.0: expected 1.0 with as_fast_as_possible',
        ),
    ],
    ids=str,
)
def test_invalid_log_is_reported_in_one_line(
    start, namespace, log, tmp_path, traceback, parameters, message
):
    (tmp_path / 'text').mkdir()
    (tmp_path / 'text' / 'a.mcap').write_text('aspect,count\n1,2\n')
    RunLog(tmp_path, 'empty').close()
    places = {'tmp': tmp_path, 'log': log}
    given = {name: value.format(**places) for name, value in parameters.items()}
    process = start('log_replayer', namespace, given, ready='')
    assert process.end(number=0) == 2
    (line,) = [line for line in process.output.splitlines() if line.startswith('error: ')]
    assert message.format(**places) in line
    assert not traceback(process.output)
