"""`resting_aspects calibrate`: the whole command with few drops, and what it refuses."""

import json

import pytest
import yaml

from resting_aspects_ros.cli import life_cycle
from resting_aspects_ros.cli.life_cycle import DONE, INTERRUPTED
from resting_aspects_ros.simulation.conditions import QUANTITIES, Surfaces, surfaces_file
from resting_aspects_ros.system import Interruption

COUNTS = """
surface: {surface}
conditions: {{height: 60 mm}}
parts:
  - {{name: plate, box: [20, 20, 8], counts: {{z: {flat}, rest: {rest}}}}}
  - {{name: block, box: [20, 20, 15], counts: {{z: 61, rest: 39}}}}
"""
FEW = ['--points', '8', '--drops', '10', '--workers', '1']


@pytest.fixture
def counts(tmp_path):
    path = tmp_path / 'counts.yaml'
    path.write_text(COUNTS.format(surface='oak_table', flat=92, rest=8), encoding='utf-8')
    return path


@pytest.mark.slow
def test_files_are_written_and_read_again(run, counts, tmp_path):
    out = tmp_path / 'out'
    ended = run('calibrate', counts, '--out', out, *FEW)
    assert ended.returncode == DONE, ended.stderr
    assert 'oak_table: 2 parts, 200 counted drops' in ended.stdout
    document = json.loads((out / 'calibration.json').read_text(encoding='utf-8'))
    entry = yaml.safe_load((out / 'surface.yaml').read_text(encoding='utf-8'))['oak_table']
    assert {name: entry[name] for name in QUANTITIES} == {
        name: document['conditions'][name] for name in QUANTITIES
    }
    samples = entry['uncertainty']
    assert {name: len(values) for name, values in samples.items()} == {
        each['name']: 64 for each in document['estimates']
    }
    # The entry is that of a surfaces file, whose reader checks all values.
    both = surfaces_file().read_text('utf-8') + (out / 'surface.yaml').read_text('utf-8')
    (tmp_path / 'surfaces.yaml').write_text(both, encoding='utf-8')
    read = Surfaces.read(tmp_path / 'surfaces.yaml').get('oak_table').uncertainty
    assert [dict(each) for each in read] == [
        dict(zip(samples, row, strict=True)) for row in zip(*samples.values(), strict=True)
    ]
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
