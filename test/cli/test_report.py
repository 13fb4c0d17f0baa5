"""Reports from a log, from a JSON document, and from `drop`."""

import json
import re

import pytest
import trimesh
from PIL import Image

DROPS = 150
FIGURES = ('distribution', 'pie', 'convergence')


def page_of(ended, folder):
    """Return path and text of the page that a command reports."""
    assert ended.returncode == 0, ended.stderr
    path = folder / re.search(r'^Report: (.+)$', ended.stdout, re.MULTILINE)[1]
    return path, path.read_text(encoding='utf-8')


@pytest.fixture(scope='module')
def dropped(run_in, tmp_path_factory):
    """Drop the hex nut with a report and a log; returns the folder and the page."""
    folder = tmp_path_factory.mktemp('dropped')
    words = ('--drops', DROPS, '--seed', 3, '--out', 'o', '--report', '--log', 'logs')
    path, page = page_of(run_in(folder, 'drop', 'hex_nut', *words), folder)
    assert path == folder / 'o' / 'report.html'
    return folder, page


def test_drop_writes_a_report(dropped):
    folder, page = dropped
    document = json.loads((folder / 'o' / 'distribution.json').read_text())
    counts = re.findall(r'<span class="count">(\d+) of', page)
    assert [int(each) for each in counts[:2]] == [each['count'] for each in document['classes']]
    for name in FIGURES:
        with Image.open(folder / 'o' / f'{name}.png') as image:
            image.load()
        assert (folder / 'o' / f'{name}.svg').read_text().startswith('<?xml')
    for said in (document['mesh_sha256'], document['part_sha256'], document['run_id']):
        assert said in page


@pytest.mark.slow
@pytest.mark.parametrize('source', ['o/distribution.json', 'logs'])
def test_report_of_a_file_equals_that_of_its_drops(dropped, run_in, source):
    folder, at_once = dropped
    if source == 'logs':
        (source,) = (folder / source).iterdir()
    _, page = page_of(run_in(folder, 'report', source, '--out', 'again'), folder)
    assert page == at_once


@pytest.mark.slow
def test_report_finds_the_mesh_file_again(run, tmp_path):
    (tmp_path / 'mine').mkdir()
    trimesh.creation.box((1, 1, 2)).export(tmp_path / 'mine' / 'corner.stl')
    run('drop', 'mine/corner.stl', '--unit', 'in', '--drops', 20, '--out', 'o')
    _, page = page_of(run('report', 'o/distribution.json'), tmp_path)
    assert '25.4 x 25.4 x 50.8 mm' in page
    (tmp_path / 'mine' / 'corner.stl').rename(tmp_path / 'corner.stl')
    ended = run('report', 'o/distribution.json', '--out', 'without')
    assert ended.returncode == 2
    assert 'name it with --part' in ended.stderr
    words = ('report', 'o/distribution.json', '--part', 'corner.stl', '--unit', 'in')
    assert page_of(run(*words), tmp_path)[1] == page


@pytest.mark.slow
def test_measured_and_simulated_side_by_side(dropped, run_in):
    folder, _ = dropped
    document = json.loads((folder / 'o' / 'distribution.json').read_text())
    counts = [each['count'] for each in document['classes']]
    (folder / 'hand.csv').write_text('class,count\n1,60\n2,40\n')
    words = ('report', 'o/distribution.json', '--against', 'hand.csv', '--out', 'beside')
    _, page = page_of(run_in(folder, *words), folder)
    said = float(re.search(r'<dt>mean absolute deviation</dt><dd>([\d.]+) %', page)[1])
    assert said == pytest.approx(100 * abs(counts[0] / sum(counts) - 0.6), rel=0.05)
