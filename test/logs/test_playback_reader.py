"""Playback of complete and truncated logs: topics, order and times."""

import dataclasses
import importlib
import struct
import tracemalloc
from contextlib import suppress

import pytest
from mcap.writer import Writer
from rclpy.qos import QoSProfile

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.playback_reader import RecordedMessage, Recording, Span
from resting_aspects_ros.logs.run_writer import RunLog
from resting_aspects_ros.logs.topic_metadata import (
    Qos,
    Topic,
    qos_profiles,
    recorded_qos,
    yaml_text,
)

INTERFACES = 'resting_aspects_interfaces/msg'
LATCHED = Qos(1, durability='transient_local')
POSES = Topic(
    '/cell/resting_poses', f'{INTERFACES}/RestingPoses', Qos(2000, durability='transient_local')
)
NUT = Topic('/cell/parts/nut', f'{INTERFACES}/PartDescription', LATCHED)
CUBE = Topic('/cell/parts/cube', f'{INTERFACES}/PartDescription', LATCHED)
NAMES = {POSES.name, NUT.name, CUBE.name}


def data(k):
    return bytes([k]) * 40


def read_messages(recording, topics=None, first=()):
    """Return topic, time and first byte of each message."""
    messages = recording.messages(recording.topics if topics is None else topics, first)
    return [(message.topic, message.time, message.data[0]) for message in messages]


@pytest.fixture
def log(tmp_path):
    """Write a log of poses 0 to 5, with the part nut after the third; where it was flushed."""
    ends = []
    with RunLog(tmp_path, 'run') as log:
        log.attach('nut.stl', 'model/stl', b'mesh', 1)
        for k in range(6):
            log.write(POSES, data(k), 100 + 10 * k)
            if k == 2:
                log.write(NUT, data(77), 125)
            log.flush()
            ends.append(log.path.stat().st_size)
    log.ends = ends
    return log


WRITTEN = [(POSES.name, 100 + 10 * k, k) for k in range(6)]
WRITTEN.insert(3, (NUT.name, 125, 77))


def test_messages_have_order_times_and_bytes(log):
    for place in (log.path, log.path.parent):
        recording = Recording(place)
        assert read_messages(recording) == WRITTEN
        assert read_messages(recording) == WRITTEN  # as often as one likes
        message = next(recording.messages({NUT.name}))
        assert message == RecordedMessage(NUT.name, 125, data(77))


def test_topics_are_described_as_they_were_recorded(log):
    topics = Recording(log.path).topics
    assert list(topics) == [POSES.name, NUT.name]
    for topic in (POSES, NUT):
        found = topics[topic.name]
        assert (found.type, found.encoding, found.qos) == (topic.type, 'cdr', topic.qos)
        assert found.type_hash.startswith('RIHS01_')


def test_span_and_messages_of_selected_topics(log):
    recording = Recording(log.path)
    assert recording.span(recording.topics) == Span(100, 150, 7)
    assert recording.span([NUT.name]) == Span(125, 125, 1)
    assert read_messages(recording, [NUT.name]) == [(NUT.name, 125, 77)]
    assert read_messages(recording, [POSES.name]) == [
        each for each in WRITTEN if each[0] == POSES.name
    ]


def test_first_topics_are_yielded_first_and_once(tmp_path):
    """Only the first of each, at the start; one that is at the start already stays there."""
    with RunLog(tmp_path, 'run') as log:
        log.write(CUBE, data(1), 100)
        log.write(POSES, data(2), 110)
        log.write(NUT, data(3), 120)
        log.write(NUT, data(4), 130)
        log.write(CUBE, data(5), 140)
    found = read_messages(Recording(log.path), first={NUT.name, CUBE.name})
    assert found == [
        (CUBE.name, 100, 1),
        (NUT.name, 100, 3),
        (POSES.name, 110, 2),
        (NUT.name, 130, 4),
        (CUBE.name, 140, 5),
    ]


def test_open_log_has_the_messages_at_its_opening(tmp_path):
    log = RunLog(tmp_path, 'run')
    for k in range(3):
        log.write(POSES, data(k), k)
        log.flush()
    recording = Recording(log.path.parent)
    log.write(NUT, data(9), 3)
    log.flush()
    assert [k for _, _, k in read_messages(recording)] == [0, 1, 2]
    assert [k for _, _, k in read_messages(Recording(log.path.parent))] == [0, 1, 2, 9]
    log.close()
    assert [k for _, _, k in read_messages(recording)] == [0, 1, 2]


