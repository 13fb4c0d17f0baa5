"""`classify` on poses of `drop`, on other poses, and on wrong input."""

import csv
import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.loading import load_part
from resting_aspects_ros.rotations import down_in_part

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


def quaternions(path):
    with path.open(newline='', encoding='utf-8') as file:
        return np.array([[float(row[name]) for name in ROTATION] for row in csv.DictReader(file)])


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


def test_classifiers_agree_within_a_degree(dropped, sorted_by):
    path, _ = dropped
    found = sorted_by(path, '--part', 'l_bracket')
    assert found['agreed'] + len(found['differing']) == DROPS
    assert all(pose['angle'] > np.radians(1) for pose in found['differing'])
    clusters = {cluster['id']: cluster for cluster in found['clusters']}
    for aspect in found['aspects']:
        cluster = clusters[aspect['cluster']]
        assert aspect['count'] == aspect['count_in_cluster'] == cluster['count']
        # The collision margin of Bullet lets a part tilt by less than this.
        np.testing.assert_allclose(
            cluster['down_in_part'], aspect['down_in_part'], atol=np.radians(0.1)
        )
        assert cluster['spread'] < np.radians(0.1)


def test_clusters_are_equal_with_and_without_part(dropped, sorted_by):
    path, _ = dropped
    with_part, without = sorted_by(path, '--part', 'l_bracket'), sorted_by(path)
    assert without.keys() < with_part.keys()
    assert without == {name: with_part[name] for name in without}
    counts = [cluster['count'] for cluster in without['clusters']]
    assert sum(counts) == DROPS
    assert counts == sorted(counts, reverse=True)
    for cluster in without['clusters']:
        assert cluster['probability'] == cluster['count'] / DROPS
        assert 0 <= cluster['lower'] < cluster['probability'] < cluster['upper'] <= 1


def test_order_of_lines_and_columns_is_arbitrary(dropped, sorted_by, tmp_path):
    poses = quaternions(dropped[0])
    write(tmp_path / 'a.csv', poses)
    write(tmp_path / 'b.csv', poses[::-1], 'qz,qx,qw,qy')
    assert sorted_by('a.csv') == sorted_by('b.csv')


def test_differing_poses_are_listed(dropped, run, sorted_by, tmp_path):
    poses = quaternions(dropped[0])[:10]
    # Gravity between +x and +z points to no facet.
    poses[4] = [0, np.sin(np.pi / 8), 0, np.cos(np.pi / 8)]
    assert down_in_part(poses[4]) == pytest.approx([np.sqrt(0.5), 0, -np.sqrt(0.5)])
    write(tmp_path / 'p.csv', poses)
    (pose,) = sorted_by('p.csv', '--part', 'l_bracket')['differing']
    assert (pose['pose'], pose['line'], pose['aspect']) == (4, 6, 0)
    assert pose['angle'] == pytest.approx(np.pi / 4, abs=1e-3)

    ended = run('classify', 'p.csv', '--part', 'l_bracket')
    assert (ended.returncode, ended.stderr) == (0, '')
    lines = ended.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].rstrip() == 'p.csv, 10 poses of l_bracket'
    text = ' '.join(ended.stdout.split())
    assert (
        'Aspects and clusters agree on 9 of 10 settled poses, including all poses within 1 degree '
        'of an aspect. Differing poses (1):'
    ) in text
    near, cluster = pose['nearest_aspect'], pose['cluster']
    assert lines[-1].split() == ['4', '6', str(near), '45.00', 'none', str(cluster), '1']


def test_table_shows_twenty_differing_poses_document_all(run, sorted_by, tmp_path):
    # Random orientations, on the edges and corners of a box, too.
    poses = np.random.default_rng(8).standard_normal((60, 4))
    write(tmp_path / 'p.csv', poses / np.linalg.norm(poses, axis=1, keepdims=True))
    words = ('p.csv', '--part', 'box_10x20x30')
    ended = run('classify', *words)
    (line,) = [line for line in ended.stdout.splitlines() if line.startswith('Differing')]
    title = r'Differing poses \(20 of (\d+), --json lists all\): *'
    count = int(re.fullmatch(title, line)[1])
    assert len(re.findall(r'^ *\d+ +\d+ +\d +\d+\.\d\d +', ended.stdout, re.MULTILINE)) == 20
    document = json.loads(run('classify', *words, '--json').stdout)
    assert len(document['differing']) == count > 20
    assert document['agreed'] == 60 - count


