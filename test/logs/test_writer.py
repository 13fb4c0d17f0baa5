"""Logs of runs, verified with independent readers: rosbags, mcap, and packages of JavaScript."""

import json
import math
import random
import shutil
import subprocess
from contextlib import closing
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, RestingPoses
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosTime
from rosbags.rosbag2 import Reader
from wire import bag_messages, plain

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.reader import messages as messages_of
from resting_aspects_ros.logs.topics import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    Qos,
    Topic,
    qos_profiles,
)
from resting_aspects_ros.logs.writer import RunLog, run_folder_name

LATCHED = Qos(depth=1, durability='transient_local')
PART = Topic('/parts/l_bracket', PART_TYPE, LATCHED)
POSES = Topic('/resting_poses', POSES_TYPE, Qos(2000, durability='transient_local'))
DISTRIBUTION = Topic('/aspect_distributions/l_bracket', DISTRIBUTION_TYPE, LATCHED)
# A second topic of a type that is there already, and another QoS.
OTHER_PART = Topic('/parts/nut', PART.type, Qos(7, 'best_effort', 'volatile', 'keep_all'))

START = 1_700_000_000_123_456_789  # ns; no double holds it
MESH = random.Random(5).randbytes(10_000)
RUN = {'run_id': '4f1c', 'seed': '1', 'note': 'café: "yes"\nno'}


@pytest.fixture(scope='module')
def messages(filled):
    """List what a run publishes: topic, message, log time and publish time in ns.

    With all that is hard to carry.
    """
    rng = random.Random(1)
    part = filled(PartDescription, rng)
    part.mesh, part.name = MESH, ''
    part.inertia.ixx, part.inertia.ixy, part.inertia.iyy = 0.1, -0.0, 1e-300
    batches = [filled(RestingPoses, rng) for _ in range(4)]
    batches[0].first_drop = 2**64 - 1
    batches[0].run.started.sec = -(2**31)
    batches[0].position = [-0.0, 5e-324, 1.7976931348623157e308]
    batches[1].time_to_rest[2] = math.nan
    batches[1].energy_growth[1] = math.inf
    distributions = [filled(AspectDistribution, rng) for _ in range(4)]
    distributions[0].drops = 2**53 + 1
    distributions[0].complete = False
    one, other, *_ = distributions[0].aspects
    one.min_barrier, one.com_height, one.basin_share = -math.inf, 2.0, 2.0**60
    other.support.points[0].x = 0.10000000149011612  # of 32 bits
    messages = [(PART, part), (OTHER_PART, PartDescription())]
    for pair in zip(batches, distributions, strict=True):
        messages += zip((POSES, DISTRIBUTION), pair, strict=True)
    return [
        (topic, message, START + 1000 * i, START + 1000 * i - 77)
        for i, (topic, message) in enumerate(messages)
    ]


@pytest.fixture(scope='module')
def log(messages, tmp_path_factory):
    """Write a log as the recorder does, and give it closed."""
    folder = tmp_path_factory.mktemp('logs')
    with closing(RunLog(folder / 'not' / 'there', 'l_bracket_run')) as log:
        log.add_metadata('run', RUN)
        log.attach('l_bracket.stl', 'model/stl', MESH, START)
        for topic, message, log_time, publish_time in messages:
            log.write(topic, serialize_message(message), log_time, publish_time)
            log.flush()
    return log


@pytest.fixture(params=['file', 'folder'])
def place(log, request):
    """Give the log as a bare file and as a folder that is read through metadata.yaml."""
    return log.path if request.param == 'file' else log.path.parent


def information(log):
    text = (log.path.parent / 'metadata.yaml').read_text(encoding='utf-8')
    return yaml.safe_load(text)['rosbag2_bagfile_information']


# -- what readers find ---------------------------------------------------------------------------


def test_rosbags_reads_messages_with_stored_definitions(place, messages):
    with AnyReader([place]) as reader:
        assert reader.message_count == len(messages) == 10
        found = [
            (c.topic, c.msgtype, time, plain(reader.deserialize(data, c.msgtype)))
            for c, time, data in reader.messages()
        ]
    for (topic, message, log_time, _), read in zip(messages, found, strict=True):
        assert read == (topic.name, topic.type, log_time, plain(message))


