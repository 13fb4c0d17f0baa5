"""Clusters of down directions against single linkage, and their agreement with aspects."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.clusters import (
    DEFAULT_TOLERANCE_DEGREES,
    Clusters,
    cluster_directions,
    find_agreement,
    find_clusters,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import angle_between, down_in_part, random_orientations

TOLERANCE = np.radians(DEFAULT_TOLERANCE_DEGREES)

seeds = st.integers(0, 2**32 - 1)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def around(degrees):
    """Directions on the equator."""
    angle = np.radians(degrees)
    return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)


def groups(labels):
    """The sets of places that have a label in common."""
    return {frozenset(np.flatnonzero(labels == label)) for label in np.unique(labels)}


def scattered(seed):
    """Few and many directions, near and far from each other, some of them equal."""
    generator = np.random.default_rng(seed)
    centres = unit(generator.standard_normal((generator.integers(1, 30), 3)))
    which = generator.integers(0, len(centres), generator.integers(1, 400))
    spread = 10 ** generator.uniform(-6, 0)
    noise = spread * generator.standard_normal((len(which), 3)) * generator.integers(0, 2)
    return unit(centres[which] + noise)


def test_equal_clusters_are_ordered_by_coordinates():
    axes = np.array([(0, 0, 1), (1, 0, 0), (0, -1, 0), (-1, 0, 0), (0, 0, -1), (0, 1, 0)])
    assert cluster_directions(axes.astype(float), TOLERANCE).tolist() == [4, 6, 2, 1, 3, 5]


@pytest.mark.parametrize(('share', 'clusters'), [(1 - 1e-9, 1), (1 + 1e-9, 2)])
@pytest.mark.parametrize('degrees', [1, 30])
def test_step_joins_a_cluster_up_to_the_tolerance(share, clusters, degrees):
    for turn in Rotation.random(50, random_state=1).as_matrix():
        pair = around(np.array([0.0, degrees * share])) @ turn
        assert cluster_directions(pair, np.radians(degrees)).max() == clusters


@given(seeds, st.floats(1, 30))
def test_clusters_agree_with_single_linkage(seed, degrees):
    down = scattered(seed)
    labels = cluster_directions(down, np.radians(degrees))
    if len(down) > 1:
        reach = 2 * np.sin(np.radians(degrees) / 2)
        assert groups(labels) == groups(fcluster(linkage(down, 'single'), reach, 'distance'))
    counts = np.bincount(labels)[1:]
    assert counts.min() > 0
    assert (np.diff(counts) <= 0).all()


@given(seeds)
def test_clusters_do_not_depend_on_the_order_of_poses(seed):
    down = scattered(seed)
    order = np.random.default_rng(seed).permutation(len(down))
    plain, mixed = find_clusters(down, TOLERANCE), find_clusters(down[order], TOLERANCE)
    np.testing.assert_array_equal(mixed.labels, plain.labels[order])
    for name in ('counts', 'mean', 'spread'):
        np.testing.assert_array_equal(getattr(mixed, name), getattr(plain, name))


def test_ring_is_one_cluster_without_a_mean():
    ring = around(np.random.default_rng(1).uniform(0, 360, 2000))
    ends = np.repeat([[0, 0, 1.0], [0, 0, -1.0]], [700, 300], axis=0)
    clusters = find_clusters(np.concatenate([ends, ring]), TOLERANCE)
    assert clusters.counts.tolist() == [2000, 700, 300]
    assert np.isnan(clusters.mean[0]).all()
    assert np.isnan(clusters.spread[0])
    np.testing.assert_array_equal(clusters.mean[1:], [[0, 0, 1], [0, 0, -1]])


def test_mean_and_spread_of_scattered_directions():
    # Two normal components across the mean, each with this deviation; n = 20000 knows it to 0.5 %.
    deviation, n = np.radians(0.8), 20_000
    centre = unit(np.array([1.0, 2.0, -3.0]))
    noise = deviation * np.random.default_rng(1).standard_normal((n, 3))
    down = unit(centre + noise - (noise @ centre)[:, None] * centre)
    clusters = find_clusters(down, TOLERANCE)
    assert len(clusters) == 1
    error = angle_between(clusters.mean, centre[None])[0]
    assert error < 4 * deviation / np.sqrt(n)
    assert clusters.spread[0] == pytest.approx(np.sqrt(2) * deviation, rel=0.02)


def test_clusters_of_no_direction_and_of_one():
    none = find_clusters(np.zeros((0, 3)), TOLERANCE)
    assert (len(none), none.labels.shape, none.mean.shape) == (0, (0,), (0, 3))
    one = find_clusters(np.array([[0, 0.6, -0.8]]), TOLERANCE)
    assert (one.labels.tolist(), one.counts.tolist(), one.spread.tolist()) == ([1], [1], [0])


@pytest.mark.parametrize('degrees', [-5, 0.9, 31, np.nan])
def test_tolerance_outside_limits_is_rejected(degrees):
    with pytest.raises(InvalidValueError, match=rf'tolerance {degrees:g} degrees.*1 to 30'):
        cluster_directions(np.zeros((0, 3)), np.radians(degrees))


def clusters_of(labels):
    """Return clusters with these labels; their other fields do not matter."""
    counts = np.bincount(labels)[1:]
    nothing = np.full((len(counts), 3), np.nan)
    return Clusters(np.array(labels), counts, nothing, nothing[:, 0])


def test_agreement_of_every_pose_in_a_small_example():
    # Cluster 1 contains aspect 2, and more poses in no aspect than in aspect 1; cluster 2 is in
    # none; aspect 3 is split into clusters 3 and 4.
    aspect = np.array([1, 1, 1, 2, 2, 0, 0, 0, 0, 0, 0, 0, 3, 3, 3])
    cluster = np.array([1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 3, 3, 4])
    found = find_agreement(aspect, 4, clusters_of(cluster))
    assert found.cluster_of.tolist() == [1, 1, 3, 0]
    assert found.shared.tolist() == [3, 2, 2, 0]
    assert found.agree.tolist() == [*[True] * 3, *[False] * 9, True, True, False]


def test_both_agree_on_poses_near_a_facet(part):
    """Some tilted out of an aspect, and some in no aspect."""
    aspects, generator = find_aspects(part('t_prism')), np.random.default_rng(5)
    orientations = np.array([a.orientation for a in aspects])
    flat = orientations[generator.integers(len(aspects), size=500)]
    tilt = generator.standard_normal((len(flat), 3)) * [1, 1, 0]
    tilt *= np.radians(0.9) / np.linalg.norm(tilt, axis=1, keepdims=True)
    tilted = (Rotation.from_rotvec(tilt) * Rotation.from_quat(flat)).as_quat()
    xyzw = np.concatenate([flat, tilted, random_orientations(generator, 30)])
    ids, down = aspects.classify(xyzw), down_in_part(xyzw)
    agree = find_agreement(ids, len(aspects), find_clusters(down, TOLERANCE)).agree
    nearest, angle = aspects.locate(down)
    near = angle <= np.radians(1)
    assert np.count_nonzero(near) >= 1000
    assert agree[near].all()
    assert (ids[near] == nearest[near]).all()