def test_pose_file_of_another_part_warns(dropped, run):
    path, _ = dropped
    ended = run('classify', path, '--part', 'tetrahedron', '--json')
    assert ended.returncode == 0
    assert json.loads(ended.stdout)['unclassified'] == DROPS
    assert ended.stderr == (
        f'warning: {DROPS} of {DROPS} settled poses in {str(path)!r} are in no aspect of '
        "'tetrahedron': is this the pose file of another part, or in another unit or frame?\n"
    )


def test_inverse_rotations_are_recognised(run, part, tmp_path):
    flat = np.array([a.orientation for a in find_aspects(part('tetrahedron')).aspects])
    yaw = Rotation.from_rotvec(np.linspace(-3, 3, 25)[:, None] * [0, 0, 1])
    poses = Rotation.concatenate([turn * Rotation.from_quat(flat) for turn in yaw])
    write(tmp_path / 'p.csv', poses.inv().as_quat())
    ended = run('classify', 'p.csv', '--part', 'tetrahedron')
    assert ended.returncode == 0
    assert re.fullmatch(
        r"warning: \d+ of 100 settled poses in 'p.csv' are in no aspect of 'tetrahedron': the "
        r'inverse rotations fit, so they may be part from world\n',
        ended.stderr,
    )


def test_a_table_of_clusters(run, tmp_path):
    # The ring of a part that rolls about its x axis, and one of its ends.
    angles = np.radians(np.arange(0, 360, 4.5) / 2)
    ring = np.stack([np.sin(angles), 0 * angles, 0 * angles, np.cos(angles)], axis=1)
    end = np.tile([0, np.sqrt(0.5), 0, np.sqrt(0.5)], (20, 1))
    write(tmp_path / 'p.csv', np.concatenate([end, ring]))
    ended = run('classify', 'p.csv')
    assert (ended.returncode, ended.stderr) == (0, '')
    title, _, _, _, first, second, *_, last = ended.stdout.splitlines()
    assert title.rstrip() == 'p.csv, 100 poses, 2 clusters'
    assert re.fullmatch(r' +1  all round +-  +80 % +71 to 87 % +80', first)
    assert re.fullmatch(r' +2  \+1.00  0.00  0.00 +0.00  +20 % +13 to 29 % +20', second)
    assert last.split() == ['poses', 'in', 'total', '100']


def test_tolerance_changes_the_clusters(sorted_by, tmp_path):
    angles = np.radians([0, 6]) / 2
    write(tmp_path / 'p.csv', np.stack([np.sin(angles), 0 * angles, 0 * angles, np.cos(angles)]).T)
    assert len(sorted_by('p.csv')['clusters']) == 2
    assert len(sorted_by('p.csv', '--tolerance', 6.1)['clusters']) == 1


def test_unsettled_poses_are_counted_but_not_classified(sorted_by, run, tmp_path):
    rows = ['qx,qy,qz,qw,status', '0,0,0,1,SETTLED', '0,0,0,1,SETTLED']
    rows += ['0,1,0,0,UNSETTLED', 'nan,nan,nan,nan,FAILED']
    (tmp_path / 'p.csv').write_text('\n'.join(rows), encoding='utf-8')
    for part in ([], ['--part', 'box_10x20x30']):
        found = sorted_by('p.csv', *part)
        assert [found[name] for name in ('drops', 'unsettled', 'failed')] == [4, 1, 1]
        assert [cluster['probability'] for cluster in found['clusters']] == [0.5]
        shown = run('classify', 'p.csv', *part).stdout
        assert re.search(r'^ +unsettled +25 % ', shown, re.MULTILINE)
        assert re.search(r'^ +failed +25 % ', shown, re.MULTILINE)


def test_a_mesh_file_with_its_unit(sorted_by, box, tmp_path):
    box.export(tmp_path / 'box.stl')
    aspects = find_aspects(load_part(tmp_path / 'box.stl', unit='cm')).aspects
    write(tmp_path / 'p.csv', np.array([aspects[2].orientation]))  # one pose is enough with a part
    found = sorted_by('p.csv', '--part', 'box.stl', '--unit', 'cm')
    assert [aspect['count'] for aspect in found['aspects']] == [0, 0, 1, 0, 0, 0]
    assert [aspect['com_height'] for aspect in found['aspects']] == pytest.approx(
        [0.05, 0.05, 0.1, 0.1, 0.15, 0.15]
    )


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
