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


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        (['p.csv'], "invalid number of poses 1 in 'p.csv': expected at least 2"),
        (['q.csv'], "pose file 'q.csv' does not exist"),
        (['p.csv', '--tolerance', '0'], 'invalid tolerance 0 degrees: expected 1 to 30 degrees'),
        (['p.csv', '--tolerance', '-3'], 'invalid tolerance -3 degrees: expected 1 to 30 degrees'),
        (['p.csv', '--tolerance', 'wide'], "invalid --tolerance 'wide': expected a number"),
        (['p.csv', '--unit', 'mm'], "invalid --unit 'mm': expected only with --part"),
        (['p.csv', '--parts', '.'], "invalid --parts '.': expected only with --part"),
        (['p.csv', '--part', 'l_bracket', '--unit', 'mm'], "invalid unit 'mm'"),
        (['p.csv', '--part', 'spoon'], "part 'spoon' is not known"),
        (['p.csv', '--part', 'spoon.stl'], "'spoon.stl' does not exist"),
        ([], 'POSES.csv'),
    ],
)
def test_wrong_input_is_refused(refused, tmp_path, words, says):
    write(tmp_path / 'p.csv', np.array([[0, 0, 0, 1.0]]))
    assert says in refused('classify', *words)


def test_wrong_pose_is_refused_with_one_line(refused, tmp_path):
    write(tmp_path / 'p.csv', np.array([[0, 0, 0, 1.0], [0, 0, 0, 0.99]]))
    assert refused('classify', 'p.csv') == (
        "error: invalid qx, qy, qz, qw 0, 0, 0, 0.99 in 'p.csv' line 3: expected a quaternion of "
        'length 1 within 0.001, and its length is 0.99'
    )
