"""Topics and their QoS; definitions and hashes of types, as rosbags computes them."""

import json
import re
import sys
from pathlib import Path

import pytest
from rclpy.qos import QoSProfile
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.logs.topics import (
    Qos,
    load_schema,
    qos_profiles,
    recorded_qos,
    share_folders,
)

LINE = '=' * 80
LATCHED = Qos(1, durability='transient_local')
DEEP = Qos(2000, durability='transient_local')


@pytest.fixture
def share(tmp_path, monkeypatch):
    """Return a new share folder that is searched before the installed ones."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    return tmp_path / 'prefix' / 'share'


def install(share: Path, type_name: str, text: str, *depends: str) -> None:
    path = share / f'{type_name}.msg'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    hashes = [
        {'type_name': name, 'hash_string': f'RIHS01_of_{Path(name).stem}'}
        for name in (type_name, *depends)
    ]
    path.with_suffix('.json').write_text(json.dumps({'type_hashes': hashes}))


def installed_types() -> list[str]:
    # Several wheels lay out a package that others only add files to: a type may be named twice.
    return sorted(
        {
            f'{path.parent.parent.name}/msg/{path.stem}'
            for folder in share_folders()
            for path in folder.glob('*/msg/*.msg')
        }
    )


def test_type_hashes_match_those_of_rosbags():
    types = installed_types()
    assert 'resting_aspects_interfaces/msg/AspectDistribution' in types
    assert len(types) > 100
    # All of the suite, and every fifth of the others.
    chosen = [n for k, n in enumerate(types) if n.startswith('resting_aspects') or not k % 5]
    schemas = [load_schema(name) for name in chosen]
    # rosbags takes `char` for int8; to ROS 2 it is uint8, as its hash shows.
    schemas = [each for each in schemas if not re.search(r'^char\b', each.text, re.MULTILINE)]
    assert len(schemas) > 40
    differing = {}
    for schema in schemas:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema.text, schema.name))
        computed = store.hash_rihs01(schema.name)
        if computed != schema.type_hash:
            differing[schema.name] = (computed, schema.type_hash)
    assert differing == {}


def test_layout_of_the_text(share):
    install(
        share,
        'a_msgs/msg/Top',
        'Inner one\nb_msgs/Other two\n',
        'a_msgs/msg/Inner',
        'b_msgs/msg/Other',
    )
    install(share, 'a_msgs/msg/Inner', 'b_msgs/Other again  # no newline at the end')
    install(share, 'b_msgs/msg/Other', 'uint8 x\n')
    schema = load_schema('a_msgs/msg/Top')
    assert schema.text == (
        'Inner one\nb_msgs/Other two\n'
        f'\n{LINE}\nMSG: a_msgs/Inner\nb_msgs/Other again  # no newline at the end\n'
        f'\n{LINE}\nMSG: b_msgs/Other\nuint8 x\n'
    )
    assert schema.name == 'a_msgs/msg/Top'
    assert schema.type_hash == 'RIHS01_of_Top'


def test_sourced_workspace_precedes_the_environment(share):
    install(share, 'geometry_msgs/msg/Point', 'float64 only\n')
    assert load_schema('geometry_msgs/msg/Point').text == 'float64 only\n'
    assert share_folders() == [share, Path(sys.prefix) / 'share']


def test_missing_type_is_an_error(share):
    with pytest.raises(LogError) as caught:
        load_schema('no_msgs/msg/Nothing')
    assert str(caught.value) == (
        'the definition of message type no_msgs/msg/Nothing is not installed: '
        f'there is no no_msgs/msg/Nothing.msg in {share}, {Path(sys.prefix) / "share"}'
    )


@pytest.mark.parametrize('content', ['', '{"type_hashes": []}'])
def test_description_without_hash_is_an_error(share, content):
    install(share, 'a_msgs/msg/Top', 'bool x\n')
    description = share / 'a_msgs/msg/Top.json'
    description.write_text(content)
    with pytest.raises(LogError) as caught:
        load_schema('a_msgs/msg/Top')
    assert str(caught.value).startswith(f'{description} contains no hash of a_msgs/msg/Top')


# -- topics and QoS -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'qos', [DEEP, LATCHED, Qos(7, 'best_effort', 'volatile', 'keep_all'), Qos(0)]
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
    recorded = profiles(DEEP).replace('keep_last', 'unknown').replace('2000', '0')
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


@pytest.mark.parametrize(
    ('make', 'expected'),
    [
        (lambda: Qos(-1), 'invalid QoS depth -1: expected an integer from 0 to'),
        (lambda: Qos(1, '1'), "invalid QoS reliability '1': expected reliable or"),
    ],
)
def test_invalid_topics_are_rejected(make, expected):
    with pytest.raises(LogError) as caught:
        make()
    assert expected in str(caught.value)
