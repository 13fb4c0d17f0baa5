"""`resting_aspects calibrate`: the whole command with few drops."""

import json

import pytest
import yaml

from resting_aspects_ros.simulation.conditions import QUANTITIES

COUNTS = """
surface: oak_table
conditions: {height: 60 mm}
parts:
  - {name: plate, box: [20, 20, 8], counts: {z: 92, rest: 8}}
  - {name: block, box: [20, 20, 15], counts: {z: 61, rest: 39}}
"""
FEW = ['--points', '8', '--drops', '10', '--workers', '1']


@pytest.mark.slow
def test_files_are_written(run, tmp_path):
    out = tmp_path / 'out'
    (tmp_path / 'counts.yaml').write_text(COUNTS, encoding='utf-8')
    ended = run('calibrate', 'counts.yaml', '--out', out, *FEW)
    assert ended.returncode == 0, ended.stderr
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
