"""Estimates, comparisons and classifications of the Python interface."""

import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.statistics.poses import RestStatus


@pytest.fixture(scope='module')
def dropped(workers):
    """Drops of a part in two runs."""
    return [ra.drop('hex_nut', drops=300, seed=seed, workers=workers) for seed in (1, 2)]


@pytest.fixture
def printed(tmp_path):
    """Return the document that a command prints."""

    def document(*words):
        command = [sys.executable, '-m', 'resting_aspects_ros.cli', *words, '--json']
        return json.loads(
            subprocess.run(
                command, capture_output=True, text=True, check=True, cwd=tmp_path
            ).stdout
        )

    return document


@pytest.fixture
def box(tmp_path):
    """A box of 10 x 20 x 30 mm."""
    path = tmp_path / 'box.stl'
    trimesh.creation.box((10, 20, 30)).export(path)
    return path


def test_estimate_has_a_result_for_each_method(box):
    result = ra.estimate(box)
    assert list(result.estimates) == [
        'solid_angle', 'csa', 'crsa', 'stability', 'energy_barrier', 'quasi_static', 'rolling',
    ]  # fmt: skip
    # Two faces of each size: stability is face area / half the box's height on it.
    areas_over_heights = np.repeat([30 * 20 / 5, 30 * 10 / 10, 20 * 10 / 15], 2)
    expected = areas_over_heights / areas_over_heights.sum()
    assert result.estimates['stability'].probabilities == pytest.approx(expected)


@pytest.mark.slow
def test_estimate_prints_the_same_document(box, printed, dropped, tmp_path):
    assert json.loads(ra.estimate(box, ['csa']).to_json()) == printed(
        'estimate', 'box.stl', '--method', 'csa'
    )
    dropped[0].save_json(tmp_path / 'nut.json')
    found = json.loads(ra.estimate('hex_nut', against=tmp_path / 'nut.json').to_json())
    expected = printed('estimate', 'hex_nut', '--against', str(tmp_path / 'nut.json'))
    assert found == expected
    assert found['against']['drops'] == 300


def test_estimate_takes_a_result_or_its_file(dropped, tmp_path):
    dropped[0].save_json(tmp_path / 'nut.json')
    from_file = ra.estimate('hex_nut', ['csa'], against=tmp_path / 'nut.json')
    from_result = ra.estimate('hex_nut', ['csa'], against=dropped[0])
    np.testing.assert_array_equal(from_result.against.tally.counts, dropped[0].distribution.counts)
    one, other = (each.comparisons(by_class=True)['csa'] for each in (from_result, from_file))
    assert one.p_value == other.p_value


def test_wrong_arguments_of_estimate_are_named(box, dropped, tmp_path):
    with pytest.raises(ra.InvalidValueError, match='guess'):
        ra.estimate(box, ['guess'])
    dropped[0].save_json(tmp_path / 'nut.json')
    with pytest.raises(ra.InvalidValueError, match='different parts'):
        ra.estimate(box, against=tmp_path / 'nut.json')
    with pytest.raises(ra.NotDefinedError, match='not defined for'):
        ra.estimate('cylinder_d20_h20', ['stability'])


def test_runs_of_the_same_part_agree(dropped):
    result = ra.compare(*dropped)
    a, b = (each.distribution.counts / each.distribution.counts.sum() for each in dropped)
    assert result.comparison.deviation == pytest.approx(a - b)
    assert result.comparison.p_value > 0.001
    assert 'do not differ significantly' in result.verdict


