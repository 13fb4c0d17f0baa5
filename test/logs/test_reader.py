"""Reading of closed and unclosed logs: by type, and for playback."""

import os
from contextlib import closing

import pytest
from mcap.writer import Writer

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.logs import writer
from resting_aspects_ros.logs.bag import LogOutcome, is_log, recorded_outcome
from resting_aspects_ros.logs.reader import Recording, messages, open_log
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE, Qos, Topic, qos_profiles
from resting_aspects_ros.logs.writer import RunLog

POSES = Topic('/cell/resting_poses', POSES_TYPE, Qos(2000, durability='transient_local'))
NUT = Topic('/cell/parts/nut', PART_TYPE, Qos(1, durability='transient_local'))


def data(k):
    return bytes([k]) * 40


def read_messages(recording, topics=None):
    """Return topic, time and first byte of each message."""
    messages = recording.messages(recording.topics if topics is None else topics)
    return [(message.topic, message.time, message.data[0]) for message in messages]


@pytest.fixture
def log(tmp_path):
    """Write a log of poses 0 to 5, with the part nut after the third, each in a chunk."""
    log = RunLog(tmp_path, 'run')
    log.attach('nut.stl', 'model/stl', b'mesh', 1)
    for k in range(6):
        log.write(POSES, data(k), 100 + 10 * k)
        if k == 2:
            log.write(NUT, data(77), 125)
        log.flush()
    return log


WRITTEN = [(POSES.name, 100 + 10 * k, k) for k in range(6)]
WRITTEN.insert(3, (NUT.name, 125, 77))


# -- by type --------------------------------------------------------------------------------------


def test_messages_count_and_outcome_of_a_closed_log(log):
    log.add_metadata('outcome', LogOutcome(6, whole=True).record())
    log.close()
    for place in (log.path, log.path.parent, log.path.parent / 'metadata.yaml'):
        assert is_log(place)
        with open_log(place) as found:
            assert (found.closed, found.being_written) == (True, False)
            assert [each.data for each in found.of_types([NUT.type])] == [data(77)]
            assert (found.message_count, found.warning) == (7, '')
            assert found.outcome == LogOutcome(6, whole=True)
        assert list(messages(place, POSES.type)) == [data(k) for k in range(6)]
        recording = Recording(place)
        assert read_messages(recording) == WRITTEN
        assert read_messages(recording) == WRITTEN  # as often as one likes


def test_outcome_that_is_not_readable_is_unknown(log):
    """Python does not read a number of more than 4300 digits."""
    log.add_metadata('outcome', {'whole': 'true', 'drops': '6' * 5000})
    log.close()
    assert recorded_outcome(log.path.parent) is None
    with open_log(log.path) as found:
        assert len(list(found.messages())) == 7
        assert found.outcome is None


def test_other_definition_of_a_type_is_rejected(tmp_path, monkeypatch):
    text, installed = writer.load_schema(NUT.type)
    monkeypatch.setattr(writer, 'load_schema', lambda _: (text, 'RIHS01_older'))
    with closing(RunLog(tmp_path, 'run')) as log:
        log.write(NUT, data(1), 1)
    expected = f"by another version of .* {NUT.type} .* 'RIHS01_older'.*{installed}"
    with pytest.raises(LogError, match=f'{log.path}.*{expected}'):
        list(messages(log.path, NUT.type))
    assert Recording(log.path).topics[NUT.name].type_hash == 'RIHS01_older'


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('folder', "folder '{}' is not a log: it has no .mcap file"),
        ('other.mcap', "log '{}' is damaged, or not an MCAP file: it begins with b'aspect,c'"),
        ('pipe.mcap', "log '{}' is neither a file nor a folder"),
    ],
)
def test_invalid_logs_are_rejected(tmp_path, name, expected):
    (tmp_path / 'folder').mkdir()
    os.mkfifo(tmp_path / 'folder' / 'a.mcap')
    os.mkfifo(tmp_path / 'pipe.mcap')
    (tmp_path / 'other.mcap').write_text('aspect,count\n1,2\n')
    path = tmp_path / name
    assert is_log(path)  # meant to be one
    with pytest.raises(LogError, match=f'^{expected.format(path)}'):
        Recording(path)


