"""The command `study`: its folder, its findings, and surfaces of one's own."""

import csv

import pytest
import yaml

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.simulation.conditions import QUANTITIES


@pytest.mark.slow
def test_study_writes_its_folder_and_continues_it(run, tmp_path):
    # A file with one surface, as `calibrate` writes it: without those of the suite.
    mat = shipped_surfaces().get()
    ice = {name: getattr(mat, name) for name in QUANTITIES} | {'friction': 0.02}
    own = tmp_path / 'own.yaml'
    own.write_text(yaml.safe_dump({'ice': {**ice, 'height_of': 'LOWEST_POINT'}}))
    words = ('--vary', 'restitution=0.1:0.4', '--vary', 'height=20mm:40mm')
    few = ('--points', '2', '--drops', '20', '--workers', '1', '--out', 'out')
    first = run('study', 'tetrahedron', *words, *few, '--surfaces', own, '--surface', 'ice')
    assert first.returncode == 0, first.stderr
    assert first.stdout.count('\n* ') == 2
    assert 'Report: out/page.html' in first.stdout
    names = {path.name for path in (tmp_path / 'out').iterdir()}
    assert {'study.yaml', 'points.jsonl', 'results.csv', 'page.html', 'parts'} <= names
    written = yaml.safe_load((tmp_path / 'out' / 'study.yaml').read_text(encoding='utf-8'))
    assert (written['surface'], written['conditions']['friction']) == ('ice', 0.02)
    before = (tmp_path / 'out/points.jsonl').read_bytes()
    own.unlink()  # it is continued without this file
    more = run('study', 'out/study.yaml', '--points', '3', '--workers', '1')
    assert more.returncode == 0, more.stderr
    assert (tmp_path / 'out/points.jsonl').read_bytes().startswith(before)
    with (tmp_path / 'out/results.csv').open() as file:
        assert {int(row['point']) for row in csv.DictReader(file)} == set(range(3 * 2 * 7))
