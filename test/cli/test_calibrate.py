"""`resting_aspects calibrate`: the whole command with few drops, and what it refuses."""

import json

import pytest
import yaml

from resting_aspects_ros.cli import life_cycle
from resting_aspects_ros.cli.life_cycle import DONE, INTERRUPTED
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.system import Interruption

COUNTS = """
surface: oak_table
conditions: {height: 60 mm}
parts:
  - {name: plate, box: [20, 20, 8], counts: {z: 92, rest: 8}}
  - {name: block, box: [20, 20, 15], counts: {z: 61, rest: 39}}
"""
FEW = ['--points', '8', '--drops', '10', '--workers', '1']


@pytest.fixture
def counts(tmp_path):
    path = tmp_path / 'counts.yaml'
    path.write_text(COUNTS, encoding='utf-8')
    return path


@pytest.mark.slow
def test_files_are_written(run, counts, tmp_path):
    out = tmp_path / 'out'
    ended = run('calibrate', counts, '--out', out, *FEW)
    assert ended.returncode == DONE, ended.stderr
    assert 'oak_table: 2 parts, 200 counted drops' in ended.stdout
    document = json.loads((out / 'calibration.json').read_text(encoding='utf-8'))
    entry = yaml.safe_load((out / 'surface.yaml').read_text(encoding='utf-8'))['oak_table']
    assert {name: entry[name] for name in QUANTITIES} == {
        name: document['conditions'][name] for name in QUANTITIES
    }
    assert {name: len(values) for name, values in entry['uncertainty'].items()} == {
        each['name']: 64 for each in document['estimates']
    }
    assert (out / 'calibration.png').read_bytes().startswith(b'\x89PNG')


def test_interrupted_command_says_that_there_is_no_result(run, counts, monkeypatch):
    class Asked(Interruption):
        def __enter__(self):
            self.asked = True
            return self

    monkeypatch.setattr(life_cycle, 'Interruption', Asked)
    ended = run('calibrate', counts, *FEW)
    assert (ended.returncode, ended.stdout) == (INTERRUPTED, '')
    assert 'there is no result' in ended.stderr
