"""Wrong input of each command: exit code 2, and one line that names the flag or the value.

What a function refuses is tested with the function; here are what the command line parses itself,
flags that contradict each other, and files that only commands read.
"""

import json
import os
import shlex

import pytest
import trimesh

FILES = {
    'counts.csv': 'class,count\n1,27\n2,31\n3,22\n4,15\n5,9\n',
    'poses.csv': 'qx,qy,qz,qw\n0,0,0,1\n0,0,0,0.99\n',
    'states.csv': 'z_com_m,qx,qy,qz,qw\n0.1,0,0,0,1\n',
    'seen.json': json.dumps({'outer': [[0.1, 0], [0.14, 0], [0.14, 0.02], [0.1, 0.02]]}),
    'text.mcap': 'hello',
}
CASES = {
    # The command line itself.
    'no_verb': ['no_verb'],
    'drop tetrahedron --friktion 1': ['--friktion', '--friction'],
    'reorient tetrahedron --export map.json': ['--export', 'resting_aspects reorient --help'],
    'forecast tetrahedron --pickable 1 3': ['3', '1,3'],
    # Numbers with units, and mesh files.
    'drop tetrahedron --height -3mm': ['height', '-0.003'],
    'drop tetrahedron --drops 1e999999999': ['--drops', '1e999999999'],
    'drop box': ["'box'", "'box.obj'"],
    'drop': ['part', '--from-log'],
    # Output files are checked before the drops.
    'drop l_bracket --log text.mcap': ['--log', "'text.mcap'"],
    'drop l_bracket --report': ['--report', 'l_bracket'],
    'drop l_bracket --table t.ods': ['--table', "'t.ods'"],
    # Flags that contradict each other.
    'drop tetrahedron hex_nut --json': ['--json', 'single part'],
    'drop tetrahedron --replicates 2': ['--replicates', '--initial-states'],
    'drop --from-log log --seed 0': ['--seed', "'0'", '--from-log'],
    'drop tetrahedron --initial-states states.csv --height 1m': ['--height', "'1.0'"],
    'classify poses.csv --unit mm': ['--unit', "'mm'", '--part'],
    'drift l_bracket counts.csv --expected counts.csv --drops 50': ['--drops', "'50'"],
    'forecast l_bracket hex_nut t_prism --pickable 1 --pickable 2': ['--pickable', '2', '3'],
    'optimise l_bracket --vary height=1cm:2cm --wanted 1 --actions a.yaml': ['--actions'],
    'reorient l_bracket --action tap,tap': ['--action', "'tap,tap'"],
    'reorient l_bracket --action tap,toss --speed 1': ['--action', '--speed'],
    'report log --part l_bracket': ['--part', "'l_bracket'"],
    'study tetrahedron': ['--vary'],
    'track hex_nut --on wiper_and_balcony --roll 5deg': ['roll', '--on'],
    # Values that a command parses.
    'drift l_bracket counts.csv --shift 5': ['--shift', "'5'", '5%'],
    'feeder_demo --out folder --pickable 9': ['9', '1 to 5'],
    'forecast l_bracket --pickable a': ['--pickable', "'a'"],
    'replay log --rate 1001': ['rate', '1001'],
    'request l_bracket --ros-args --bogus': ['--bogus'],
    'studio none.stl': ["'none.stl'", 'l_bracket'],
    'track hex_nut --trap wiper:12mm': ['--trap', "'wiper:12mm'"],
    # Surroundings.
    'drop tetrahedron --surroundings l_chut': ["'l_chut'", "'l_chute'"],
    'drop tetrahedron --surroundings': ['l_chute', 'v_groove'],
    'drop tetrahedron --surroundings slope --set angle': ["'angle'", 'NAME=VALUE'],
    'drop tetrahedron --surroundings l_chute --set wal.friction=1': ["'wal'", 'belt, wall'],
    'drop tetrahedron --set angle=9deg': ["'angle=9deg'", '--surroundings'],
    # Files that only commands read.
    'info nowhere': ["'nowhere'", 'No such file'],
    'drop --from-log text.mcap': ["'text.mcap'", "b'hello'"],
    'report seen.json': ["'seen.json'", 'schema_version'],
}


@pytest.mark.parametrize('command', CASES, ids=lambda command: command.replace('\n', ' '))
def test_wrong_input_is_refused(refused, tmp_path, command):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding='utf-8')
    trimesh.creation.box((10, 20, 30)).export(tmp_path / 'box.obj')
    for folder in ('folder', 'log'):
        (tmp_path / folder).mkdir()
    (tmp_path / 'out').touch()  # in place of the default folder
    line = refused(*shlex.split(command))
    for said in CASES[command]:
        assert said in line


STATE = 'z_com_m,qx,qy,qz,qw\n'
DAMAGED = [
    ('drop', 'broken.stl', 'hello', 'broken.stl'),
    ('reorient tetrahedron --actions', 'a.yaml', 'tap: {kind: jump}', "'jump'"),
    ('drop tetrahedron --initial-states', 's.csv', f'{STATE}0.1,0,0,0,2\n', 'quaternion'),
    ('drop tetrahedron --initial-states', 's.csv', f'{STATE}a,0,0,0,1\n', "z_com_m 'a'"),
    ('identify l_bracket --polygon', 'p.json', '[1, 2', 'JSON'),
]


@pytest.mark.parametrize(('command', 'name', 'text', 'said'), DAMAGED)
def test_damaged_file_is_refused(refused, tmp_path, command, name, text, said):
    (tmp_path / name).write_text(text, encoding='utf-8')
    assert said in refused(*command.split(), name)


@pytest.mark.parametrize(
    'words', ['aspects tetrahedron --unit {}', 'aspects tetrahedron --{}', 'compare {} {}']
)
def test_errors_are_short_and_printable_for_any_input(refused, words):
    for value in ('x' * 1_000_000, 'a\x1b[31m\x07b', 'a b ' * 200_000):
        line = refused(*(word.format(value) for word in words.split()))
        assert line.isprintable()
        assert len(line) <= 2100


@pytest.mark.parametrize('words', ['replay {}', 'nodes --ros-args -p log_folder:={}'])
def test_name_invalid_in_ros_is_refused(refused, tmp_path, words):
    odd = os.fsdecode(b'\xff')
    (tmp_path / odd).mkdir()
    (tmp_path / odd / 'run_0.mcap').touch()
    said = refused(*words.format(odd).split())
    assert r'\udcff' in said
    assert 'UTF-8' in said
