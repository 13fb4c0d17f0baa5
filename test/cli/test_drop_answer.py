"""Results of `drop`: the document, the poses, the table and the files."""

import csv
import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resting_aspects_ros.api.result import POSES_HEADER
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus

DROPS = 630  # two chunks, for two workers
WORDS = ('drop', 'box_10x20x30', '--seed', 7)


@pytest.fixture(scope='module')
def box_run(run_in, tmp_path_factory):
    """Run with all outputs; returns the folder and the ended process."""
    folder = tmp_path_factory.mktemp('box')
    outputs = ('--json', '--poses', 'p.csv', '--out', 'deep/o')
    ended = run_in(folder, *WORDS, '--drops', DROPS, '--workers', 2, *outputs)
    assert ended.returncode == 0, ended.stderr
    return folder, ended


@pytest.fixture(scope='module')
def document(box_run):
    return json.loads(box_run[1].stdout)


@pytest.fixture(scope='module')
def rows(box_run):
    with (box_run[0] / 'p.csv').open(newline='', encoding='utf-8') as file:
        return list(csv.reader(file))


def same_run(document):
    return {key: value for key, value in document.items() if key not in ('run_id', 'started')}


def test_document_describes_part_and_conditions(document, part, surfaces):
    box, conditions = part('box_10x20x30'), surfaces.get()
    expected = {
        'schema_version': 2,
        'part': 'box_10x20x30',
        'mesh_sha256': box.mesh_sha256,
        'part_sha256': box.part_sha256,
        'method': 'drops',
        'drops': DROPS,
        'confidence': 0.95,
        'interval': 'wilson',
        'seed': 7,
        'complete': True,
        'engine': 'kernel',
        'engine_version': '1',
        'time_step': make_job(box, conditions, 7).time_step,
        'conditions': {
            **{name: getattr(conditions, name) for name in QUANTITIES},
            'height_of': 'LOWEST_POINT',
            'surface': 'rubber_mat',
            'surroundings': '',
        },
    }
    assert {key: document[key] for key in expected} == expected


def test_counts_add_up_and_lengths_are_metres(document):
    aspects = document['aspects']
    assert [aspect['id'] for aspect in aspects] == [1, 2, 3, 4, 5, 6]
    outside = sum(document[name] for name in ('unclassified', 'unsettled', 'failed'))
    assert sum(aspect['count'] for aspect in aspects) + outside == DROPS
    assert aspects[0]['com_height'] == pytest.approx(0.005)
    for aspect in aspects:
        assert aspect['probability'] == aspect['count'] / DROPS
        assert 0 <= aspect['lower'] <= aspect['probability'] <= aspect['upper'] <= 1
        assert aspect['lower'] < aspect['upper']
        assert np.linalg.norm(aspect['down_in_part']) == pytest.approx(1)
        assert len(aspect['down_in_part']) == 3


def test_json_is_the_only_output_on_stdout(box_run):
    _, ended = box_run
    assert ended.stdout.startswith('{\n')
    assert ended.stdout.endswith('}\n')
    for line in ended.stderr.splitlines():
        assert line.startswith('box_10x20x30: ')


def test_the_number_of_workers_changes_nothing(document, run):
    ended = run(*WORDS, '--drops', DROPS, '--workers', 1, '--json')
    assert same_run(json.loads(ended.stdout)) == same_run(document)


def test_changed_condition_is_converted_and_stored(run):
    documents = [
        json.loads(run(*WORDS, '--drops', 2, '--height', height, '--json').stdout)
        for height in ('50mm', '0.05')
    ]
    assert documents[0]['conditions']['height'] == 0.05
    assert documents[0]['conditions']['surface'] == ''
    assert same_run(documents[0]) == same_run(documents[1])


def test_poses_are_those_of_the_engine_bit_for_bit(rows, part, surfaces):
    job = make_job(part('box_10x20x30'), surfaces.get(), 7)
    header, *rows = rows
    names = 'drop,x,y,z,qx,qy,qz,qw,status,decided_by,time_to_rest,energy_growth,aspect'
    assert ','.join(header) == names
    assert [int(row[0]) for row in rows] == list(range(DROPS))
    poses = drop_range(job, 0, DROPS)
    for k, row in enumerate(rows):
        assert [float(x) for x in row[1:4]] == poses.position[k].tolist()
        assert [float(x) for x in row[4:8]] == poses.orientation[k].tolist()
        assert row[8:10] == [
            RestStatus(poses.status[k]).name,
            DecidedBy(poses.decided_by[k]).name,
        ]
        assert float(row[10]) == poses.time_to_rest[k]
        assert float(row[11]) == poses.energy_growth[k]


def test_counts_are_those_of_the_poses(rows, document, part):
    fields = dict(zip(POSES_HEADER, zip(*rows[1:], strict=True), strict=True))
    columns = {name: np.array(fields[name], dtype=float) for name in POSES_HEADER[1:8]}
    poses = RestingPoses(
        first_drop=0,
        position=np.stack([columns[name] for name in ('x', 'y', 'z')], axis=1),
        orientation=np.stack([columns[name] for name in ('qx', 'qy', 'qz', 'qw')], axis=1),
        status=np.array([RestStatus[name] for name in fields['status']], dtype=np.uint8),
        decided_by=np.array([DecidedBy[name] for name in fields['decided_by']], dtype=np.uint8),
        time_to_rest=np.array(fields['time_to_rest'], dtype=float),
        energy_growth=np.array(fields['energy_growth'], dtype=float),
    )
    aspects = find_aspects(part('box_10x20x30'))
    counted = no_drops(aspects) + count_poses(aspects, poses)
    assert [aspect['count'] for aspect in document['aspects']] == counted.counts.tolist()
    ids = np.array(fields['aspect'], dtype=int)
    assert np.bincount(ids, minlength=7)[1:].tolist() == counted.counts.tolist()
    assert document['unclassified'] == counted.unclassified
    assert document['unsettled'] == counted.unsettled
    assert document['energy_growth'] == poses.energy_growth.max()