def test_truncated_file_has_its_complete_messages(log, tmp_path):
    content = log.path.read_bytes()
    cut = tmp_path / 'cut.mcap'
    flushed_at = dict(zip([1, 2, 4, 5, 6, 7], log.ends, strict=True))  # messages: bytes
    near_ends = {end + near for end in log.ends for near in (-1, 0, 1)}
    for size in sorted(near_ends | set(range(0, len(content), 41))):
        cut.write_bytes(content[:size])
        flushed = max((count for count, end in flushed_at.items() if end <= size), default=0)
        found = []
        with suppress(LogError):
            found = read_messages(Recording(cut))
        if not found:
            with pytest.raises(LogError, match='expected at least one message'):
                Recording(cut)
        assert found == WRITTEN[: len(found)]
        # A chunk is whole a few bytes before its index is.
        assert len(found) in (flushed, flushed + 1, 4 if flushed == 2 else flushed)
    assert found == WRITTEN  # without its index


def test_zeros_after_a_power_failure_are_ignored(log, tmp_path):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(log.path.read_bytes()[: log.ends[1]] + bytes(1000))
    assert read_messages(Recording(cut)) == WRITTEN[:2]


def write_foreign(path, channels, messages):
    """An MCAP file of another writer: (topic, encoding, schema, metadata), and (channel, time)."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        ids = []
        for topic, encoding, schema, metadata in channels:
            schema_id = writer.register_schema(schema, 'ros2msg', b'') if schema else 0
            ids.append(writer.register_channel(topic, encoding, schema_id, metadata))
        for k, (channel, time) in enumerate(messages):
            writer.add_message(ids[channel], time, data(k), time)
        writer.finish()


def test_decreasing_times_become_constant(tmp_path):
    path = tmp_path / 'a.mcap'
    write_foreign(path, [('/a', 'cdr', POSES.type, {})], [(0, 10), (0, 30), (0, 20), (0, 40)])
    recording = Recording(path)
    assert [(time, k) for _, time, k in read_messages(recording)] == [
        (10, 0),
        (30, 1),
        (30, 2),
        (40, 3),
    ]
    assert recording.span(['/a']) == Span(10, 40, 4)


def test_logs_of_other_writers_may_lack_qos_and_hash(tmp_path):
    path = tmp_path / 'a.mcap'
    channels = [('/a', 'json', '', {}), ('/b', 'cdr', POSES.type, {'offered_qos_profiles': ''})]
    write_foreign(path, [*channels, ('/never', 'cdr', NUT.type, {})], [(0, 1), (1, 2)])
    topics = Recording(path).topics
    assert list(topics) == ['/a', '/b']  # no message, no topic
    assert (topics['/a'].type, topics['/a'].encoding) == ('', 'json')
    assert topics['/b'].type == POSES.type
    assert all(topic.qos is topic.type_hash is None for topic in topics.values())


def test_topic_with_two_types_is_rejected(tmp_path):
    path = tmp_path / 'a.mcap'
    channels = [('/a', 'cdr', kind, {'topic_type_hash': 'h'}) for kind in (NUT.type, POSES.type)]
    write_foreign(path, channels, [(0, 1), (1, 2)])
    with pytest.raises(LogError) as caught:
        Recording(path)
    assert str(caught.value) == (
        f'invalid log {str(path)!r}: expected one type for topic /a, found {POSES.type} (h) and '
        f'{NUT.type} (h)'
    )


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('[{', 'is not valid YAML'),
        ('[' * 1000, 'is not valid YAML: it is nested too deeply'),
        ('!!timestamp abc', 'is not valid YAML'),
        ('[1, ' * 10**6, 'it has more than 65536 characters'),
        ('- depth: 1', 'expected profiles as rosbag2'),
        ('just words', 'expected profiles as rosbag2'),
        (yaml_text(qos_profiles(Qos(1))).replace(': reliable', ': 1'), 'QoS reliability 1:'),
        (yaml_text(qos_profiles(Qos(1))).replace('depth: 1', 'depth: x'), "QoS depth 'x'"),
        (yaml_text(qos_profiles(Qos(1))).replace('depth: 1', 'depth: 1.5'), 'QoS depth 1.5'),
        (yaml_text(qos_profiles(Qos(1))).replace('depth: 1', 'depth: 1' + 30 * '0'), 'depth 100'),
    ],
)
def test_invalid_qos_is_reported_with_its_topic(tmp_path, text, expected):
    path = tmp_path / 'a.mcap'
    write_foreign(path, [('/a', 'cdr', NUT.type, {'offered_qos_profiles': text})], [(0, 1)])
    with pytest.raises(LogError) as caught:
        Recording(path)
    message = str(caught.value).replace('/a: invalid QoS', '/a: QoS')
    assert message.startswith(f'log {str(path)!r}, topic /a: QoS ')
    assert expected in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    'qos', [POSES.qos, LATCHED, Qos(7, 'best_effort', 'volatile', 'keep_all'), Qos(0)]
)
def test_qos_is_read_as_it_was_written(qos):
    assert recorded_qos(yaml_text(qos_profiles(qos))) == qos


def profiles(*offered):
    return yaml_text([profile for qos in offered for profile in qos_profiles(qos)])


def test_strongest_qos_of_several_publishers_is_used():
    weak = Qos(3, 'best_effort', 'volatile', 'keep_last')
    for strong in (
        Qos(5, 'best_effort'), Qos(1, 'reliable'), Qos(1, durability='transient_local'),
        Qos(2, history='keep_all'),
    ):  # fmt: skip
        expected = Qos(max(3, strong.depth), strong.reliability, strong.durability, strong.history)
        for offered in ((weak, strong), (strong, weak)):
            assert recorded_qos(profiles(*offered)) == expected
    assert recorded_qos('[]') is None


def test_unspecified_qos_is_the_default_of_ros():
    """It records from the graph, where a publisher's history and depth cannot be seen."""
    recorded = profiles(POSES.qos).replace('keep_last', 'unknown').replace('2000', '0')
    assert recorded_qos(recorded) == Qos(0, 'reliable', 'transient_local', 'keep_last')
    everything = recorded.replace('reliable', 'system_default')
    everything = everything.replace('transient_local', 'best_available')
    default = QoSProfile(depth=1)
    assert recorded_qos(everything) == Qos(
        0,
        default.reliability.short_key,
        default.durability.short_key,
        default.history.short_key,
    )


