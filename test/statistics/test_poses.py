"""Resting poses as arrays: cut and joined without loss; which drops are known."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.statistics.poses import IndexRanges, RestingPoses, RestStatus


def numbered(first, n):
    """Poses in which every value tells which drop it is of."""
    index = np.arange(first, first + n)
    return RestingPoses(
        first_drop=first,
        position=index[:, None] + [0.0, 0.1, 0.2],
        orientation=index[:, None] + [0.3, 0.4, 0.5, 0.6],
        status=(index % 3).astype(np.uint8),
        decided_by=(index % 2).astype(np.uint8),
        time_to_rest=index + 0.7,
        energy_growth=index + 0.8,
    )


def test_codes_are_those_of_the_message():
    assert list(RestStatus.__members__) == ['SETTLED', 'UNSETTLED', 'FAILED', 'LOST', 'SLIDING']
    assert [*map(int, RestStatus)] == [0, 1, 2, 3, 4]


@given(st.integers(0, 2**64), st.lists(st.integers(0, 5), min_size=1, max_size=6))
def test_joined_pieces_are_the_whole(assert_same_poses, first, lengths):
    ends = np.cumsum([0, *lengths])
    whole = numbered(0, ends[-1])
    pieces = [
        dataclasses.replace(whole.between(low, high), first_drop=first + int(low))
        for low, high in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
    ]
    joined = RestingPoses.join(pieces)
    assert_same_poses(joined, dataclasses.replace(whole, first_drop=first))
    assert joined.end == first + len(whole)


def test_joining_over_a_gap_names_the_missing_drops():
    with pytest.raises(ValueError, match=r'^drops 5 to 6 are missing$'):
        RestingPoses.join([numbered(0, 5), numbered(7, 2)])


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 12)), max_size=12))
def test_blocks_have_each_drop_once(assert_same_poses, spans):
    blocks = RestingPoses.blocks(numbered(first, n) for first, n in spans)
    found = [drop for block in blocks for drop in range(block.first_drop, block.end)]
    assert found == sorted({drop for first, n in spans for drop in range(first, first + n)})
    for block in blocks:
        assert_same_poses(block, numbered(block.first_drop, len(block)))
    # Drops are missing between two blocks.
    assert all(a.end < b.first_drop for a, b in pairwise(blocks))


ranges = st.tuples(st.integers(0, 40), st.integers(0, 40))


def members(pieces):
    return [index for first, end in pieces for index in range(first, end)]


@given(st.lists(ranges, max_size=12), ranges)
def test_ranges_agree_with_a_set(added, asked):
    coverage, model = IndexRanges(), set()
    for first, end in added:
        new = coverage.add(first, end)
        # Each index that was not there before, once, in order, in ranges that are not empty.
        assert members(new) == sorted(set(range(first, end)) - model)
        assert all(low < high for low, high in new)
        model |= set(range(first, end))
        assert len(coverage) == len(model)
        assert coverage.end == max(model, default=-1) + 1
    missing = coverage.missing(*asked)
    assert members(missing) == sorted(set(range(*asked)) - model)
    # As few ranges as there can be: none touches the next.
    assert all(a[1] < b[0] for a, b in pairwise(missing))
