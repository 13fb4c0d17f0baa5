"""Drops by aspect, over time and by contacts: every drop is counted once."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import ContactFinder, ContactPlane
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.statistics import distribution as counting
from resting_aspects_ros.statistics.distribution import (
    OUTSIDE,
    ContactCounts,
    Distribution,
    History,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import METHODS, intervals
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus


@pytest.fixture(scope='module')
def aspects(part):
    return find_aspects(part('l_bracket'))


def drawn_orientations(aspects, generator, n):
    """Return orientations (n, 4), most of them in an aspect."""
    at_rest = np.array([a.orientation for a in aspects])[generator.integers(5, size=n)]
    others = random_orientations(generator, n)
    return np.where(generator.random((n, 1)) < 0.7, at_rest, others)


def poses_with(orientation, status):
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


@pytest.mark.parametrize('method', METHODS)
def test_every_interval_method_uses_all_drops_as_n(method):
    counts = np.array([30, 0, 50])
    counted = Distribution(AspectSet('a', ()), counts, 7, 8, 5, interval=method, confidence=0.9)
    assert counted.intervals() == intervals([30, 0, 50], 100, method, 0.9)
    assert [counted.combined_interval([1, 3, 1])] == intervals([80], 100, method, 0.9)
    with pytest.raises(InvalidValueError, match='invalid aspect 4: expected 1 to 3'):
        counted.combined_interval([1, 4])


@given(st.integers(0, 2**32 - 1), st.integers(0, 300))
def test_each_pose_is_counted_exactly_once(aspects, seed, n):
    generator = np.random.default_rng(seed)
    orientation = drawn_orientations(aspects, generator, n)
    status = generator.choice([0, 0, 0, 1, 2, 3, 4], size=n)
    found = count_poses(aspects, poses_with(orientation, status))
    ids = aspects.classify(orientation)
    settled = status == RestStatus.SETTLED
    expected = [np.count_nonzero(settled & (ids == i)) for i in range(6)]
    assert [found.unclassified, *found.counts] == expected
    failures = [found.unsettled, found.failed, found.lost, found.sliding]
    assert failures == [np.count_nonzero(status == code) for code in (1, 2, 3, 4)]
    assert found.drops == n


def test_distributions_of_different_drops_can_be_added(aspects):
    generator = np.random.default_rng(4)
    drops = poses_with(random_orientations(generator, 500), generator.choice(5, 500))
    whole = count_poses(aspects, drops)
    total = count_poses(aspects, drops.between(0, 123))
    total = total + count_poses(aspects, drops.between(123, 500))
    assert total.counts.tolist() == whole.counts.tolist()
    for name in (*OUTSIDE, 'energy_growth'):
        assert getattr(total, name) == getattr(whole, name)
    other = no_drops(AspectSet('another', tuple(aspects)))
    with pytest.raises(ValueError, match=r'^distributions of different parts cannot be added$'):
        total + other


@pytest.fixture(scope='module')
def poses(aspects):
    rng = np.random.default_rng(5)
    orientation, status = drawn_orientations(aspects, rng, 3000), rng.random(3000) < 0.03
    status, orientation[7] = status.astype(np.uint8), np.nan
    status[7] = RestStatus.FAILED
    return poses_with(orientation, status)


@given(cuts=st.lists(st.integers(0, 3000), max_size=12), end=st.integers(1, 3000))
def test_counts_are_those_of_the_first_drops(aspects, poses, cuts, end):
    history = History(aspects)
    bounds = sorted({0, end, *(cut for cut in cuts if cut < end)})
    for first, last in pairwise(bounds):
        history.add(aspect_ids(aspects, poses.between(first, last)))
    drops, counts = history.points()
    assert drops[-1] == end
    assert (np.diff(drops) > 0).all()
    for n, row in zip(drops, counts, strict=True):
        np.testing.assert_array_equal(row, count_poses(aspects, poses.between(0, n)).counts)


PLANES = [
    ContactPlane('floor', np.array([0.0, 0.0, 1.0])),
    ContactPlane('wall', np.array([0.0, 1.0, 0.0])),
]


@pytest.fixture(scope='module')
def block(solid, solids):
    part = solid(solids.box(10, 20, 30))
    return part, find_aspects(part)


def no_counts(block):
    part, aspects = block
    return ContactCounts(ContactFinder(part, aspects, PLANES), aspects)


def touching(block, turns, status=RestStatus.SETTLED):
    """Poses in which the part touches floor and wall."""
    part, _ = block
    position = np.zeros((len(turns), 3))
    for plane in PLANES:
        reach = [(t.apply(np.array(part.hull_vertices)) @ plane.normal).min() for t in turns]
        position -= np.array(reach)[:, None] * plane.normal
    given = poses_with(turns.as_quat(canonical=True), np.full(len(turns), status))
    return dataclasses.replace(given, position=position)


def add(counted, given):
    counted.add(given, np.zeros(len(given), dtype=np.int64))
    return counted


def test_each_of_24_poses_of_a_block_is_counted_by_its_pair_of_sides(block):
    counted = add(no_counts(block), touching(block, Rotation.create_group('O')))
    assert [p.count for p in counted.placements] == [1] * 24
    # 24 pairs of adjacent sides, of which the 4 rotations of the block map 4 to each other.
    classes = [p.symmetry_class for p in counted.placements]
    assert sorted(np.bincount(classes)[1:].tolist()) == [4] * 6


@pytest.mark.parametrize('most', [200, 7])
def test_placements_and_their_classes_do_not_depend_on_the_chunks(block, most, monkeypatch):
    monkeypatch.setattr(counting, 'MAX_PLACEMENTS', most)
    group = Rotation.create_group('O')
    leaning = group * Rotation.from_euler('xyz', [20, 30, 40], degrees=True)
    both = Rotation.concatenate([group, leaning])
    turns = both[np.random.default_rng(3).integers(0, len(both), 80)]
    found = []
    for size in (80, 7):
        counted = no_counts(block)
        for k in range(0, 80, size):
            before = [p.contacts for p in counted.placements]
            add(counted, touching(block, turns[k : k + size]))
            # The first drops keep the order of their placements.
            assert [p.contacts for p in counted.placements][: len(before)] == before
        found.append(
            [(p.contacts, p.count, p.symmetry_class, *p.orientation) for p in counted.placements]
        )
        found[-1].append(counted.uncounted)
    assert found[0] == found[1]


def test_leaning_parts_are_told_apart_by_their_orientation(block):
    """Turned by 20 and by 70 degrees, the block leans at the wall with different sides up."""
    turns = Rotation.from_euler('z', np.array([[20, 21, 70, 200, 250]]).T, degrees=True)
    counted = add(no_counts(block), touching(block, turns))
    # 200 is 20 turned by half a turn, which maps the block onto itself; 250 is 70.
    assert sorted(p.count for p in counted.placements) == [2, 3]


def test_a_leaning_pin_is_one_placement_however_it_is_rolled(solid, solids):
    pin = solid(solids.prism(60, 4.0, 16.0))
    given = pin, find_aspects(pin)
    rolls = Rotation.from_euler('z', np.linspace(0, 300, 7)[:, None], degrees=True)
    leaning = Rotation.from_euler('x', 40, degrees=True)
    counted = add(no_counts(given), touching(given, leaning * rolls))
    assert [p.count for p in counted.placements] == [7]


def test_rows_are_sorted_by_count_with_the_shares_of_all_drops(block):
    group = Rotation.create_group('O')
    counted = add(no_counts(block), touching(block, group[np.array([0, 1, 1, 1, 2, 2])]))
    add(counted, touching(block, group[:4], status=RestStatus.LOST))
    rows = counted.sorted_rows('wilson', 0.95)
    assert [placement.count for placement, _ in rows] == [3, 2, 1]
    assert [interval.probability for _, interval in rows] == pytest.approx([0.3, 0.2, 0.1])
