"""Distributions: every drop is counted once, and intervals use all drops."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.statistics.distribution import Distribution, count_poses, no_drops
from resting_aspects_ros.statistics.intervals import METHODS, intervals
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus


@pytest.fixture(scope='module')
def aspects(part):
    return find_aspects(part('l_bracket'))


def distribution(numbers, rest=(0, 0, 0)):
    return Distribution(AspectSet('a', ()), np.array(numbers, dtype=np.int64), *rest)


def poses(orientation, status):
    n = len(status)
    return RestingPoses(
        first_drop=0,
        position=np.zeros((n, 3)),
        orientation=np.asarray(orientation, dtype=np.float64),
        status=np.asarray(status, dtype=np.uint8),
        decided_by=np.zeros(n, dtype=np.uint8),
        time_to_rest=np.ones(n),
        energy_growth=np.arange(n) / 100,
    )


@pytest.mark.parametrize('k', [0, 3, -1])
def test_unknown_aspect_id_is_rejected(k):
    with pytest.raises(InvalidValueError, match=f'invalid aspect {k}: expected 1 to 2'):
        distribution([5, 10]).combined_interval([1, k])


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('confidence', [0.9, 0.99])
def test_every_interval_method_uses_all_drops_as_n(method, confidence):
    counted = distribution([30, 0, 50], (7, 8, 5))
    found = dataclasses.replace(counted, interval=method, confidence=confidence).intervals()
    assert found == intervals([30, 0, 50], 100, method, confidence)
    counted = dataclasses.replace(counted, interval=method, confidence=confidence)
    both = counted.combined_interval([1, 3, 1])
    assert [both] == intervals([80], 100, method, confidence)
    assert [each.probability for each in found] == [0.3, 0.0, 0.5]


@given(st.integers(0, 2**32 - 1), st.integers(0, 300))
def test_each_pose_is_counted_exactly_once(aspects, seed, n):
    generator = np.random.default_rng(seed)
    at_rest = np.array([a.orientation for a in aspects.aspects])
    orientation = np.where(
        generator.random((n, 1)) < 0.7,
        at_rest[generator.integers(5, size=n)],
        random_orientations(generator, n),
    )
    status = generator.choice([0, 0, 0, 1, 2, 3, 4], size=n)
    found = count_poses(aspects, poses(orientation, status))
    ids = aspects.classify(orientation)
    settled = status == RestStatus.SETTLED
    expected = [np.count_nonzero(settled & (ids == i)) for i in range(6)]
    assert found.counts.tolist() == expected[1:]
    assert found.unclassified == expected[0]
    assert found.unsettled == np.count_nonzero(status == 1)
    assert found.failed == np.count_nonzero(status == 2)
    assert found.lost == np.count_nonzero(status == 3)
    assert found.sliding == np.count_nonzero(status == 4)
    assert found.drops == n


def test_all_drops_of_a_part_without_aspects_are_unclassified():
    found = count_poses(AspectSet('a', ()), poses([[0, 0, 0, 1]] * 3, [0, 0, 1]))
    assert (found.counts.tolist(), found.unclassified, found.unsettled) == ([], 2, 1)
    assert found.intervals() == []


def test_distributions_of_different_drops_can_be_added(aspects):
    generator = np.random.default_rng(4)
    all_poses = poses(random_orientations(generator, 500), generator.choice([0, 1, 2], 500))
    whole = count_poses(aspects, all_poses)
    total = count_poses(aspects, all_poses.between(0, 123))
    total = total + count_poses(aspects, all_poses.between(123, 500)) + no_drops(aspects)
    assert total.counts.tolist() == whole.counts.tolist()
    assert (total.unclassified, total.unsettled, total.failed) == (
        whole.unclassified,
        whole.unsettled,
        whole.failed,
    )
    assert total.energy_growth == whole.energy_growth == 4.99


def test_distributions_of_different_parts_cannot_be_added(aspects):
    other = no_drops(AspectSet('another', aspects.aspects))
    with pytest.raises(ValueError, match=r'^distributions of different parts cannot be added$'):
        no_drops(aspects) + other
