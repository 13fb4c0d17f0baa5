"""The command `study`: its folder, its findings, and wrong input."""

import csv
import json

import pytest

FEW = ('--points', '2', '--drops', '20', '--workers', '1')
VARY = ('--vary', 'restitution=0.1:0.4', '--vary', 'friction=0.2:0.5')
LOW = ('--height', '30mm')


@pytest.mark.slow
def test_study_writes_its_folder_and_continues_it(run, tmp_path):
    first = run('study', 'tetrahedron', *VARY, *FEW, *LOW, '--out', 'out')
    assert first.returncode == 0, first.stderr
    for name in ('Restitution', 'Friction'):
        assert f'* {name}' in first.stdout
    assert 'Report: out/page.html' in first.stdout
    names = {path.name for path in (tmp_path / 'out').iterdir()}
    assert {'study.yaml', 'points.jsonl', 'results.csv', 'page.html', 'parts'} <= names
    before = (tmp_path / 'out/points.jsonl').read_bytes()
    more = run('study', 'out/study.yaml', '--points', '3', '--workers', '1')
    assert more.returncode == 0, more.stderr
    assert (tmp_path / 'out/points.jsonl').read_bytes().startswith(before)
    with (tmp_path / 'out/results.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert {int(row['point']) for row in rows} == set(range(3 * 2 * 7))
    page = (tmp_path / 'out/page.html').read_text()
    assert 'Sobol indices' in page
    assert 'http' not in page.replace('http://www.w3.org', '').replace('https://www.w3.org', '')


def test_folder_of_other_versions_is_refused(run, tmp_path):
    header = {'schema_version': 2, 'versions': {'numpy': '1.0'}}
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out/points.jsonl').write_text(json.dumps(header) + '\n')
    ended = run('study', 'tetrahedron', *VARY, *FEW, '--out', 'out')
    assert ended.returncode == 2
    assert 'drops of two versions do not belong together' in ended.stderr