@pytest.mark.parametrize('where', [-4, 12], ids=['length of a word', 'compressed bytes'])
def test_damaged_file_is_rejected_before_playback(log, where):
    content = bytearray(log.path.read_bytes())
    at = content.index(b'zstd', log.ends[3]) + where
    content[at : at + 4] = b'\xff' * 4
    log.path.write_bytes(content)
    with pytest.raises(LogError, match='is damaged: found'):
        Recording(log.path)


def test_file_removed_before_playback_is_reported(log):
    recording = Recording(log.path)
    log.path.unlink()
    with pytest.raises(LogError, match='cannot be read: No such file or directory'):
        read_messages(recording)


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('nowhere.mcap', "log '{}' cannot be read: No such file or directory"),
        ('folder', "folder '{}' is not a log: it has no .mcap file"),
        ('other.mcap', "log '{}' is damaged, or not an MCAP file: it begins with b'"),
        ('empty.mcap', "invalid log '{}': expected at least one message"),
        ('nothing', "invalid log '{}': expected at least one message"),
    ],
)
def test_invalid_logs_are_rejected(tmp_path, name, expected):
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'empty.mcap').touch()
    (tmp_path / 'other.mcap').write_text('aspect,count\n1,2\n')
    RunLog(tmp_path, 'nothing').close()
    path = tmp_path / name
    with pytest.raises(LogError) as caught:
        Recording(path)
    assert str(caught.value).startswith(expected.format(path))


def test_type_hash_is_read_from_the_log(tmp_path, monkeypatch):
    run_log = importlib.import_module('resting_aspects_ros.logs.run_writer')
    older = dataclasses.replace(run_log.load_schema(NUT.type), type_hash='RIHS01_older')
    monkeypatch.setattr(run_log, 'load_schema', lambda _: older)
    with RunLog(tmp_path, 'run') as log:
        log.write(NUT, data(1), 1)
    assert Recording(log.path).topics[NUT.name].type_hash == 'RIHS01_older'


def test_memory_does_not_grow_with_the_log(tmp_path):
    """200 messages of 100 kB that do not compress; the most is that of a few."""
    size, count = 100_000, 200
    state = bytearray(importlib.import_module('random').Random(1).randbytes(size))
    with RunLog(tmp_path, 'run') as log:
        for k in range(count):
            state[:8] = struct.pack('<Q', k)
            log.write(POSES, bytes(state), k)
            log.flush()
    tracemalloc.start()
    try:
        found = sum(len(message.data) for message in Recording(log.path).messages([POSES.name]))
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found == size * count
    assert most < 20 * size
