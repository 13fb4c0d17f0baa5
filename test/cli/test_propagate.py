"""`resting_aspects drop --propagate`: the whole command with few drops, and what it refuses."""

import json

import pytest
import yaml

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.cli.life_cycle import DONE, FAILED, WRONG_INPUT
from resting_aspects_ros.errors import OutputError
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.studies.propagate import PropagatedResult

DRAWS = [{'friction': 0.1 + 0.05 * k, 'restitution': 0.6 - 0.05 * k} for k in range(8)]
FEW = ['--drops', '16', '--workers', '1']


@pytest.fixture
def calibration(tmp_path):
    """Return the file calibration.json of a surface with 8 draws."""
    base = shipped_surfaces().get()
    conditions = {name: getattr(base, name) for name in QUANTITIES}
    document = {
        'surface': 'oak_table',
        'conditions': {**conditions, 'height_of': base.height_of.name},
        'draws': DRAWS,
    }
    path = tmp_path / 'calibration.json'
    path.write_text(json.dumps(document), encoding='utf-8')
    return path


def test_json_page_and_table_show_both_intervals(run, calibration, tmp_path):
    out = tmp_path / 'out'
    ended = run('drop', 'tetrahedron', '--propagate', calibration, *FEW, '--out', out)
    assert ended.returncode == DONE, ended.stderr
    assert 'tetrahedron: 16 drops on oak_table\n2 at each of 8 samples' in ended.stdout
    assert 'by sampling alone   with the surface' in ended.stdout
    document = json.loads((out / 'propagated.json').read_text(encoding='utf-8'))
    (one,) = document['classes']
    assert one['count'] + sum(document['other'].values()) == 16
    assert one['sampling'][0] >= one['with_surface'][0]
    used = [each['conditions'] for each in document['samples']]
    assert sorted(used, key=lambda each: each['friction']) == DRAWS
    page = (out / 'report.html').read_text(encoding='utf-8')
    assert 'samples from 0.1 to 0.45' in page


def test_named_surface_has_its_own_uncertainty(run, calibration, tmp_path):
    base = shipped_surfaces().get()
    entry = {name: getattr(base, name) for name in QUANTITIES} | {'height_of': base.height_of.name}
    entry['uncertainty'] = {name: [each[name] for each in DRAWS] for name in DRAWS[0]}
    (tmp_path / 'own.yaml').write_text(yaml.safe_dump({'oak_table': entry}))
    words = ['drop', 'tetrahedron', *FEW, '--json', '--propagate']
    named = run(*words, '--surface', 'oak_table', '--surfaces', tmp_path / 'own.yaml')
    given = run(*words, calibration)
    assert named.returncode == given.returncode == DONE, named.stderr
    assert named.stdout == given.stdout


def test_full_disk_does_not_lose_the_result(run, calibration, monkeypatch):
    def full(*_):
        raise OutputError('propagated.json cannot be written: No space left on device')

    monkeypatch.setattr(PropagatedResult, 'save_json', full)
    ended = run('drop', 'tetrahedron', '--propagate', calibration, *FEW, '--out', 'o', '--json')
    assert ended.returncode == FAILED
    assert 'No space left on device' in ended.stderr
    assert json.loads(ended.stdout)['drops'] == 16


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--propagate'], 'invalid surface rubber_mat: expected one with an uncertainty'),
        (['--propagate', 'absent.json'], "invalid calibration 'absent.json'"),
        (['--propagate', 'FILE', '--friction', '0.3'], 'invalid --friction'),
        (['--propagate', 'FILE', '--surface', 'steel'], 'invalid --surface steel'),
        (['--propagate', 'FILE', '--log', 'logs'], "invalid --log 'logs': expected only"),
        (['--propagate', 'FILE', '--drops', '15'], 'invalid drops 15: expected at least 16'),
    ],
)
def test_wrong_input_is_one_line(run, calibration, words, message):
    given = [calibration if word == 'FILE' else word for word in words]
    ended = run('drop', 'tetrahedron', *given, '--workers', '1')
    assert ended.returncode == WRONG_INPUT
    (line,) = ended.stderr.splitlines()
    assert message in line


def test_part_stands_before_the_flag(refused):
    assert refused('drop', '--propagate', 'l_bracket').endswith('before --propagate')
