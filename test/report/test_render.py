"""What the renderer sees is what is there: against formulas and a slower way."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.report.picture import NOTHING, edges, rasterise

SIZE = 200


def turned(mesh, rotation, scale=1.0):
    """Points of the mesh in pixels, in the middle of the picture."""
    points = rotation.apply(mesh.vertices - mesh.bounds.mean(axis=0)) * scale
    return points + np.array([SIZE / 2, SIZE / 2, 0.0])


@pytest.mark.parametrize(
    'mesh',
    [
        trimesh.creation.box([10, 20, 30]),
        trimesh.creation.icosphere(subdivisions=5, radius=18),  # 20,480 triangles, of a few pixels
        trimesh.creation.cylinder(radius=8, height=30, sections=64),
    ],
    ids=['box', 'sphere', 'cylinder'],
)
def test_convex_silhouette_has_the_projected_area(mesh):
    for rotation in Rotation.random(4, np.random.default_rng(3)):
        seen = rasterise(turned(mesh, rotation, 4.0), mesh.faces, SIZE).face != NOTHING
        towards = mesh.face_normals @ rotation.as_matrix()[2]
        area = 16 * (mesh.area_faces * towards.clip(0)).sum()
        # Each pixel on the border is off by at most half, either way; they nearly cancel.
        border = 2 * (seen.any(axis=0).sum() + seen.any(axis=1).sum())
        assert abs(seen.sum() - area) < 0.1 * border


def test_rasterise_matches_a_brute_force_search():
    generator = np.random.default_rng(5)
    size, points = 40, generator.uniform(-10, 50, (90, 3))
    faces = np.arange(90).reshape(-1, 3)
    faces = np.concatenate([faces, faces[:, ::-1]])  # from both sides; half of them face away
    centres = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1) + 0.5
    expected = np.full((size, size), -np.inf)
    for a, b, c in points[faces]:
        sides = np.column_stack([(b - a)[:2], (c - a)[:2]])
        if np.linalg.det(sides) <= 0:
            continue
        u, v = np.moveaxis((centres - a[:2]) @ np.linalg.inv(sides).T, -1, 0)
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        depth = a[2] + u * (b - a)[2] + v * (c - a)[2]
        expected = np.where(inside, np.maximum(expected, depth), expected)
    seen = rasterise(points, faces, size)
    covered = np.isfinite(expected)
    assert 0.5 < covered.mean() < 1.0
    assert np.array_equal(seen.face != NOTHING, covered)
    np.testing.assert_allclose(seen.depth[covered], expected[covered], atol=1e-6)
    assert not np.isin(
        seen.face,
        [f for f, p in enumerate(points[faces]) if np.cross(p[1] - p[0], p[2] - p[0])[2] < 0],
    ).any()


def test_edges_are_outlines_and_creases_only():
    box = trimesh.creation.box([20, 30, 10])
    straight = rasterise(turned(box, Rotation.identity(), 4.0), box.faces, SIZE)
    drawn = edges(straight, box.face_normals)
    # Pixels along the face's border, inside and outside of it; nothing on its diagonal.
    assert drawn.sum() == (2 * (80 + 120) - 4) + 2 * (80 + 120)
    assert not drawn[60:140, 70:130].any()


def test_curved_sides_have_no_edges_but_depth_steps_do():
    mesh = trimesh.creation.cylinder(radius=15, height=40, sections=64)
    lying = Rotation.from_euler('x', 90, degrees=True)
    seen = rasterise(turned(mesh, lying, 4.0), mesh.faces, SIZE)
    inner = edges(seen, mesh.face_normals)[60:140, 45:155]
    assert not inner.any()

    low, high = trimesh.creation.box([40, 40, 10]), trimesh.creation.box([10, 10, 10])
    high.apply_translation([0, 0, 12])
    stack = trimesh.util.concatenate([low, high])
    seen = rasterise(turned(stack, Rotation.identity(), 4.0), stack.faces, SIZE)
    inner = edges(seen, stack.face_normals)[40:160, 40:160]
    assert inner.sum() == (4 * 40 - 4) + 4 * 40
