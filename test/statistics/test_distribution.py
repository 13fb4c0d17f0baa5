"""Distributions: every drop counted once, and Wilson's interval as in his paper."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, norm

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.statistics.distribution import Distribution, count_poses, no_drops
from resting_aspects_ros.statistics.intervals import CONFIDENCE, METHODS, intervals
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

counts = st.lists(st.integers(0, 10**6), min_size=1, max_size=6)
rests = st.tuples(*[st.integers(0, 1000)] * 3)


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


def wilson(count, n):
    """Return both bounds of Wilson 1927: the solutions of (p - count/n)^2 = z^2 p (1 - p) / n."""
    z = norm.ppf(0.5 + CONFIDENCE / 2)
    p = count / n
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return middle - half, middle + half


@given(counts, rests)
def test_probability_is_count_over_all_drops_with_wilsons_interval(numbers, rest):
    found = distribution(numbers, rest)
    drops = sum(numbers) + sum(rest)
    assert found.drops == drops
    intervals = found.intervals()
    assert len(intervals) == len(numbers)
    for count, each in zip(numbers, intervals, strict=True):
        if drops:
            assert each.probability == count / drops
            assert (each.lower, each.upper) == pytest.approx(wilson(count, drops), abs=1e-12)
        assert 0 <= each.lower <= each.probability <= each.upper <= 1


@given(st.data())
def test_together_counts_several_aspects_as_one(data):
    numbers = data.draw(counts)
    ids = data.draw(st.lists(st.integers(1, len(numbers))))
    found = distribution(numbers, (1, 2, 3))
    count = sum(numbers[k - 1] for k in set(ids))
    share = found.combined_interval(ids)
    assert share.probability == count / found.drops
    assert (share.lower, share.upper) == pytest.approx(wilson(count, found.drops), abs=1e-12)


def test_together_of_one_aspect_is_its_own_interval():
    for by_precision in (False, True):
        found = dataclasses.replace(distribution([5, 10]), by_precision=by_precision)
        assert [found.combined_interval([k]) for k in (1, 2)] == found.intervals()


@pytest.mark.parametrize('k', [0, 3, -1])
def test_unknown_aspect_id_is_rejected(k):
    with pytest.raises(InvalidValueError, match=f'invalid aspect {k}: expected 1 to 2'):
        distribution([5, 10]).combined_interval([1, k])


def test_textbook_interval():
    # 81 of 263: Newcombe 1998, table I.
    (each,) = distribution([81], (182, 0, 0)).intervals()
    assert (each.lower, each.upper) == pytest.approx((0.2553, 0.3662), abs=5e-5)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('confidence', [0.9, 0.99])
def test_every_interval_method_uses_all_drops_as_n(method, confidence):
    counted = distribution([30, 0, 50], (7, 8, 5))
    found = dataclasses.replace(counted, interval=method, confidence=confidence).intervals()
    assert found == intervals([30, 0, 50], 100, method, confidence)
    assert [each.probability for each in found] == [0.3, 0.0, 0.5]


def test_without_drops_intervals_are_zero_to_one(aspects):
    nothing = no_drops(aspects)
    assert nothing.drops == 0
    assert [(i.probability, i.lower, i.upper) for i in nothing.intervals()] == [(0, 0, 1)] * 5


def test_bounds_of_aspects_seen_never_or_always(aspects):
    never, always = distribution([0, 1000]).intervals()
    z = norm.ppf(0.975)
    assert (never.lower, always.upper) == (0, 1)
    assert never.upper == pytest.approx(z**2 / (1000 + z**2))
    assert always.lower == pytest.approx(1000 / (1000 + z**2))


@pytest.mark.parametrize('p', [0.01, 0.25, 0.5, 0.9])
@pytest.mark.parametrize('n', [100, 1000])
def test_interval_has_about_its_nominal_coverage(n, p):
    # The coverage is computed exactly, over all counts. Counts are integers: it oscillates about
    # the nominal 0.95, by less than 0.05 where n p is 1 or more.
    k = np.arange(n + 1)
    covered = [low <= p <= high for low, high in (wilson(count, n) for count in k)]
    ours = [distribution([c, n - c]).intervals()[0] for c in k]
    assert [i.lower <= p <= i.upper for i in ours] == covered
    assert 0.9 < binom.pmf(k, n, p)[covered].sum() < 0.99


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


def test_unsettled_drop_is_in_no_aspect_even_if_its_pose_fits(aspects):
    show = aspects.aspects[0].orientation
    found = count_poses(aspects, poses([show] * 4, [0, 1, 2, 1]))
    assert found.counts.tolist() == [1, 0, 0, 0, 0]
    assert (found.unclassified, found.unsettled, found.failed, found.drops) == (0, 2, 1, 4)


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
