"""Chunks of any size are combined into batches of one size."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.ros.batching import PoseBatches
from resting_aspects_ros.statistics.poses import RestingPoses


def drops(first, end):
    """Return poses that contain their index."""
    index = np.arange(first, end, dtype=float)
    codes = np.zeros(end - first, dtype=np.uint8)
    return RestingPoses(
        first, np.tile(index, (3, 1)).T, np.tile(index, (4, 1)).T, codes, codes, index, index
    )


@given(
    st.integers(1, 7), st.integers(0, 1000), st.lists(st.integers(1, 20), min_size=1, max_size=8)
)
def test_batches_are_full_and_the_last_is_not_empty(size, start, chunks):
    batches, out, first = PoseBatches(size), [], start
    for length in chunks:
        out += batches.add(drops(first, first + length))
        first += length
    out.append(batches.remaining(start))
    assert all(len(batch) == size for batch in out[:-1])
    assert 1 <= len(out[-1]) <= size
    joined = RestingPoses.join(out)
    assert joined.first_drop == start
    assert joined.time_to_rest.tolist() == list(range(start, first))


@pytest.mark.parametrize('length', [1, 249, 250])
def test_full_batch_is_held_back_until_the_next_drop(length):
    batches = PoseBatches(250)
    assert list(batches.add(drops(0, length))) == []
    assert len(batches.remaining(0)) == length


def test_last_batch_is_empty_without_drops():
    rest = PoseBatches(250).remaining(500)
    assert (rest.first_drop, len(rest)) == (500, 0)
