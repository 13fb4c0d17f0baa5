"""Results of `drop`: the document, the poses, the table and the files."""

import csv
import json

import numpy as np
import pytest
from PIL import Image

from resting_aspects_ros.api.result import POSES_HEADER
from resting_aspects_ros.aspects.find import find_aspects
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


def test_old_result_is_kept_if_there_is_no_new_one(run, tmp_path):
    poses = tmp_path / 'p.csv'
    poses.write_text('old', encoding='utf-8')
    (tmp_path / 'file').write_text('', encoding='utf-8')
    assert run(*WORDS, '--poses', 'p.csv', '--out', 'file').returncode == 2
    assert poses.read_text(encoding='utf-8') == 'old'


@pytest.mark.slow
def test_link_to_an_output_file_is_kept(run, tmp_path):
    (tmp_path / 'link.csv').symlink_to('p.csv')
    assert run(*WORDS, '--drops', 1, '--poses', 'link.csv').returncode == 0
    assert (tmp_path / 'link.csv').is_symlink()
    assert (tmp_path / 'p.csv').read_text(encoding='utf-8').startswith('drop,x,')