def test_log_without_messages(tmp_path):
    (tmp_path / 'empty.mcap').touch()
    RunLog(tmp_path, 'nothing').close()
    for name in ('empty.mcap', 'nothing'):
        assert list(messages(tmp_path / name, NUT.type)) == []
        with pytest.raises(LogError, match='expected at least one message, found none'):
            Recording(tmp_path / name)


def test_zeros_after_a_power_failure_are_ignored(log):
    size = log.path.stat().st_size
    log.close()
    log.path.write_bytes(log.path.read_bytes()[:size] + bytes(1000))
    assert read_messages(Recording(log.path)) == WRITTEN


# -- playback -------------------------------------------------------------------------------------


def test_topics_have_their_descriptions_times_and_messages(log):
    recording = Recording(log.path)
    assert list(recording.topics) == [POSES.name, NUT.name]
    for topic in (POSES, NUT):
        found = recording.topics[topic.name]
        assert (found.type, found.qos) == (topic.type, topic.qos)
        assert found.type_hash.startswith('RIHS01_')
    assert (recording.start, recording.end) == (100, 150)
    assert read_messages(recording, [NUT.name]) == [(NUT.name, 125, 77)]


def test_open_log_has_the_messages_at_its_opening(log):
    with open_log(log.path) as found:
        assert (found.closed, found.being_written) == (False, True)
        assert found.warning.endswith('is being written: the messages in it so far are used')
        log.write(NUT, data(9), 200)
        log.flush()
        assert len(list(found.messages())) == 7
    assert read_messages(Recording(log.path.parent)) == [*WRITTEN, (NUT.name, 200, 9)]


@pytest.fixture
def foreign(tmp_path):
    """Write a file of another writer: (topic, encoding, schema, metadata), and (channel, time)."""

    def foreign(channels, messages):
        with (tmp_path / 'a.mcap').open('wb') as file:
            writer = Writer(file)
            writer.start()
            ids = []
            for topic, encoding, schema, metadata in channels:
                schema_id = writer.register_schema(schema, 'ros2msg', b'') if schema else 0
                ids.append(writer.register_channel(topic, encoding, schema_id, metadata))
            for k, (channel, time) in enumerate(messages):
                writer.add_message(ids[channel], time, data(k), time)
            writer.finish()
        return tmp_path / 'a.mcap'

    return foreign


def test_decreasing_times_become_constant(foreign):
    path = foreign([('/a', 'cdr', POSES.type, {})], [(0, 10), (0, 30), (0, 20), (0, 40)])
    times = [(time, k) for _, time, k in read_messages(Recording(path))]
    assert times == [(10, 0), (30, 1), (30, 2), (40, 3)]


def test_logs_of_other_writers_may_lack_qos_and_hash(foreign):
    channels = [('/a', 'json', '', {}), ('/b', 'cdr', POSES.type, {'offered_qos_profiles': ''})]
    path = foreign([*channels, ('/never', 'cdr', NUT.type, {})], [(0, 1), (1, 2)])
    topics = Recording(path).topics
    assert {name: topic.type for name, topic in topics.items()} == {'/a': '', '/b': POSES.type}
    assert all(topic.qos is topic.type_hash is None for topic in topics.values())


def test_topic_with_two_types_is_rejected(foreign):
    channels = [('/a', 'cdr', kind, {'topic_type_hash': 'h'}) for kind in (NUT.type, POSES.type)]
    expected = rf'one type for topic /a, found {POSES.type} \(h\) and {NUT.type} \(h\)$'
    with pytest.raises(LogError, match=expected):
        Recording(foreign(channels, [(0, 1), (1, 2)]))


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('just words', 'expected profiles as rosbag2'),
        (yaml_text(qos_profiles(Qos(1))).replace(': reliable', ': 1'), 'reliability 1'),
    ],
)
def test_invalid_qos_is_refused(foreign, text, expected):
    path = foreign([('/a', 'cdr', NUT.type, {'offered_qos_profiles': text})], [(0, 1)])
    with pytest.raises(LogError, match=expected):
        _ = Recording(path).topics['/a'].qos
