"""Logs are read exactly by the JavaScript packages of MCAP and Foxglove."""

import json
import math
import random
import shutil
import subprocess
from contextlib import closing
from pathlib import Path

import pytest
import yaml
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, RestingPoses

from resting_aspects_ros.logs.topics import Qos, Topic, qos_profiles
from resting_aspects_ros.logs.writer import RunLog

JS = Path(__file__).parents[1] / 'js'
OLDEST = json.loads((JS / 'package.json').read_text())['engines']['node'].removeprefix('>=')

LATCHED = Qos(depth=1, durability='transient_local')
TYPES = (RestingPoses, AspectDistribution, PartDescription)
START = 1_700_000_000_123_456_789  # ns; no double holds it
MESH = random.Random(6).randbytes(100_000)
RUN = {'run_id': '4f1c', 'note': 'café: "yes"\nno'}
# In JavaScript, whole numbers beyond this are bigint where 64 bits are declared, else doubles.
SAFE = 2**53


pytestmark = [pytest.mark.stated_requirement, pytest.mark.slow]


@pytest.fixture(scope='module')
def read():
    """Read a log with node."""
    node = shutil.which('node')
    version = node and subprocess.check_output([node, '--version'], text=True).strip()
    if not version or int(version[1:].split('.')[0]) < int(OLDEST):
        pytest.skip(f'node is {version or "not installed"}, needed is {OLDEST} or newer')
    if not (JS / 'node_modules' / '.package-lock.json').exists():  # npm's last file
        pytest.skip(f'the packages in {JS / "package.json"} are not installed: make dev does it')

    def read(path):
        ended = subprocess.run(
            [node, JS / 'read_log.js', path], capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr
        # Doubles that are whole and large are written without an exponent.
        whole = json.loads(ended.stdout, parse_int=lambda text: number(int(text)))
        assert not ended.stderr
        return whole

    return read


def topic(kind):
    return Topic(
        f'/cell/{kind.__name__}', f'resting_aspects_interfaces/msg/{kind.__name__}', LATCHED
    )


@pytest.fixture(scope='module')
def messages(filled):
    """Every type that is recorded, with all that is hard to carry: message, and times."""
    rng = random.Random(2)
    poses, distribution, part = odd = [filled(kind, rng) for kind in TYPES]
    poses.first_drop = 2**64 - 1
    poses.run.started.sec = -(2**31)
    poses.time_to_rest[0] = math.nan
    poses.energy_growth[1] = math.inf
    poses.position = [-0.0, 5e-324, 1.7976931348623157e308]
    distribution.drops = 2**53 + 1
    distribution.aspects[0].min_barrier = -math.inf
    distribution.aspects[1].com_height = 2.0
    distribution.aspects[1].basin_share = 2.0**60
    distribution.aspects[2].support.points[0].x = 0.10000000149011612  # of 32 bits
    distribution.complete = False
    part.mesh = MESH
    part.inertia.ixx, part.inertia.ixy, part.inertia.iyy = 0.1, -0.0, 1e-300
    part.name = ''
    found = [*odd, *(kind() for kind in TYPES), *(filled(kind, rng) for kind in TYPES)]
    return [(each, START + 1001 * k, START + 1001 * k - 7) for k, each in enumerate(found)]


@pytest.fixture(scope='module')
def found(read, messages, tmp_path_factory):
    """What is read of a log that is written as the recorder does it."""
    with closing(RunLog(tmp_path_factory.mktemp('logs'), 'run')) as log:
        log.add_metadata('run', RUN)
        log.attach('nut.stl', 'model/stl', MESH, START)
        for message, log_time, publish_time in messages:
            log.write(topic(type(message)), serialize_message(message), log_time, publish_time)
            log.flush()
    return read(log.path.parent)


def number(value):
    """As read_log.js and json have a number."""
    if math.isnan(value):
        return {'number': 'NaN'}
    if math.isinf(value):
        return {'number': 'Infinity' if value > 0 else '-Infinity'}
    if value == 0 and math.copysign(1, value) < 0:
        return {'number': '-0'}
    return int(value) if value == int(value) and abs(value) <= SAFE else float(value)


def exact(value, kind):
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
    if kind in ('double', 'float'):
        return number(value)
    assert kind in ('boolean', 'string') or 'int' in kind
    return value


@pytest.mark.parametrize('way', ['indexed', 'streamed'])
def test_every_value_of_every_message_is_read(found, messages, way):
    read = found[way]['messages']
    assert len(read) == len(messages) == 9
    for k, (message, log_time, publish_time) in enumerate(messages):
        entry, expected = read[k], exact(message, '')
        assert entry['topic'] == topic(type(message)).name
        assert entry['type'] == topic(type(message)).type
        assert entry['encodings'] == ['ros2msg', 'cdr']
        assert entry['logTime'] == {'bigint': str(log_time)}
        assert entry['publishTime'] == {'bigint': str(publish_time)}
        assert entry['sequence'] == k // 3
        assert yaml.safe_load(entry['metadata']['offered_qos_profiles']) == qos_profiles(LATCHED)
        # To Python 1 == 1.0 == True.
        assert json.dumps(entry['value'], sort_keys=True) == json.dumps(expected, sort_keys=True)


def test_metadata_and_attachments_are_read(found, messages):
    indexed = found['indexed']
    assert indexed['profile'] == 'ros2'
    assert indexed['compressions'] == ['zstd'] * len(messages)
    assert indexed['statistics']['messageCount'] == {'bigint': str(len(messages))}
    (mesh,) = indexed['attachments']
    assert (mesh['name'], mesh['mediaType']) == ('nut.stl', 'model/stl')
    assert mesh['logTime'] == {'bigint': str(START)}
    assert mesh['data'] == {'bytes': MESH.hex()}
    assert {each['name']: each['metadata'] for each in indexed['metadata']}['run'] == RUN
    assert found['streamed']['whole'] is True