def test_rosbags_finds_counts_times_and_qos(place, messages):
    with Reader(place) as reader:
        assert reader.start_time == START
        assert reader.end_time == START + 9000 + 1
        counts = {c.topic: c.msgcount for c in reader.connections}
        profiles = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
    assert counts == {PART.name: 1, OTHER_PART.name: 1, POSES.name: 4, DISTRIBUTION.name: 4}
    for topic in (PART, OTHER_PART, POSES, DISTRIBUTION):
        (found,) = profiles[topic.name]
        names = (found.reliability.name, found.durability.name, found.history.name)
        expected = (topic.qos.reliability, topic.qos.durability, topic.qos.history)
        assert names == tuple(name.upper() for name in expected)
        assert found.depth == topic.qos.depth
        infinite = QosTime(9223372036, 854775807)
        assert found.deadline == found.lifespan == found.liveliness_lease_duration == infinite


def test_mcap_reads_times_mesh_and_run_description(log, messages):
    with log.path.open('rb') as file:
        reader = make_reader(file)
        found = [(each.publish_time, each.sequence) for _, _, each in reader.iter_messages()]
        (mesh,) = reader.iter_attachments()
        records = {each.name: each.metadata for each in reader.iter_metadata()}
    numbers = [0, 0, 0, 0, 1, 1, 2, 2, 3, 3]
    times = [publish_time for *_, publish_time in messages]
    assert found == list(zip(times, numbers, strict=True))
    assert (mesh.name, mesh.media_type, mesh.log_time) == ('l_bracket.stl', 'model/stl', START)
    assert mesh.data == MESH
    assert records['run'] == RUN
    # The record that rosbag2 looks for in a file without its folder.
    assert yaml.safe_load(records['rosbag2']['serialized_metadata']) == information(log)


def test_metadata_yaml_is_that_of_jazzy(log):
    assert log.path == log.path.parent / 'l_bracket_run_0.mcap'
    # Readers in other locales decode it; an alias would be another topic to some of them.
    text = (log.path.parent / 'metadata.yaml').read_bytes().decode('ascii')
    assert '&id' not in text
    found = information(log)
    topics = found.pop('topics_with_message_count')
    span = {
        'duration': {'nanoseconds': 9000},
        'starting_time': {'nanoseconds_since_epoch': START},
        'message_count': 10,
    }
    assert found == {
        'version': 9,
        'storage_identifier': 'mcap',
        **span,
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [log.path.name],
        'files': [{'path': log.path.name, **span}],
        'custom_data': {f'run.{key}': value for key, value in RUN.items()},
        'ros_distro': 'jazzy',
    }
    assert [each['message_count'] for each in topics] == [1, 1, 4, 4]
    fields = 'name type serialization_format offered_qos_profiles type_description_hash'
    assert all(list(each['topic_metadata']) == fields.split() for each in topics)


# -- what JavaScript finds -----------------------------------------------------------------------

JS = Path(__file__).parents[1] / 'js'


@pytest.fixture(scope='module')
def in_javascript(log):
    """Read the log with node."""
    oldest = json.loads((JS / 'package.json').read_text())['engines']['node'].removeprefix('>=')
    node = shutil.which('node')
    version = node and subprocess.check_output([node, '--version'], text=True).strip()
    if not version or int(version[1:].split('.')[0]) < int(oldest):
        pytest.skip(f'node is {version or "not installed"}, needed is {oldest} or newer')
    if not (JS / 'node_modules' / '.package-lock.json').exists():  # npm's last file
        pytest.skip(f'the packages in {JS / "package.json"} are not installed: make dev does it')
    command = [node, JS / 'read_log.js', log.path.parent]
    text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    # Doubles that are whole and large are written without an exponent.
    return json.loads(text, parse_int=lambda digits: number(int(digits)))


def number(value):
    """As read_log.js and json have a number."""
    if math.isnan(value):
        return {'number': 'NaN'}
    if math.isinf(value):
        return {'number': 'Infinity' if value > 0 else '-Infinity'}
    if value == 0 and math.copysign(1, value) < 0:
        return {'number': '-0'}
    # Whole numbers beyond this are bigint where 64 bits are declared, else doubles.
    return int(value) if value == int(value) and abs(value) <= 2**53 else float(value)


def exact(value, kind=''):
    """A field of a ROS message as read_log.js has it, by the field's type."""
    if hasattr(value, 'get_fields_and_field_types'):
        fields = value.get_fields_and_field_types()
        names = {'nanosec': 'nsec'} if kind == 'builtin_interfaces/Time' else {}
        return {
            names.get(name, name): exact(getattr(value, name), fields[name]) for name in fields
        }
    if kind in ('sequence<uint8>', 'uint8[]'):
        return {'bytes': bytes(value).hex()}
    if kind.endswith(('>', ']')):
        element = kind.removeprefix('sequence<').rstrip('>').split('[')[0]
        return [exact(each, element) for each in value]
    if kind in ('int64', 'uint64'):
        return {'bigint': str(value)}
    return number(value) if kind in ('double', 'float') else value


