"""Index ranges, compared with a set of integers."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.statistics.poses import IndexRanges

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


@given(st.permutations(range(8)), st.integers(0, 2**63))
def test_ranges_in_any_order_merge_to_one(order, start):
    coverage = IndexRanges()
    for piece in order:
        assert coverage.missing(start, start + 80)
        coverage.add(start + 10 * piece, start + 10 * piece + 10)
    assert coverage.missing(start, start + 80) == []
    assert coverage.missing(start, start + 90) == [(start + 80, start + 90)]
    assert len(coverage) == 80


def test_missing_does_not_modify():
    coverage = IndexRanges()
    assert coverage.missing(3, 5) == coverage.missing(3, 5) == [(3, 5)]
    assert len(coverage) == 0
