"""A history is the counts of the first drops, independent of the batches they come in."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.statistics.distribution import (
    FIRST_SAMPLE,
    History,
    aspect_ids,
    count_poses,
)
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus


@pytest.fixture(scope='module')
def aspects(part):
    return find_aspects(part('l_bracket'))


@pytest.fixture(scope='module')
def poses(aspects):
    rng = np.random.default_rng(5)
    shown = np.array([each.orientation for each in aspects.aspects])
    orientation = shown[rng.integers(0, 5, 3000)]
    lost = rng.random(3000) < 0.05
    orientation[lost] = random_orientations(rng, int(lost.sum()))
    codes = np.zeros(3000, dtype=np.uint8)
    status = (rng.random(3000) < 0.03).astype(np.uint8)
    status[7], orientation[7] = RestStatus.FAILED, np.nan
    zero = np.zeros(3000)
    return RestingPoses(0, np.zeros((3000, 3)), orientation, status, codes, zero, zero)


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


def test_ten_samples_for_each_factor_of_ten(aspects, poses):
    history = History(aspects)
    history.add(aspect_ids(aspects, poses))
    drops, counts = history.points()
    assert drops[:3].tolist() == [10, 13, 16]
    assert set(drops.tolist()) >= {FIRST_SAMPLE, 100, 1000, 3000}
    assert len(drops) == len(counts) == 26


def test_history_without_drops_is_empty(aspects):
    drops, counts = History(aspects).points()
    assert drops.shape == (0,)
    assert counts.shape == (0, 5)
