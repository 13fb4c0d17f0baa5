"""Definitions and hashes of message types, compared with rosbags, which computes both."""

import json
import re
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.message_definitions import load_schema, share_folders

LINE = '=' * 80


@pytest.fixture
def share(tmp_path, monkeypatch):
    """Return a new share folder that is searched before the installed ones."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    return tmp_path / 'prefix' / 'share'


def install(share: Path, type_name: str, text: str) -> None:
    path = share / f'{type_name}.msg'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    hashes = [{'type_name': type_name, 'hash_string': 'RIHS01_of_' + path.stem}]
    path.with_suffix('.json').write_text(json.dumps({'type_hashes': hashes}))


def named_in(text: str) -> list[str]:
    return re.findall(r'^MSG: (.*)$', text, re.MULTILINE)


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
    schemas = [load_schema(name) for name in types]
    # rosbags takes `char` for int8; to ROS 2 it is uint8, as its hash shows.
    schemas = [each for each in schemas if not re.search(r'^char\b', each.text, re.MULTILINE)]
    assert len(schemas) >= len(types) - 10
    differing = {}
    for schema in schemas:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema.text, schema.name))
        computed = store.hash_rihs01(schema.name)
        if computed != schema.type_hash:
            differing[schema.name] = (computed, schema.type_hash)
    assert differing == {}


def test_every_dependency_is_included_once():
    text = load_schema('resting_aspects_interfaces/msg/AspectDistribution').text
    assert sorted(named_in(text)) == [
        'builtin_interfaces/Time',
        'geometry_msgs/Point32',
        'geometry_msgs/Polygon',
        'geometry_msgs/Quaternion',
        'geometry_msgs/Vector3',
        'resting_aspects_interfaces/Aspect',
        'resting_aspects_interfaces/ContactShare',
        'resting_aspects_interfaces/DropConditions',
        'resting_aspects_interfaces/RunDescription',
        'resting_aspects_interfaces/SymmetryClass',
        'std_msgs/Header',
    ]


def test_layout_of_the_text(share):
    install(share, 'a_msgs/msg/Top', 'Inner one\nb_msgs/Other two\n')
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


@pytest.mark.parametrize(
    'field',
    [
        'Leaf one',
        '  Leaf   indented',
        'Leaf[] many',
        'Leaf[3] three',
        'Leaf[<=3] few',
        'a_msgs/Leaf named',
        'a_msgs/Leaf[<=12]\tafter_a_tab',
        'Leaf commented # uint8 x',
    ],
)
def test_fields_that_need_a_definition(share, field):
    install(share, 'a_msgs/msg/Top', f'{field}\n')
    install(share, 'a_msgs/msg/Leaf', 'bool x\n')
    assert named_in(load_schema('a_msgs/msg/Top').text) == ['a_msgs/Leaf']


@pytest.mark.parametrize(
    'line',
    [
        '',
        '# Leaf commented_out',
        '   # Leaf commented_out',
        'string<=10 bounded',
        'wstring<=10[<=3] bounded_twice',
        'string[] names ["Leaf one"]',
        'uint8 LEAF=1  # Leaf one',
        'string LEAF="Leaf one"',
        'float64[6] inertia',
        'int32[<=2] few [1, 2]',
        'byte b',
        'char c',
    ],
)
def test_lines_that_need_no_definition(share, line):
    install(share, 'a_msgs/msg/Top', f'{line}\nbool x\n')
    assert named_in(load_schema('a_msgs/msg/Top').text) == []


def test_type_without_package_is_from_the_same_package(share):
    # ROS 1 had a special case here; rosidl has none, and would not build another reading.
    install(share, 'a_msgs/msg/Top', 'Header header\nstd_msgs/Header other\n')
    install(share, 'a_msgs/msg/Header', 'bool x\n')
    names = named_in(load_schema('a_msgs/msg/Top').text)
    assert names == ['a_msgs/Header', 'std_msgs/Header', 'builtin_interfaces/Time']


def test_sourced_workspace_precedes_the_environment(share):
    install(share, 'geometry_msgs/msg/Point', 'float64 only\n')
    assert load_schema('geometry_msgs/msg/Point').text == 'float64 only\n'
    assert share_folders() == [share, Path(sys.prefix) / 'share']


def test_virtual_environment_needs_no_sourcing(monkeypatch):
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    assert share_folders() == [Path(sys.prefix) / 'share']
    assert 'float64 x' in load_schema('geometry_msgs/msg/Point').text


def test_missing_type_is_an_error(share):
    with pytest.raises(LogError) as caught:
        load_schema('no_msgs/msg/Nothing')
    assert str(caught.value) == (
        'the definition of message type no_msgs/msg/Nothing is not installed: '
        f'there is no no_msgs/msg/Nothing.msg in {share}, {Path(sys.prefix) / "share"}'
    )


def test_missing_dependency_is_named(share):
    install(share, 'a_msgs/msg/Top', 'Missing one\n')
    with pytest.raises(LogError, match='message type a_msgs/msg/Missing is not installed'):
        load_schema('a_msgs/msg/Top')


@pytest.mark.parametrize('content', ['', '{}', '{"type_hashes": []}', '{"type_hashes": 3}'])
def test_description_without_hash_is_an_error(share, content):
    install(share, 'a_msgs/msg/Top', 'bool x\n')
    description = share / 'a_msgs/msg/Top.json'
    description.write_text(content)
    with pytest.raises(LogError) as caught:
        load_schema('a_msgs/msg/Top')
    assert str(caught.value).startswith(f'{description} contains no hash of a_msgs/msg/Top')


def test_missing_description_is_an_error(share):
    install(share, 'a_msgs/msg/Top', 'bool x\n')
    (share / 'a_msgs/msg/Top.json').unlink()
    with pytest.raises(LogError, match=r'Top\.json cannot be read: .*No such file'):
        load_schema('a_msgs/msg/Top')
