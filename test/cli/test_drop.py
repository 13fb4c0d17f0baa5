"""`drop`: its inputs, the document, the poses and the files, and several parts at once."""

import argparse
import csv
import json
import shutil

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.options import parse_integer, parse_share
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses
from resting_aspects_ros.system import parts_folder


def test_outputs_of_a_run_agree(run, tmp_path):
    (tmp_path / 'link.csv').symlink_to('p.csv')
    words = ('drop', 'box_10x20x30', '--seed', 7, '--drops', 630)  # two chunks, for two workers
    ended = run(*words, '--workers', 2, '--json', '--poses', 'link.csv', '--out', 'deep/o')
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    with (tmp_path / 'p.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['drop']) for row in rows] == list(range(630))
    counts = np.bincount([int(row['aspect']) for row in rows], minlength=7)
    assert [aspect['count'] for aspect in document['aspects']] == counts[1:].tolist()
    statuses = [row['status'] for row in rows]
    for name in ('unsettled', 'failed'):
        assert document[name] == statuses.count(name.upper())
    out = tmp_path / 'deep' / 'o'
    names = sorted(path.name for path in out.iterdir())
    assert names == ['distribution.json', 'distribution.png', 'poses.csv']
    assert (out / 'distribution.json').read_text(encoding='utf-8') == ended.stdout
    assert (out / 'poses.csv').read_bytes() == (tmp_path / 'p.csv').read_bytes()
    assert (tmp_path / 'link.csv').is_symlink()


def test_numbers_in_any_notation():
    assert [parse_integer(text) for text in ('1e1', '10', '1.0e1', '1_0', '10.0')] == [10] * 5
    for text in ('1.5', 'inf', '1e-999999999', ''):
        with pytest.raises(argparse.ArgumentTypeError):
            parse_integer(text)
    assert [parse_share('x', text) for text in ('25%', '0.25', '25 %', '.25')] == [0.25] * 4


@pytest.mark.slow
def test_a_body_of_a_mesh_is_used(run, refused, tmp_path):
    large = trimesh.creation.box((20, 30, 40))
    small = trimesh.creation.box((10, 12, 14))
    small.apply_translation((50, 0, 0))
    trimesh.util.concatenate([small, large]).export(tmp_path / 'two.stl')
    assert '10 x 12 x 14 mm' in refused('drop', 'two.stl')
    ended = run('drop', 'two.stl', '--drops', 20, '--out', 'o', '--body', 2)
    assert '10 x 12 x 14 mm' in ended.stdout
    assert json.loads((tmp_path / 'o' / 'distribution.json').read_text())['body'] == 2


@pytest.mark.slow
def test_one_bad_file_does_not_cost_the_others(run, tmp_path):
    folder = tmp_path / 'designs'
    folder.mkdir()
    for name in ('one', 'two'):
        shutil.copy(parts_folder() / 'tetrahedron.stl', folder / f'{name}.stl')
    ended = run('drop', 'designs', 'missing.stl', '--drops', 20, '--workers', 1, '--out', 'out')
    assert ended.returncode == 1
    assert "'missing.stl' does not exist" in ended.stderr
    index = (tmp_path / 'out/index.html').read_text()
    for text in ('href="one/report.html"', 'one and two side by side', '1 of 3 parts failed'):
        assert text in index
    assert (tmp_path / 'out' / 'two' / 'report.html').is_file()


@pytest.mark.slow
def test_shift_compares_the_same_drops_with_half_the_time_step(part, surfaces):
    bracket = part('l_bracket')
    result = ra.drop(bracket, 500, check_convergence=True)
    found = result.convergence
    assert found.time_step == pytest.approx(result.run.time_step / 2, rel=1e-12)
    job = make_job(bracket, surfaces.get(), 1, refinement=2)
    fine = count_poses(find_aspects(bracket), drop_range(job, 0, 500)).counts
    before = result.distribution.counts
    shift = fine / fine.sum() - before / before.sum()
    moved = int(np.abs(shift).argmax())
    assert (found.column, found.number) == (moved, 500)
    assert found.shift == pytest.approx(shift[moved], abs=1e-12)
    assert found.lower <= found.shift <= found.upper


@pytest.mark.slow
def test_run_without_resting_parts_has_a_result(run):
    words = ('--drops', 2, '--restitution', 1, '--friction', 0, '--check-convergence', '--json')
    ended = run('drop', 'l_bracket', *words)
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    assert document['unsettled'] + document['unclassified'] + document['failed'] == 2
    assert 'convergence' not in document
    assert 'warning: convergence could not be determined: no drop came to rest' in ended.stderr
