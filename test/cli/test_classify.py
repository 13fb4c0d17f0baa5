"""`classify` on poses of `drop`, on other poses, and on wrong input."""

import json

import numpy as np
import pytest

ROTATION = ('qx', 'qy', 'qz', 'qw')


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


def test_tolerance_changes_the_clusters(sorted_by, tmp_path):
    angles = np.radians([0, 6]) / 2
    write(tmp_path / 'p.csv', np.stack([np.sin(angles), 0 * angles, 0 * angles, np.cos(angles)]).T)
    assert len(sorted_by('p.csv')['clusters']) == 2
    assert len(sorted_by('p.csv', '--tolerance', 6.1)['clusters']) == 1
