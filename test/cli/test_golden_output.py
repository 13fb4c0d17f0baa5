"""Golden output of each command that needs no running nodes.

Each file of test/golden/cli has what a command prints, on both streams, and the files that it
writes. After a change that is meant to change them,
``UPDATE_GOLDEN=1 python -m pytest test/cli/test_golden_output.py`` writes the files again; the
commit says why.
"""

import functools
import json
import os
import re
import shutil
from pathlib import Path

import pytest

from resting_aspects_ros.cli.verbs import COMMANDS

GOLDEN = Path(__file__).resolve().parents[1] / 'golden' / 'cli'
# What differs in each run: ids and times of runs, and sizes.
VARYING = (
    (re.compile(r'\d{8}T\d{6}Z_[0-9a-f]+'), 'TIME_ID'),
    (re.compile(r'(run (?:id +)?)[0-9a-f]{8,}'), r'\1ID'),
    (re.compile(r'\d+\.\d+ MB'), 'SIZE'),
    (re.compile(r'\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC'), 'TIME'),
)
CASES = {
    'drop': 'drop l_bracket --drops 200 --seed 3 --check-convergence --out out',
    'drop_in_a_chute': 'drop l_bracket --drops 100 --surroundings l_chute',
    'drop_states': 'drop l_bracket --initial-states states.csv --replicates 3',
    'reorient': 'reorient l_bracket --per-aspect 20 --drops 50 --action tap,toss --wanted 1',
    'retention': 'retention tetrahedron --per-height 10 --out out',
    'study': 'study tetrahedron --vary restitution=0.2:0.6 --points 2 --drops 20',
    'optimise': 'optimise l_bracket --vary height=20mm:200mm --wanted 1 --budget 2000 --out out',
    'aspects': 'aspects hex_nut',
    'aspects_each': 'aspects l_bracket --each',
    'estimate': 'estimate cylinder_d20_h20 --against out/distribution.json',
    'outlines': 'outlines l_bracket --out out',
    'identify': 'identify l_bracket --polygon seen.json',
    'forecast': 'forecast hex_nut --pickable-classes 1 --per-aspect 20 --drops 50 --out out',
    'track': 'track hex_nut --on wiper_and_balcony --drops 200',
    'drift': 'drift l_bracket counted.csv --drops 500 --window 40',
    'report': 'report out/distribution.json --out page',
    'compare': 'compare out/distribution.json counted.csv',
    'classify': 'classify out/poses.csv --part l_bracket',
    'info': 'info logs',
    'recover': 'recover logs',
}
BRACKET = 'drop l_bracket --drops 200 --seed 3 --out out --log logs'
PREPARED = {
    'estimate': 'drop cylinder_d20_h20 --drops 200 --out out',
    **dict.fromkeys(('report', 'compare', 'classify', 'info', 'recover'), BRACKET),
}
# Tested with their nodes; calibrate takes a minute, and has tests of its own.
OTHERS = {'request', 'nodes', 'demo', 'feeder_demo', 'replay', 'calibrate', 'studio'}
STATES = 'z_com_m,qx,qy,qz,qw,vz\n0.05,0,0,0,1,-0.1\n0.05,0.6,0,0,0.8,0\n'
COUNTED = 'class,count\n1,27\n2,31\n3,22\n4,15\n5,9\n'


@pytest.fixture
def files(tmp_path):
    """Write the files that the cases read."""
    (tmp_path / 'states.csv').write_text(STATES)
    (tmp_path / 'counted.csv').write_text(COUNTED)
    square = [[0.0, 0.0], [0.04, 0.0], [0.04, 0.02], [0.0, 0.02]]
    (tmp_path / 'seen.json').write_text(json.dumps({'outer': square, 'holes': []}))


@pytest.fixture(scope='module')
def prepared(run_in, tmp_path_factory):
    """Return the folder of a command, which is run once."""

    @functools.cache
    def folder(words):
        made = tmp_path_factory.mktemp('prepared')
        assert run_in(made, *words.split()).returncode == 0
        return made

    return folder


def fixed(text):
    for pattern, instead in VARYING:
        text = pattern.sub(instead, text)
    lines = [line.rstrip() for line in text.splitlines()]
    return [line for line in lines if not re.search(r'/s$|^compiling |: \d+ of \d+ ', line)]


def shown(ended, folder, before):
    """Return what a command printed and wrote, as text."""
    written = sorted(
        fixed(path.relative_to(folder).as_posix())[0]
        for path in folder.rglob('*')
        if path.is_file() and path not in before
    )
    return '\n'.join(
        [
            f'exit code {ended.returncode}',
            *fixed(ended.stdout),
            '---- standard error',
            *fixed(ended.stderr),
            '---- files',
            *written,
            '',
        ]
    )


@pytest.mark.parametrize('name', CASES)
def test_output_is_the_recorded_one(run, files, prepared, tmp_path, name):
    if name in PREPARED:
        shutil.copytree(prepared(PREPARED[name]), tmp_path, dirs_exist_ok=True)
    words = CASES[name].split()
    if words[-1] == 'logs':
        (words[-1],) = [path.relative_to(tmp_path) for path in (tmp_path / 'logs').iterdir()]
    before = set(tmp_path.rglob('*'))
    found = shown(run(*words), tmp_path, before)
    golden = GOLDEN / f'{name}.txt'
    if os.environ.get('UPDATE_GOLDEN'):
        golden.parent.mkdir(exist_ok=True)
        golden.write_text(found, encoding='utf-8')
    assert found.splitlines() == golden.read_text(encoding='utf-8').splitlines()


def test_every_command_has_an_output():
    assert {words.split()[0] for words in CASES.values()} | OTHERS == COMMANDS.keys()
