"""`classify` on poses of `drop`, on other poses, and on wrong input."""

import json

import numpy as np
import pytest

DROPS = 125
ROTATION = ('qx', 'qy', 'qz', 'qw')


@pytest.fixture(scope='module')
def dropped(run_in, tmp_path_factory):
    """Drop an L bracket; returns the file of poses and the document."""
    folder = tmp_path_factory.mktemp('drops')
    words = ('l_bracket', '--drops', DROPS, '--seed', 3, '--poses', 'p.csv', '--json')
    ended = run_in(folder, 'drop', *words)
    assert ended.returncode == 0, ended.stderr
    return folder / 'p.csv', json.loads(ended.stdout)


@pytest.fixture
def sorted_by(run):
    """Classify with --json; returns the document, and checks that stderr is empty."""

    def document(*words):
        ended = run('classify', *words, '--json')
        assert (ended.returncode, ended.stderr) == (0, '')
        return json.loads(ended.stdout)

    return document


def write(path, poses, header='qw,qx,qy,qz'):
    order = [ROTATION.index(name) for name in header.split(',')]
    rows = [','.join(f'{x:.4f}' for x in pose[order]) for pose in poses]
    path.write_text('\n'.join([header, *rows]) + '\n', encoding='utf-8')


def test_classify_counts_dropped_poses_like_drop(dropped, sorted_by):
    path, expected = dropped
    found = sorted_by(path, '--part', 'l_bracket')
    same = ('schema_version', 'part', 'part_sha256', 'drops', 'unclassified', 'unsettled')
    for name in (*same, 'failed', 'confidence', 'interval'):
        assert found[name] == expected[name]
    for one, other in zip(found['aspects'], expected['aspects'], strict=True):
        assert {name: other[name] for name in one.keys() & other.keys()} == {
            name: one[name] for name in one.keys() & other.keys()
        }
    assert found['tolerance'] == pytest.approx(np.radians(5))


def test_tolerance_changes_the_clusters(sorted_by, tmp_path):
    angles = np.radians([0, 6]) / 2
    write(tmp_path / 'p.csv', np.stack([np.sin(angles), 0 * angles, 0 * angles, np.cos(angles)]).T)
    assert len(sorted_by('p.csv')['clusters']) == 2
    assert len(sorted_by('p.csv', '--tolerance', 6.1)['clusters']) == 1
