"""Two classifiers beside each other: a case with every pose spelled out, and example parts."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.clusters import Clusters, find_clusters
from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.core.rotations import down_in_part, random_orientations
from resting_aspects_ros.core.statistics.agreement import find_agreement, find_differences
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.plan import make_job

# Parts with flat sides only.
POLYHEDRA = (
    *('angle_45x30x8', 'box_10x20x30', 'hex_nut', 'l_bracket', 't_prism', 'tetrahedron'),
    'u_bracket',
)
TOLERANCE = np.radians(5)


def clusters_of(labels):
    """Return clusters with these labels; their other fields do not matter."""
    counts = np.bincount(labels)[1:]
    nothing = np.full((len(counts), 3), np.nan)
    return Clusters(np.array(labels), counts, nothing, nothing[:, 0])


def test_agreement_of_every_pose_in_a_small_example():
    # Cluster 1 contains aspect 2; aspect 3 is split into clusters 3 and 4; cluster 2 is in none.
    aspect = np.array([1, 1, 1, 2, 2, 0, 0, 0, 0, 3, 3, 3])
    cluster = np.array([1, 1, 1, 1, 1, 1, 2, 2, 2, 3, 3, 4])
    found = find_agreement(aspect, 4, clusters_of(cluster))
    assert found.cluster_of.tolist() == [1, 1, 3, 0]
    assert found.shared.tolist() == [3, 2, 2, 0]
    assert found.agree.tolist() == [*[True] * 3, *[False] * 6, True, True, False]


def test_part_without_aspects_has_no_agreement(part):
    found = find_agreement(np.zeros(3, dtype=np.int64), 0, clusters_of([1, 1, 2]))
    assert not found.agree.any()
    differences = find_differences(found, AspectSet('', ()), np.tile([0, 0, -1.0], (3, 1)))
    assert differences.nearest.tolist() == [0, 0, 0]
    assert np.isinf(differences.angle).all()


def test_nearest_aspect_agrees_with_exhaustive_search(part):
    aspects = find_aspects(part('l_bracket'))
    down = down_in_part(random_orientations(np.random.default_rng(1), 2000))
    table = np.array([a.down_in_part for a in aspects.aspects])
    angle = np.arccos(np.clip(down @ table.T, -1, 1))
    nearest, least = aspects.locate(down)
    np.testing.assert_array_equal(nearest, angle.argmin(axis=1) + 1)
    np.testing.assert_allclose(least, angle.min(axis=1), atol=1e-7)


def test_differences_list_the_poses_and_both_results(part):
    aspects = find_aspects(part('box_10x20x30'))
    flat = np.array([a.orientation for a in aspects.aspects] * 2)
    tilt = Rotation.from_rotvec([np.radians(20), 0, 0])
    flat[3] = (tilt * Rotation.from_quat(flat[3])).as_quat()
    down = down_in_part(flat)
    clusters = find_clusters(down, TOLERANCE)
    found = find_differences(find_agreement(aspects.classify(flat), 6, clusters), aspects, down)
    assert (found.pose.tolist(), found.nearest.tolist(), found.aspect.tolist()) == ([3], [4], [0])
    assert np.degrees(found.angle[0]) == pytest.approx(20)
    assert clusters.counts[found.cluster[0] - 1] == 1


@pytest.mark.parametrize('name', POLYHEDRA)
def test_both_agree_on_dropped_poses_near_a_facet(part, surfaces, name):
    shape, n = part(name), 1000
    poses = drop_range(make_job(shape, surfaces.get(), 11), 0, n)
    orientation = poses.orientation[poses.status == RestStatus.SETTLED]
    assert len(orientation) > 0.99 * n
    assert np.count_nonzero(near_and_agreed(shape, orientation)) > 0.99 * n


@pytest.mark.parametrize('name', POLYHEDRA)
def test_both_agree_on_tilted_poses_near_a_facet_among_outliers(part, name):
    shape = part(name)
    generator = np.random.default_rng(5)
    shown = np.array([a.orientation for a in find_aspects(shape).aspects])
    flat = shown[generator.integers(0, len(shown), 500)]
    tilt = generator.standard_normal((500, 3)) * [1, 1, 0]
    tilt *= np.radians(generator.uniform(0, 0.999, (500, 1))) / np.linalg.norm(
        tilt, axis=1, keepdims=True
    )
    yaw = Rotation.from_rotvec(generator.uniform(-np.pi, np.pi, (500, 1)) * [0, 0, 1])
    near = (yaw * Rotation.from_rotvec(tilt) * Rotation.from_quat(flat)).as_quat()
    poses = np.concatenate([near, random_orientations(generator, 30)])
    assert np.count_nonzero(near_and_agreed(shape, poses)) >= 500


def near_and_agreed(shape, orientation):
    """Return which poses are within a degree of an aspect; both classifiers agree on them."""
    aspects = find_aspects(shape)
    down = down_in_part(orientation)
    ids = aspects.classify(orientation)
    agree = find_agreement(ids, len(aspects), find_clusters(down, TOLERANCE)).agree
    nearest, angle = aspects.locate(down)
    near = angle <= np.radians(1)
    assert agree[near].all()
    assert (ids[near] == nearest[near]).all()
    return near