def test_the_first_drops_of_a_run_are_the_shorter_run(rows, run, tmp_path):
    ended = run(*WORDS, '--drops', 20, '--poses', 'few.csv')
    assert ended.returncode == 0
    with (tmp_path / 'few.csv').open(newline='', encoding='utf-8') as file:
        assert list(csv.reader(file)) == rows[:21]


def test_out_holds_the_same_and_a_picture(box_run, document):
    folder, ended = box_run
    out = folder / 'deep' / 'o'
    names = sorted(path.name for path in out.iterdir())
    assert names == ['distribution.json', 'distribution.png', 'poses.csv']
    assert (out / 'distribution.json').read_text(encoding='utf-8') == ended.stdout
    assert (out / 'poses.csv').read_bytes() == (folder / 'p.csv').read_bytes()
    with Image.open(out / 'distribution.png') as picture:
        picture.load()
        assert min(picture.size) > 200


def test_piped_table_fits_80_columns_without_colour(run, tmp_path):
    ended = run(*WORDS, '--drops', 5, '--height', '50mm', '--out', tmp_path)
    lines = ended.stdout.splitlines()
    assert [line.rstrip() for line in lines[:2]] == [
        'box_10x20x30, 10 x 20 x 30 mm',
        '5 drops on rubber_mat with height 0.05 m, seed 7',
    ]
    assert max(map(len, lines[:-1])) <= 80
    assert '\x1b' not in ended.stdout
    # Opposite sides look the same.
    for ids in ('1 and 2', '3 and 4', '5 and 6'):
        assert any(line.strip().startswith(f'{ids}  flat side ') for line in lines)
    assert lines[-1].startswith('Written: ')
    for path in lines[-1].removeprefix('Written: ').split(', '):
        assert Path(path).is_file()


def test_old_result_is_kept_if_there_is_no_new_one(run, tmp_path):
    poses = tmp_path / 'p.csv'
    poses.write_text('old', encoding='utf-8')
    (tmp_path / 'file').write_text('', encoding='utf-8')
    assert run(*WORDS, '--poses', 'p.csv', '--out', 'file').returncode == 2
    assert poses.read_text(encoding='utf-8') == 'old'


def test_link_to_an_output_file_is_kept(run, tmp_path):
    (tmp_path / 'link.csv').symlink_to('p.csv')
    assert run(*WORDS, '--drops', 1, '--poses', 'link.csv').returncode == 0
    assert (tmp_path / 'link.csv').is_symlink()
    assert (tmp_path / 'p.csv').read_text(encoding='utf-8').startswith('drop,x,')


def test_closed_pipe_prints_no_error(begin, environment):
    assert 'PYTHONUNBUFFERED' not in environment
    reader, writer = os.pipe()
    os.close(reader)
    process = begin(*WORDS, '--drops', 1, '--json', stdout=writer)
    os.close(writer)
    errors = process.communicate(timeout=600)[1]
    assert 'Traceback' not in errors
    assert 'Broken' not in errors
    assert process.returncode == 1


def test_full_disk_behind_stdout_prints_one_line(run_process):
    with Path('/dev/full').open('w') as full:
        ended = run_process(
            *WORDS,
            '--drops',
            1,
            '--json',
            capture_output=False,
            stdout=full,
            stderr=subprocess.PIPE,
        )
    assert ended.returncode == 1
    assert 'Traceback' not in ended.stderr
    assert ended.stderr.splitlines()[-1] == 'error: standard output: No space left on device'


def test_precision_stops_at_the_same_drop_for_any_workers(run):
    found = []
    for workers in (1, 2):
        ended = run('drop', 'tetrahedron', '--precision', 0.02, '--workers', workers, '--json')
        assert ended.returncode == 0, ended.stderr
        found.append(json.loads(ended.stdout))
    one, other = found
    assert one['aspects'] == other['aspects']
    assert one['complete']
    assert one['drops'] == other['drops'] < one['drops_asked']
    assert max(a['upper'] - a['lower'] for a in one['aspects']) <= 2 * 0.02


@pytest.mark.parametrize('precision', ['0.9', '0', 'nan', 'fine'])
def test_invalid_precision_is_refused(refused, precision):
    assert precision in refused(*WORDS, '--precision', precision)


def test_precision_not_reached_in_max_drops_is_reported(run):
    ended = run('drop', 'tetrahedron', '--precision', 0.05, '--drops', 50)
    assert ended.returncode == 0
    # Wilson interval, 96 %, for about a quarter of 50 drops: +-0.12.
    assert re.search(
        r'warning: precision 0.05 was not reached in 50 drops, .* widest interval is \+-0.1[0-9]',
        ended.stderr,
    )
    reached = run('drop', 'tetrahedron', '--precision', 0.1)
    assert 'warning' not in reached.stderr
