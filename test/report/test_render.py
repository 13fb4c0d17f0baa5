"""Pictures of a part: what the renderer sees, coarse meshes, and poses on the tray."""

import dataclasses

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report import picture
from resting_aspects_ros.report.picture import (
    FROM_ABOVE,
    NOTHING,
    OBLIQUE,
    PITCH,
    ROW,
    aspect_poses,
    coarse_mesh,
    draw_parts,
    edges,
    message_part,
    pose_parts,
    rasterise,
)

SIZE, PIXELS = 200, 160
BLUE = (0.0, 0.45, 0.7)


def turned(mesh, rotation, scale=1.0):
    """Points of the mesh in pixels, in the middle of the picture."""
    points = rotation.apply(mesh.vertices - mesh.bounds.mean(axis=0)) * scale
    return points + np.array([SIZE / 2, SIZE / 2, 0.0])


@pytest.mark.parametrize(
    'mesh',
    [
        trimesh.creation.box([10, 20, 30]),
        trimesh.creation.icosphere(subdivisions=5, radius=18),  # 20,480 triangles, of a few pixels
    ],
    ids=['box', 'sphere'],
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
    away = []
    for face, (a, b, c) in enumerate(points[faces]):
        sides = np.column_stack([(b - a)[:2], (c - a)[:2]])
        if np.linalg.det(sides) <= 0:
            away.append(face)
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
    assert not np.isin(seen.face, away).any()


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
    assert not edges(seen, mesh.face_normals)[60:140, 45:155].any()

    low, high = trimesh.creation.box([40, 40, 10]), trimesh.creation.box([10, 10, 10])
    high.apply_translation([0, 0, 12])
    stack = trimesh.util.concatenate([low, high])
    seen = rasterise(turned(stack, Rotation.identity(), 4.0), stack.faces, SIZE)
    inner = edges(seen, stack.face_normals)[40:160, 40:160]
    assert inner.sum() == (4 * 40 - 4) + 4 * 40


def test_coarse_mesh_is_near_the_surface_and_faces_outward():
    ball = trimesh.creation.icosphere(subdivisions=5)  # radius 1, 20480 triangles
    points, faces = coarse_mesh(np.array(ball.vertices), np.array(ball.faces), 2000)
    assert 500 < len(faces) <= 2000
    corners = points[faces]
    a, b, c = np.moveaxis(corners, 1, 0)
    assert (np.linalg.norm(corners.mean(axis=1), axis=1) > 0.95).all()
    outward = (np.cross(b - a, c - a) * corners.mean(axis=1)).sum(axis=1)
    assert (outward > 0).mean() > 0.98


def extent(image):
    """Width and height of the part, pixels."""
    rows, columns = np.nonzero(image[..., 3] > 0.95)
    return np.array([np.ptp(columns), np.ptp(rows)]) + 1.0


@pytest.mark.parametrize('view', [OBLIQUE, FROM_ABOVE], ids=['oblique', 'above'])
def test_parts_have_the_sizes_of_their_projections(part, view):
    """One scale for all: extents in pixels are in the ratio of extents in metres."""
    bracket = part('l_bracket')
    solids = pose_parts(bracket, find_aspects(bracket).aspects)
    images = draw_parts(solids, [BLUE] * len(solids), PIXELS, view)
    scale = extent(images[0])[0] / np.ptp(solids[0].points @ view[0])
    for image, solid in zip(images, solids, strict=True):
        expected = np.ptp(solid.points @ view[:2].T, axis=0) * scale
        assert extent(image) == pytest.approx(expected, abs=3)


def test_inside_of_an_open_mesh_is_visible(solid):
    box = trimesh.creation.box([20, 30, 40])
    whole = solid(box)
    inertia = whole.inertia[np.triu_indices(3)]
    box.update_faces(box.face_normals[:, 2] < 0.5)
    lidless = solid(box, mass=whole.mass, centre_of_mass=[0, 0, 0], inertia=inertia)
    aspects = find_aspects(whole).aspects
    closed, opened = (
        draw_parts(pose_parts(each, aspects), [BLUE] * 6, PIXELS) for each in (whole, lidless)
    )
    for a, b in zip(closed, opened, strict=True):
        # One looks through the opening at the inner sides of the walls, which fill the outline.
        assert extent(a) == pytest.approx(extent(b), abs=1)
        inside = a[..., 3] > 0.95
        assert (inside ^ (b[..., 3] > 0.95)).sum() < 0.01 * inside.sum()


def in_tray(standing, points):
    return Rotation.from_quat(standing.orientation).apply(np.array(points)) + standing.position


@pytest.mark.parametrize('name', ['l_bracket', 'cylinder_d20_h20'])
def test_each_pose_touches_the_surface_in_its_aspect(part, name):
    part = part(name)
    aspects = find_aspects(part).aspects
    for each, aspect in zip(aspect_poses(part, aspects), aspects, strict=True):
        assert each.aspect_id == aspect.id
        height = in_tray(each, part.vertices)[:, 2]
        assert abs(height.min()) < 1e-9 * part.hull_radius
        assert height.max() == pytest.approx(each.top)
        centre = in_tray(each, part.centre_of_mass)
        np.testing.assert_allclose(centre, each.centre_of_mass, atol=1e-12)
        # A flat of the mesh is closer to the axis than the curved side that it stands for.
        slack = 2e-3 if aspect.sweep.curved else 1e-9
        assert centre[2] == pytest.approx(aspect.com_height, abs=slack * part.hull_radius)


def test_poses_form_a_centred_grid_in_order(part):
    part = part('tetrahedron')
    first = find_aspects(part).aspects[0]
    aspects = [dataclasses.replace(first, id=k) for k in range(1, ROW + 3)]
    places = np.array([each.centre_of_mass[:2] for each in aspect_poses(part, aspects)])
    expected = [(k % ROW - (ROW - 1) / 2, 0.5 - k // ROW) for k in range(ROW + 2)]
    np.testing.assert_allclose(places / (PITCH * part.hull_radius), expected, atol=1e-9)


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
