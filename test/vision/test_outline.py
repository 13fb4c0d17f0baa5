"""Outlines against areas in closed form, a test of single points, and Cauchy's mean area."""

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely.affinity import scale
from solids import a_turn, turned
from trimesh.creation import extrude_polygon

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.vision.outline import GRID, find_outlines, seen_outline, silhouette

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=4, suppress_health_check=[HealthCheck.function_scoped_fixture])


def quaternion(seed):
    return Rotation.from_quat(np.random.default_rng(seed).standard_normal(4)).as_quat()


def circle(sides, radius=10.0, centre=(0.0, 0.0), phase=0.1):
    angle = 2 * np.pi * np.arange(sides) / sides + phase
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius + centre


def ratchet(teeth):
    angle = 2 * np.pi * np.repeat(np.arange(teeth), 2) / teeth
    return np.tile([8.0, 10.0], teeth)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


# Polygon, yaw symmetry, whether it has a mirror axis.
SHAPES = {
    'stretched': (scale(shapely.Polygon(circle(100)), 1, 1.0015), 0, True),
    'two_unequal_holes': (
        shapely.Polygon(circle(24), [circle(12, 2.0, (5, 0)), circle(12, 1.0, (0, 5))]),
        1,
        False,
    ),
    'ratchet': (shapely.Polygon(ratchet(12)), 12, False),
    'equal_l': (shapely.Polygon([(0, 0), (30, 0), (30, 8), (8, 8), (8, 30), (0, 30)]), 1, True),
    'parallelogram': (shapely.Polygon([(0, 0), (20, 0), (30, 15), (10, 15)]), 2, False),
}


def flat_outline(part):
    """The outline of the aspect on the largest flat side of a prism."""
    outlines = find_outlines(part, find_aspects(part))
    return min(outlines, key=lambda each: each.height)


def projected(part, orientation):
    points = Rotation.from_quat(orientation).apply(part.vertices - part.centre_of_mass)
    return points[:, :2][part.faces]


@pytest.mark.parametrize('name', ['tetrahedron', 'cylinder_d20_h20'])
@given(seed=seeds)
@few
def test_area_of_convex_parts_is_half_that_of_the_shadows_of_faces(part, name, seed):
    shape, orientation = part(name), quaternion(seed)
    a, b, c = np.moveaxis(projected(shape, orientation), 1, 0)
    ab, ac = b - a, c - a
    faces = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2
    outline = seen_outline(shape, orientation)
    assert outline.area == pytest.approx(faces.sum() / 2, rel=1e-5)
    assert not outline.interiors


def test_long_axis_is_the_direction_of_the_length(solid):
    mesh, angle = trimesh.creation.box((30, 12, 5)), np.radians(35.0)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, (0, 0, 1)))
    outline = flat_outline(solid(mesh))
    turn = Rotation.from_quat(outline.orientation)
    x, y, _ = turn.apply([np.cos(angle), np.sin(angle), 0])
    assert 0 <= outline.long_axis < np.pi
    assert abs(x * np.sin(outline.long_axis) - y * np.cos(outline.long_axis)) < 1e-5


@pytest.mark.parametrize('name', ['hex_nut', 'u_bracket', 'angle_45x30x8'])
@given(seed=seeds)
@few
def test_points_are_inside_where_a_triangle_is_above(part, name, seed):
    shape, orientation = part(name), quaternion(seed)
    outline = seen_outline(shape, orientation)
    triangles = projected(shape, orientation)
    low, high = triangles.reshape(-1, 2).min(axis=0), triangles.reshape(-1, 2).max(axis=0)
    places = np.random.default_rng(seed).uniform(low, high, (1500, 2))
    points = shapely.points(places)
    covered = np.zeros(len(points), dtype=bool)
    covered[shapely.STRtree(shapely.polygons(triangles)).query(points, 'intersects')[0]] = True
    differ = points[covered != shapely.contains(outline, points)]
    assert (shapely.distance(outline.boundary, differ) < 3e-5 * shape.hull_radius).all()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', SHAPES)
def test_symmetries_and_area_of_prisms(solid, name):
    """They depend neither on the frame of the mesh nor on its subdivision."""
    polygon, order, mirror = SHAPES[name]
    mesh = extrude_polygon(polygon, 3)
    outline = flat_outline(
        solid(turned(mesh.subdivide(), a_turn(2), (9, 20, -40)) if name == 'equal_l' else mesh)
    )
    assert (outline.yaw_symmetry, outline.mirror_symmetric) == (order, mirror)
    assert outline.area == pytest.approx(polygon.area * 1e-6, rel=1e-5)
    assert outline.polygon.exterior.is_ccw
    assert len(outline.polygon.interiors) == len(polygon.interiors)


@pytest.mark.slow
def test_round_part_that_rolls_has_no_family(solid):
    coarse = trimesh.creation.cylinder(10, 50, sections=16)
    ball = solid(trimesh.creation.icosphere(3, 10))
    for shape in (solid(coarse), ball):
        outlines = find_outlines(shape, find_aspects(shape))
        assert [o.family for o in outlines] == [()] * len(outlines)
    assert [o.yaw_symmetry for o in outlines] == [0]


def box_faces(skipped=()):
    mesh = trimesh.creation.box((2, 1, 1))
    keep = [k for k, n in enumerate(mesh.face_normals) if tuple(np.round(n)) not in skipped]
    return np.array(mesh.vertices), np.array(mesh.faces)[keep]


def test_mesh_without_top_or_inside_out_has_the_same_silhouette():
    vertices, faces = box_faces({(0, 0, 1)})
    for each in (faces, faces[:, ::-1]):
        outline = silhouette(vertices, each, closed=False, radius=1.2)
        assert outline.symmetric_difference(shapely.box(-1, -0.5, 1, 0.5)).area < 1e-8
    sheet = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1.0]])
    with pytest.raises(PartError, match='from its edge'):
        silhouette(sheet, np.array([[0, 1, 2], [0, 2, 3]]), closed=False, radius=1.0)


def two_boxes(gap):
    vertices, faces = box_faces()
    both = np.concatenate([vertices, vertices + np.array([2 + gap, 0, 0])])
    return silhouette(both, np.concatenate([faces, faces + len(vertices)]), True, 2.0)


@pytest.mark.parametrize('gap', [1e-9, 1e-4])
def test_only_a_gap_of_rounding_is_closed(gap):
    outline = two_boxes(gap)
    assert outline.area == pytest.approx(4, rel=1e-3)
    assert len(outline.exterior.coords) - 1 <= 8
    with pytest.raises(PartError, match='2 separate pieces'):
        two_boxes(0.5)


@pytest.mark.slow
def test_foil_of_many_triangles_is_seen_from_its_edge():
    # It is thinner than the distance of the samples of the union of many triangles.
    mesh = trimesh.creation.cylinder(radius=1, height=1e-4, sections=3000)
    vertices = Rotation.from_euler('xz', [90, 31], degrees=True).apply(mesh.vertices)
    outline = silhouette(vertices, mesh.faces, closed=True, radius=1.0)
    # Its border of length 4 is rounded to GRID.
    assert outline.area == pytest.approx(2e-4, abs=4 * GRID)


def test_facets_that_meet_within_rounding_are_united(part):
    """Here a union without a grid loses two flanges of 100 mm2, which touch within 1e-16 R."""
    half = [0.48804768005008825, -0.5116731984360005]
    turn = np.array([half[0], half[1], half[1], 0.4880476800500883])
    seen = seen_outline(part('u_bracket'), turn)
    assert seen.area == pytest.approx(600e-6)