def test_compare_prints_the_same_document(dropped, printed, tmp_path):
    for name, each in zip('ab', dropped, strict=True):
        each.save_json(tmp_path / f'{name}.json')
    found = ra.compare(tmp_path / 'a.json', tmp_path / 'b.json', confidence=0.99)
    expected = printed(
        'compare', str(tmp_path / 'a.json'), str(tmp_path / 'b.json'), '--confidence', '0.99'
    )
    assert json.loads(found.to_json()) == expected
    # A result instead of its file differs by its name only.
    document = json.loads(ra.compare(dropped[0], tmp_path / 'b.json', confidence=0.99).to_json())
    assert document['a'].pop('file') == f'run {dropped[0].run.run_id}'
    del expected['a']['file']
    assert document == expected


def test_a_result_is_compared_with_a_count_by_class(dropped, tmp_path):
    classes = dropped[0].distribution.by_class().counts
    lines = [f'{k},{count}' for k, count in enumerate(classes.tolist(), start=1)]
    (tmp_path / 'hand.csv').write_text('\n'.join(['class,count', *lines]), encoding='utf-8')
    result = ra.compare(dropped[0], tmp_path / 'hand.csv')
    assert result.sides.what == 'class'
    assert result.comparison.total_variation == 0


def test_what_cannot_be_compared_is_refused(dropped, workers):
    other = ra.drop('tetrahedron', drops=30, workers=workers)
    with pytest.raises(ra.InvalidValueError, match='different parts'):
        ra.compare(dropped[0], other)
    with pytest.warns(ra.RestingAspectsWarning, match='300 drops of A and B are the same'):
        ra.compare(dropped[0], dropped[0])


def test_poses_are_sorted_into_aspects(dropped):
    poses = dropped[0].poses
    result = ra.classify(poses, 'hex_nut')
    settled = poses.status == RestStatus.SETTLED
    expected = ra.find_aspects(ra.load_part('hex_nut')).classify(poses.orientation[settled])
    assert np.array_equal(result.aspect, expected)
    assert result.by_part.distribution.drops == 300
    # Quaternions alone give the same result.
    again = ra.classify(poses.orientation[settled], 'hex_nut')
    assert np.array_equal(again.aspect, expected)
    assert np.array_equal(again.clusters.labels, result.clusters.labels)


@pytest.mark.slow
def test_classify_prints_the_same_document(dropped, printed, tmp_path):
    poses = dropped[0].poses
    rows = ['qx,qy,qz,qw', *(','.join(map(repr, row)) for row in poses.orientation.tolist())]
    (tmp_path / 'poses.csv').write_text('\n'.join(rows), encoding='utf-8')
    found = ra.classify(tmp_path / 'poses.csv', 'hex_nut', tolerance=4)
    expected = printed('classify', 'poses.csv', '--part', 'hex_nut', '--tolerance', '4')
    assert json.loads(found.to_json()) == expected
    clusters = json.loads(ra.classify(tmp_path / 'poses.csv').to_json())['clusters']
    assert clusters == printed('classify', 'poses.csv')['clusters']


@pytest.mark.parametrize(
    ('poses', 'words'),
    [
        (np.ones((2, 3)), r'invalid shape \(2, 3\)'),
        ([[0, 0, 0, 1.0], [0, 0, 0, 2.0]], 'of pose 1: expected a quaternion of length 1'),
        ([[0, 0, 0, 1.0], [0, 0, np.nan, 1.0]], 'of pose 1: expected a quaternion'),
        ([[0, 0, 0, 1.0]], 'invalid number of settled poses 1: expected at least 2'),
    ],
    ids=['shape', 'length', 'nan', 'too few'],
)
def test_wrong_poses_are_named(poses, words):
    with pytest.raises(ra.InvalidValueError, match=words):
        ra.classify(poses)


def test_poses_without_a_part_have_no_aspects(dropped):
    with pytest.raises(ra.InvalidValueError, match='expected a part'):
        ra.classify(dropped[0].poses).aspect  # noqa: B018


def test_poses_of_another_part_are_pointed_out(dropped):
    with pytest.warns(ra.RestingAspectsWarning, match="are in no aspect of 'tetrahedron'"):
        ra.classify(dropped[0].poses, 'tetrahedron')
