"""The union of many triangles from samples, against exact unions of Shapely."""

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.vision.outline import _MARGIN, sampled_union

STEP = 1e-3


def fans(polygons):
    """Return the corners and the counter-clockwise triangles of convex polygons."""
    plane, faces = [], []
    for polygon in polygons:
        ring = np.array(shapely.geometry.polygon.orient(polygon).exterior.coords)[:-1]
        k = np.arange(1, len(ring) - 1)
        faces.append(len(plane) + np.stack([0 * k, k, k + 1], axis=1))
        plane += ring.tolist()
    return np.array(plane), np.concatenate(faces)


def assert_same(found, exact):
    # Both sides of a corner that is cut end at lines of one cell, so each is shorter than its
    # diagonal, and the area is less than the square of a step. Corners of random unions that are
    # so acute that more is cut are few, and those that are blunter lose less.
    assert found.is_valid
    assert found.symmetric_difference(exact).area < shapely.get_num_coordinates(exact) * STEP**2


@pytest.mark.parametrize('seed', range(2))
def test_union_of_random_polygons_is_that_of_shapely(seed):
    generator = np.random.default_rng(seed)
    polygons = [
        shapely.affinity.rotate(
            shapely.Point(*generator.random(2)).buffer(generator.uniform(0.02, 0.1), quad_segs=2),
            generator.uniform(0, 360),
        )
        for _ in range(120)
    ]
    found = sampled_union(*fans(polygons), STEP)
    assert_same(found, shapely.union_all(polygons))


def grid_shapes():
    """Shapes with sides on lines of the grid.

    The lowest corner of all is _MARGIN beyond a line, so that multiples of a step are on lines.
    """
    low = _MARGIN * STEP
    triangle = shapely.Polygon([(low, low), (10 * STEP, low), (low, 10 * STEP)])
    return [triangle, shapely.box(20 * STEP, 20 * STEP, 520 * STEP, 220 * STEP)]


@pytest.mark.parametrize(
    'shapes', [[shapely.affinity.rotate(shapely.box(0, 0, 1, 0.5), 31)], grid_shapes()]
)
def test_sides_between_samples_and_on_lines_are_exact(shapes):
    found = sampled_union(*fans(shapes), STEP)
    assert_same(found, shapely.union_all(shapes))
    corners = np.array(shapes[-1].exterior.coords)
    middles = shapely.points((corners[1:] + corners[:-1]) / 2)
    assert shapely.distance(found.boundary, middles).max() < 1e-12


def test_noisy_walls_are_those_of_shapely():
    """The walls of a scan are stacks of triangles that overlap at random."""
    ring = trimesh.creation.annulus(5, 10, 8, sections=32)
    for _ in range(2):
        ring = ring.subdivide()
    noise = np.random.default_rng(1).normal(0, 0.02, ring.vertices.shape)
    ring.vertices = Rotation.from_euler('xyz', [0.3, 0.2, 0.1]).apply(ring.vertices + noise) / 10
    plane, faces = ring.vertices[:, :2], ring.faces[ring.face_normals[:, 2] > 0]
    found = sampled_union(plane, faces, STEP)
    assert_same(found, shapely.union_all(shapely.polygons(plane[faces]), grid_size=1e-9))
    assert len(found.interiors) == 1
