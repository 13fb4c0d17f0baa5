"""Estimates, comparisons and classifications of the Python interface."""

import json

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.statistics.poses import RestStatus


@pytest.fixture(scope='module')
def dropped(workers):
    """Drops of a part in two runs."""
    options = {'drops': 300, 'model_range': False, 'workers': workers}
    return [ra.drop('hex_nut', seed=seed, **options) for seed in (1, 2)]


def test_wrong_arguments_of_estimate_are_named(dropped):
    with pytest.raises(ra.InvalidValueError, match='guess'):
        ra.estimate('box_10x20x30', ['guess'])
    with pytest.raises(ra.InvalidValueError, match='different parts'):
        ra.estimate('box_10x20x30', ['csa'], against=dropped[0])
    with pytest.raises(ra.NotDefinedError, match='not defined for'):
        ra.estimate('cylinder_d20_h20', ['stability'])


def test_runs_of_the_same_part_and_their_files_agree(dropped, tmp_path):
    for name, each in zip('ab', dropped, strict=True):
        each.save_json(tmp_path / f'{name}.json')
    files = ra.compare(tmp_path / 'a.json', tmp_path / 'b.json', confidence=0.99)
    result = ra.compare(dropped[0], tmp_path / 'b.json', confidence=0.99)
    a, b = (each.distribution.counts / each.distribution.counts.sum() for each in dropped)
    assert result.comparison.deviation == pytest.approx(a - b)
    assert result.comparison.p_value > 0.001
    assert 'do not differ significantly' in result.verdict
    expected, document = (json.loads(each.to_json()) for each in (files, result))
    assert document['a'].pop('file') == f'run {dropped[0].run.run_id}'
    del expected['a']['file']
    assert document == expected


def test_what_cannot_be_compared_is_refused(dropped, workers):
    other = ra.drop('tetrahedron', drops=30, model_range=False, workers=workers)
    with pytest.raises(ra.InvalidValueError, match='different parts'):
        ra.compare(dropped[0], other)
    with pytest.raises(ra.InvalidValueError, match='expected a result of drop, or a file'):
        ra.compare(dropped[0].part, other)
    with pytest.warns(ra.RestingAspectsWarning, match='300 drops of A and B start from'):
        ra.compare(dropped[0], dropped[0])


@pytest.mark.slow
def test_poses_are_sorted_into_aspects(dropped):
    poses = dropped[0].poses
    result = ra.classify(poses, 'hex_nut')
    settled = poses.status == RestStatus.SETTLED
    expected = ra.find_aspects(ra.load_part('hex_nut')).classify(poses.orientation[settled])
    assert np.array_equal(result.aspect, expected)
    assert result.by_part.distribution.drops == 300
    alone = ra.classify(poses.orientation[settled])
    assert np.array_equal(alone.clusters.labels, result.clusters.labels)
    with pytest.raises(ra.InvalidValueError, match='expected a part'):
        alone.aspect  # noqa: B018
    with pytest.warns(ra.RestingAspectsWarning, match="are in no aspect of 'tetrahedron'"):
        ra.classify(poses, 'tetrahedron')


@pytest.mark.parametrize(
    ('poses', 'words'),
    [
        (np.ones((2, 3)), r'invalid shape \(2, 3\)'),
        ([[0, 0, 0, 1.0], [0, 0, 0, 2.0]], 'pose 1: expected a quaternion of length 1'),
        ([[0, 0, 0, 1.0]], 'invalid number of settled poses 1 in the array: expected at least 2'),
    ],
)
def test_wrong_poses_are_named(poses, words):
    with pytest.raises(ra.InvalidValueError, match=words):
        ra.classify(poses)
