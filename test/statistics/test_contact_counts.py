"""Counts by contacts: known poses, folding by symmetry, and the order of the drops."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import ContactFinder, ContactPlane
from resting_aspects_ros.statistics.distribution import ContactCounts
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus

PLANES = [
    ContactPlane('floor', np.array([0.0, 0.0, 1.0])),
    ContactPlane('wall', np.array([0.0, 1.0, 0.0])),
]


@pytest.fixture(scope='module')
def block(solid, solids):
    part = solid(solids.box(10, 20, 30))
    return part, find_aspects(part)


def counts(block):
    part, aspects = block
    return ContactCounts(ContactFinder(part, aspects, PLANES), aspects)


def poses(block, turns, first=0, status=RestStatus.SETTLED):
    """Poses in which the part touches floor and wall."""
    part, _ = block
    n = len(turns)
    position = np.zeros((n, 3))
    for plane in PLANES:
        reach = np.array(
            [(t.apply(np.array(part.hull_vertices)) @ plane.normal).min() for t in turns]
        )
        position -= reach[:, None] * plane.normal
    return RestingPoses(
        first_drop=first,
        position=position,
        orientation=turns.as_quat(canonical=True),
        status=np.full(n, status, dtype=np.uint8),
        decided_by=np.full(n, DecidedBy.STILLNESS, dtype=np.uint8),
        time_to_rest=np.zeros(n),
        energy_growth=np.zeros(n),
    )


def add(counted, given):
    counted.add(given, np.zeros(len(given), dtype=np.int64))
    return counted


def table(counted):
    return {p.contacts: p.count for p in counted.placements}


def test_each_of_24_poses_of_a_block_is_counted_by_its_pair_of_sides(block):
    counted = add(counts(block), poses(block, Rotation.create_group('O')))
    assert sorted(table(counted).values()) == [1] * 24
    # 24 pairs of adjacent sides, of which the 4 rotations of the block map 4 to each other.
    classes = [p.symmetry_class for p in counted.placements]
    assert sorted(np.bincount(classes)[1:].tolist()) == [4] * 6


def test_counts_do_not_depend_on_the_order_or_the_chunks(block):
    group = Rotation.create_group('O')
    draws = np.random.default_rng(1).integers(0, len(group), 200)
    whole = add(counts(block), poses(block, group[draws]))
    pieces = counts(block)
    for k in range(0, 200, 37):
        add(pieces, poses(block, group[draws[::-1][k : k + 37]], first=k))
    assert table(whole) == table(pieces)
    assert whole.drops == pieces.drops == 200
    assert sum(table(whole).values()) == 200


def test_first_drops_keep_the_order_of_their_placements(block):
    group = Rotation.create_group('O') * Rotation.from_euler('z', 20, degrees=True)
    draws = np.random.default_rng(2).integers(0, len(group), 60)
    few = add(counts(block), poses(block, group[draws[:20]]))
    more = add(
        add(counts(block), poses(block, group[draws[:20]])), poses(block, group[draws[20:]])
    )
    first = [p.contacts for p in few.placements]
    assert [p.contacts for p in more.placements][: len(first)] == first


def test_leaning_parts_are_told_apart_by_their_orientation(block):
    """Turned by 20 and by 70 degrees, the block leans at the wall with different sides up."""
    turns = Rotation.from_euler('z', np.array([[20, 21, 70, 200, 250]]).T, degrees=True)
    counted = add(counts(block), poses(block, turns))
    # 200 is 20 turned by half a turn, which maps the block onto itself; 250 is 70.
    assert sorted(p.count for p in counted.placements) == [2, 3]


def test_parts_that_are_not_at_rest_are_drops_without_placement(block):
    given = poses(block, Rotation.create_group('O'), status=RestStatus.SLIDING)
    counted = add(counts(block), given)
    assert (counted.drops, counted.placements) == (24, [])


def test_rows_are_sorted_by_count_with_the_shares_of_all_drops(block):
    group = Rotation.create_group('O')
    counted = add(counts(block), poses(block, group[np.array([0, 1, 1, 1, 2, 2])]))
    add(counted, poses(block, group[:4], status=RestStatus.LOST))
    rows = counted.sorted_rows('wilson', 0.95)
    assert [placement.count for placement, _ in rows] == [3, 2, 1]
    assert [interval.probability for _, interval in rows] == pytest.approx([0.3, 0.2, 0.1])
    assert set(counted.named(rows[0][0])) == {'floor', 'wall'}
