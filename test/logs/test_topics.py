"""Topics and their QoS; definitions and hashes of types, as rosbags computes them."""

import json
import re

from rclpy.qos import QoSProfile
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.logs.topics import (
    Qos,
    load_schema,
    qos_profiles,
    recorded_qos,
    share_folders,
)


def test_type_hashes_match_those_of_rosbags():
    paths = [path for folder in share_folders() for path in folder.glob('*/msg/*.msg')]
    # Several wheels lay out a package that others only add files to: a type may be named twice.
    types = sorted({f'{path.parent.parent.name}/msg/{path.stem}' for path in paths})
    # All of the suite, and every tenth of the others.
    chosen = [n for k, n in enumerate(types) if n.startswith('resting_aspects') or not k % 10]
    schemas = [(name, *load_schema(name)) for name in chosen]
    # rosbags takes `char` for int8; to ROS 2 it is uint8, as its hash shows.
    schemas = [each for each in schemas if not re.search(r'^char\b', each[1], re.MULTILINE)]
    assert len(schemas) > 30
    for name, text, type_hash in schemas:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text, name))
        assert store.hash_rihs01(name) == type_hash, name


def test_sourced_workspace_precedes_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    folder = tmp_path / 'share' / 'geometry_msgs' / 'msg'
    folder.mkdir(parents=True)
    (folder / 'Point.msg').write_text('float64 only\n')
    hashes = [{'type_name': 'geometry_msgs/msg/Point', 'hash_string': 'RIHS01_x'}]
    (folder / 'Point.json').write_text(json.dumps({'type_hashes': hashes}))
    assert load_schema('geometry_msgs/msg/Point') == ('float64 only\n', 'RIHS01_x')


def profiles(*offered):
    return yaml_text([profile for qos in offered for profile in qos_profiles(qos)])


def test_strongest_qos_of_several_publishers_is_used():
    weak = Qos(3, 'best_effort', 'volatile', 'keep_last')
    for strong in (Qos(5), Qos(1, durability='transient_local'), Qos(2, history='keep_all')):
        expected = Qos(max(3, strong.depth), strong.reliability, strong.durability, strong.history)
        assert recorded_qos(profiles(strong)) == strong
        for offered in ((weak, strong), (strong, weak)):
            assert recorded_qos(profiles(*offered)) == expected
    assert recorded_qos('[]') is None


def test_unspecified_qos_is_the_default_of_ros():
    """It records from the graph, where a publisher's history and depth cannot be seen."""
    recorded = profiles(Qos(2000, durability='transient_local'))
    recorded = recorded.replace('keep_last', 'unknown').replace('2000', '0')
    assert recorded_qos(recorded) == Qos(0, 'reliable', 'transient_local', 'keep_last')
    recorded = recorded.replace('reliable', 'system_default')
    found = recorded_qos(recorded.replace('transient_local', 'best_available'))
    of_ros = QoSProfile(depth=1)
    for policy in ('reliability', 'durability', 'history'):
        assert getattr(found, policy) == getattr(of_ros, policy).short_key
