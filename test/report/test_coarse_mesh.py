"""A coarse mesh has few triangles, real vertices, and the outline of the fine one."""

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.report.picture import coarse_faces

NOTHING = np.zeros(0, dtype=np.int64)


@pytest.fixture(scope='module')
def ball():
    """Radius 1, 20480 triangles."""
    mesh = trimesh.creation.icosphere(subdivisions=5)
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)


@pytest.mark.parametrize('most', [100, 10_000])
def test_number_of_triangles_is_close_to_the_limit(ball, most):
    faces = coarse_faces(*ball, most, NOTHING)
    assert most / 4 < len(faces) <= most
    assert (np.sort(faces)[:, 1:] > np.sort(faces)[:, :-1]).all()  # three corners each
    assert len(np.unique(np.sort(faces), axis=0)) == len(faces)


def test_triangles_are_near_the_surface_and_face_outward(ball):
    vertices, _ = ball
    corners = vertices[coarse_faces(*ball, 2000, NOTHING)]
    a, b, c = np.moveaxis(corners, 1, 0)
    assert (np.linalg.norm(corners.mean(axis=1), axis=1) > 0.95).all()
    outward = (np.cross(b - a, c - a) * corners.mean(axis=1)).sum(axis=1)
    assert (outward > 0).mean() > 0.98


def test_kept_vertices_remain_corners(ball):
    kept = np.array([3, 77, 4000, 10_000])
    assert set(kept) <= set(coarse_faces(*ball, 300, kept).ravel().tolist())


def test_result_is_invariant_to_scale_and_position(ball):
    vertices, faces = ball
    moved = vertices * 2.0**-10 + 0.5
    once = coarse_faces(vertices + 512, faces, 500, NOTHING)
    np.testing.assert_array_equal(coarse_faces(moved, faces, 500, NOTHING), once)