@pytest.mark.slow
@pytest.mark.stated_requirement
@pytest.mark.parametrize('way', ['indexed', 'streamed'])
def test_javascript_reads_every_value_of_every_message(in_javascript, messages, way):
    read = in_javascript[way]['messages']
    for (topic, message, log_time, publish_time), entry in zip(messages, read, strict=True):
        assert (entry['topic'], entry['type']) == (topic.name, topic.type)
        assert entry['encodings'] == ['ros2msg', 'cdr']
        assert entry['logTime'] == {'bigint': str(log_time)}
        assert entry['publishTime'] == {'bigint': str(publish_time)}
        assert yaml.safe_load(entry['metadata']['offered_qos_profiles']) == qos_profiles(topic.qos)
        # As text, because to Python 1 == 1.0 == True.
        one, other = (
            json.dumps(each, sort_keys=True) for each in (entry['value'], exact(message))
        )
        assert one == other


@pytest.mark.slow
@pytest.mark.stated_requirement
def test_javascript_reads_metadata_and_attachments(in_javascript, messages):
    indexed = in_javascript['indexed']
    assert indexed['compressions'] == ['zstd'] * len(messages)
    assert indexed['attachments'][0]['data'] == {'bytes': MESH.hex()}
    assert {each['name']: each['metadata'] for each in indexed['metadata']}['run'] == RUN
    assert in_javascript['streamed']['whole'] is True


# -- other logs ----------------------------------------------------------------------------------


def test_log_times_do_not_decrease(tmp_path):
    with closing(RunLog(tmp_path, 'run')) as log:
        for log_time, publish_time in [(10, None), (5, None), (12, 3)]:
            log.write(PART, b'\0' * 8, log_time, publish_time)
    with log.path.open('rb') as file:
        found = [(m.log_time, m.publish_time) for *_, m in make_reader(file).iter_messages()]
    assert found == [(10, 10), (10, 5), (12, 3)]
    assert information(log)['duration'] == {'nanoseconds': 2}


# -- crashes and errors --------------------------------------------------------------------------


def test_full_disk_keeps_the_written_messages(tmp_path, no_space_after):
    batches = [random.Random(i).randbytes(50_000) for i in range(4)]
    log = RunLog(tmp_path, 'run')
    with no_space_after(180_000):
        for i in range(3):
            log.write(POSES, batches[i], i)
            log.flush()
        log.write(POSES, batches[3], 3)
        for refused in (log.flush, lambda: log.write(POSES, b'', 4)):
            with pytest.raises(LogError, match=f'{log.path} cannot be written: File too large'):
                refused()
        log.close()
    assert list(messages_of(log.path, POSES.type)) == batches[:3]
    assert not (tmp_path / 'run' / 'metadata.yaml').exists()


def test_failed_metadata_yaml_leaves_a_complete_file(tmp_path):
    log = RunLog(tmp_path, 'run')
    log.write(POSES, b'batch 00', 1)
    (tmp_path / 'run' / 'metadata.yaml.tmp').mkdir()
    with pytest.raises(LogError, match='cannot be written: Is a directory'):
        log.close()
    assert len(bag_messages(log.path)) == 1


def test_interrupted_write_ends_the_log(tmp_path):
    log = RunLog(tmp_path, 'run')
    log.write(POSES, b'batch 00', 1)
    log.flush()
    with pytest.raises(TypeError):
        log.write(POSES, 'not bytes', 2)
    with pytest.raises(LogError, match=f'log {log.path} was interrupted: TypeError'):
        log.write(POSES, b'batch 01', 3)
    log.close()
    assert list(messages_of(log.path, POSES.type)) == [b'batch 00']


def test_existing_log_is_not_overwritten(tmp_path):
    RunLog(tmp_path, 'run').close()
    with pytest.raises(LogError, match='run exists already and is not overwritten'):
        RunLog(tmp_path, 'run')
    assert bag_messages(tmp_path / 'run') == []


def test_rejected_messages_leave_the_log_unchanged(tmp_path):
    unknown = Topic('/x', 'no_msgs/msg/Nothing', LATCHED)
    with closing(RunLog(tmp_path, 'run')) as log:
        log.write(POSES, b'batch 00', 1)
        with pytest.raises(LogError, match='no_msgs/msg/Nothing is not installed'):
            log.write(unknown, b'', 2)
        log.write(POSES, b'batch 01', 2)
    assert [data for _, _, data in bag_messages(log.path.parent)] == [b'batch 00', b'batch 01']


def test_run_folder_name():
    started = datetime(2025, 1, 31, 23, 59, 58, 999_999, timezone(timedelta(hours=-2)))
    assert run_folder_name('l_bracket', started, '4f1c') == 'l_bracket_20250201T015958Z_4f1c'
