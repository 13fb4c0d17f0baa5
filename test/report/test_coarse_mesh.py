"""A coarse mesh has few triangles, and the surface of the fine one."""

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.report.picture import coarse_mesh


@pytest.fixture(scope='module')
def ball():
    """Radius 1, 20480 triangles."""
    mesh = trimesh.creation.icosphere(subdivisions=5)
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)


@pytest.mark.parametrize('most', [100, 10_000])
def test_number_of_triangles_is_close_to_the_limit(ball, most):
    _, faces = coarse_mesh(*ball, most)
    assert most / 4 < len(faces) <= most
    assert (np.sort(faces)[:, 1:] > np.sort(faces)[:, :-1]).all()  # three corners each
    assert len(np.unique(np.sort(faces), axis=0)) == len(faces)


def test_triangles_are_near_the_surface_and_face_outward(ball):
    points, faces = coarse_mesh(*ball, 2000)
    corners = points[faces]
    a, b, c = np.moveaxis(corners, 1, 0)
    assert (np.linalg.norm(corners.mean(axis=1), axis=1) > 0.95).all()
    outward = (np.cross(b - a, c - a) * corners.mean(axis=1)).sum(axis=1)
    assert (outward > 0).mean() > 0.98
