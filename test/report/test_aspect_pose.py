"""Parts side by side on the tray: on the surface, in order, and apart."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report import picture
from resting_aspects_ros.report.picture import PITCH, ROW, aspect_poses, message_part


def in_tray(standing, points):
    return Rotation.from_quat(standing.orientation).apply(np.array(points)) + standing.position


@pytest.mark.parametrize('name', ['l_bracket', 'tetrahedron', 'cylinder_d20_h20'])
def test_each_pose_touches_the_surface_in_its_aspect(part, name):
    part = part(name)
    aspects = find_aspects(part).aspects
    standing = aspect_poses(part, aspects)
    assert [each.aspect_id for each in standing] == [aspect.id for aspect in aspects]
    for each, aspect in zip(standing, aspects, strict=True):
        height = in_tray(each, part.vertices)[:, 2]
        assert abs(height.min()) < 1e-9 * part.hull_radius
        assert height.max() == pytest.approx(each.top)
        centre = in_tray(each, part.centre_of_mass)
        np.testing.assert_allclose(centre, each.centre_of_mass, atol=1e-12)
        # A flat of the mesh is closer to the axis than the curved side that it stands for.
        slack = 2e-3 if aspect.sweep.curved else 1e-9
        assert centre[2] == pytest.approx(aspect.com_height, abs=slack * part.hull_radius)


@pytest.mark.parametrize('count', [1, ROW + 1, 50, 101])
def test_poses_form_a_centred_grid_in_order(part, count):
    part = part('tetrahedron')
    first = find_aspects(part).aspects[0]
    aspects = [dataclasses.replace(first, id=k) for k in range(1, count + 1)]
    places = np.array([each.centre_of_mass[:2] for each in aspect_poses(part, aspects)])
    pitch = PITCH * part.hull_radius
    assert (pdist(places) > pitch * (1 - 1e-9)).all()
    np.testing.assert_allclose(places.min(axis=0) + places.max(axis=0), 0, atol=1e-9)
    width, depth = np.ptp(places, axis=0) / pitch
    assert width + 1 <= max(ROW, np.ceil(np.sqrt(count))) + 1e-9
    assert (depth < 1e-9) == (count <= ROW)
    for (x, y), (next_x, next_y) in pairwise(places):
        if abs(next_y - y) < 1e-9:
            assert next_x == pytest.approx(x + pitch)
        else:
            assert next_y == pytest.approx(y - pitch)
            assert next_x == pytest.approx(places[:, 0].min())


def test_simplified_mesh_still_touches_the_surface(solid, monkeypatch):
    monkeypatch.setattr(picture, 'MAX_TRIANGLES', 6 * 500)
    mesh = trimesh.creation.box((10, 20, 30))
    for _ in range(4):  # to 3072 triangles
        mesh = mesh.subdivide()
    part = solid(mesh)
    aspects = find_aspects(part).aspects
    shown = message_part(part, len(aspects))
    assert 100 < len(shown.faces) <= 500
    for each in aspect_poses(shown, aspects):
        corners = in_tray(each, shown.vertices)
        assert abs(corners[:, 2].min()) < 1e-9 * part.hull_radius
        whole = in_tray(each, part.vertices)
        np.testing.assert_allclose(np.ptp(corners, axis=0), np.ptp(whole, axis=0), rtol=0.1)
