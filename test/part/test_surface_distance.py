"""Distances through the tree of boxes are those to all triangles, one by one."""

import numpy as np
import pytest

from resting_aspects_ros.part import near as surface_distance
from resting_aspects_ros.part.near import TriangleTree


def fan(n):
    """Needles from the tip of a cone: each box lies over many others."""
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    tip = np.broadcast_to([0.0, 0.0, 0.7], rim.shape)
    return np.stack([tip, rim, np.roll(rim, -1, axis=0)], axis=1)


def distances(triangles, points):
    """Of points (n, 3) from the nearest of triangles, by points of a fine grid on each."""
    u, v = np.meshgrid(*[np.linspace(0, 1, 49)] * 2)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=-1).reshape(-1, 3)
    on = np.einsum('wc,mcj->mwj', weights, triangles).reshape(-1, 3)
    return np.array([np.linalg.norm(on - point, axis=1).min() for point in points])


@pytest.fixture(params=[(32, 500_000), (1, 500_000), (1, 50)])
def tree(request, monkeypatch):
    """Make a tree that looks ahead, and divides its work, early or late."""
    crowded, pairs = request.param
    monkeypatch.setattr(surface_distance, 'BATCH', 64)
    monkeypatch.setattr(surface_distance, 'CROWDED', crowded)
    monkeypatch.setattr(surface_distance, 'MAX_PAIRS', pairs)
    return lambda triangles: TriangleTree(triangles, np.zeros(len(triangles)))


@pytest.mark.quick_cases(1)
def test_near_and_nearest_agree_with_exhaustive_search(tree):
    triangles = fan(100)
    points = np.random.default_rng(1).uniform(-1, 1, (200, 3)) * [1, 1, 0.8]
    points[0] = 0, 0, 0.7
    expected = distances(triangles, points)
    grid = 0.02  # half of what is between the points of the grid
    reach = 0.2
    surface = tree(triangles)
    near = surface.near(points, np.full(len(points), reach), np.zeros(len(points)))
    assert near[0]
    assert near[expected <= reach].all()
    assert not near[expected > reach + grid].any()
    found, _, ways = surface.nearest(points, 3.0)
    np.testing.assert_array_equal(np.sort(found), np.arange(len(points)))
    apart = np.linalg.norm(ways, axis=1)
    assert (apart <= expected[found] + 1e-12).all()
    assert (apart >= expected[found] - grid).all()
