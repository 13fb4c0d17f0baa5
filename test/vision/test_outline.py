"""Outlines against areas in closed form, a test of single points, and Cauchy's mean area."""

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.vision.outline import GRID, find_outlines, seen_outline, silhouette

LEVEL = np.array([0, 0, 0, 1.0])
seeds = st.integers(0, 2**32 - 1)
few = settings(
    max_examples=settings.default.max_examples // 5,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def quaternion(seed):
    return Rotation.from_quat(np.random.default_rng(seed).standard_normal(4)).as_quat()


def moved(mesh, seed):
    generator = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(generator.standard_normal(4)).as_matrix()
    pose[:3, 3] = generator.uniform(-50, 50, 3)
    return mesh.copy().apply_transform(pose)


def extruded(polygon, height):
    """A prism of a polygon with holes, mm."""
    flat = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corners = np.array([shapely.get_coordinates(each)[:3] for each in flat])
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, ac = b - a, c - a
    flip = ab[:, 0] * ac[:, 1] < ab[:, 1] * ac[:, 0]
    corners[flip] = corners[flip][:, ::-1]
    ends = [np.dstack([corners, np.full(corners.shape[:2], z)]) for z in (0.0, height)]
    ends[0] = ends[0][:, ::-1]
    for ring in shapely.get_rings(shapely.geometry.polygon.orient(polygon)):
        points = shapely.get_coordinates(ring)
        low = np.column_stack([points, np.zeros(len(points))])
        high = low + np.array([0, 0, height])
        ends.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        ends.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    triangles = np.concatenate(ends).reshape(-1, 3)
    return trimesh.Trimesh(triangles, np.arange(len(triangles)).reshape(-1, 3))


def circle(sides, radius=10.0, centre=(0.0, 0.0), phase=0.1):
    angle = 2 * np.pi * np.arange(sides) / sides + phase
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius + centre


def gear(teeth):
    angle = 2 * np.pi * np.arange(4 * teeth) / (4 * teeth)
    radius = np.tile([9.0, 10.0, 10.0, 9.0], teeth)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def ratchet(teeth):
    angle = 2 * np.pi * np.repeat(np.arange(teeth), 2) / teeth
    return np.tile([8.0, 10.0], teeth)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


L_SHAPE = [(0, 0), (30, 0), (30, 8), (8, 8), (8, 18), (0, 18)]
# Polygon, yaw symmetry, whether it has a mirror axis.
SHAPES = {
    'triangle': (shapely.Polygon(circle(3)), 3, True),
    'hexagon': (shapely.Polygon(circle(6)), 6, True),
    'rectangle': (shapely.box(0, 0, 30, 12), 2, True),
    'nearly_square': (shapely.box(0, 0, 30, 29), 2, True),
    'circle_32': (shapely.Polygon(circle(32)), 0, True),
    'ring': (shapely.Polygon(circle(40), [circle(24, 5.0)]), 0, True),
    'three_holes': (
        shapely.Polygon(circle(40), [circle(16, 2.0, c) for c in circle(3, 5.0)]),
        3,
        True,
    ),
    'two_unequal_holes': (
        shapely.Polygon(circle(40), [circle(16, 2.0, (5, 0)), circle(16, 1.0, (0, 5))]),
        1,
        False,
    ),
    'gear': (shapely.Polygon(gear(20)), 20, True),
    'ratchet': (shapely.Polygon(ratchet(12)), 12, False),
    'l': (shapely.Polygon(L_SHAPE), 1, False),
    'equal_l': (shapely.Polygon([(0, 0), (30, 0), (30, 8), (8, 8), (8, 30), (0, 30)]), 1, True),
    's': (
        shapely.Polygon(
            [(0, 0), (20, 0), (20, 16), (34, 16), (34, 22), (14, 22), (14, 6), (0, 6)]
        ),
        2,
        False,
    ),
}


def flat_outline(part):
    """The outline of the aspect on the largest flat side of a prism."""
    outlines = find_outlines(part, find_aspects(part))
    return min(outlines, key=lambda each: each.height)


def inside(points, polygon):
    """Return whether points are inside rings, by the number of crossings of a ray."""
    count = np.zeros(len(points), dtype=int)
    for ring in (polygon.exterior, *polygon.interiors):
        a = np.array(ring.coords)[:-1]
        b = np.roll(a, -1, axis=0)
        x, y = points[:, :1], points[:, 1:]
        across = (a[:, 1] <= y) != (b[:, 1] <= y)
        at = a[:, 0] + (y - a[:, 1]) * (b - a)[:, 0] / np.where(across, (b - a)[:, 1], 1.0)
        count += (across & (at > x)).sum(axis=1)
    return count % 2 == 1


def covered(points, triangles):
    """Return whether points are in any of the triangles (m, 3, 2)."""
    sides = []
    for k in range(3):
        a, b = triangles[:, k], triangles[:, (k + 1) % 3]
        ab, ap = b - a, points[:, None] - a
        sides.append(ab[:, 0] * ap[..., 1] - ab[:, 1] * ap[..., 0])
    low, high = np.min(sides, axis=0), np.max(sides, axis=0)
    return ((low >= 0) | (high <= 0)).any(axis=1)


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


def test_measures_of_a_box_and_its_origin(part):
    outlines = find_outlines(part('box_10x20x30'), find_aspects(part('box_10x20x30')))
    found = [(o.length, o.width, o.height, o.com_height, o.area) for o in outlines]
    expected = [
        (0.03, 0.02, 0.01, 0.005, 6e-4),
        (0.03, 0.01, 0.02, 0.01, 3e-4),
        (0.02, 0.01, 0.03, 0.015, 2e-4),
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert [o.aspects for o in outlines] == [(1, 2), (3, 4), (5, 6)]
    assert [o.aspect for o in outlines] == [1, 3, 5]
    for outline in outlines:
        np.testing.assert_allclose(outline.centroid, 0, atol=1e-8)


@pytest.mark.parametrize('angle', [35.0, 179.0])
def test_long_axis_is_the_direction_of_the_length(solid, angle):
    mesh = trimesh.creation.box((30, 12, 5))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(angle), (0, 0, 1)))
    outline = flat_outline(solid(mesh))
    x, y = Rotation.from_quat(outline.orientation).apply(
        [np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0]
    )[:2]
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
    points = np.random.default_rng(seed).uniform(low, high, (1500, 2))
    differ = covered(points, triangles) != inside(points, outline)
    near = shapely.distance(outline.boundary, shapely.points(points[differ]))
    assert (near < 3e-5 * shape.hull_radius).all()


def test_undercut_hides_nothing(solid):
    # A T on its foot: the outline is that of its wide top.
    profile = [(-4, 0), (4, 0), (4, 10), (10, 10), (10, 14), (-10, 14), (-10, 10), (-4, 10)]
    part = solid(extruded(shapely.Polygon(profile), 12))
    upright = Rotation.from_euler('xy', [90, 30], degrees=True)
    x = np.array(profile) @ [np.cos(np.radians(30)), np.sin(np.radians(30))]
    outline = seen_outline(part, upright.as_quat())
    assert outline.area == pytest.approx(np.ptp(x) * 12e-6, rel=1e-5)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', SHAPES)
def test_symmetries_and_area_of_prisms(solid, name):
    polygon, order, mirror = SHAPES[name]
    outline = flat_outline(solid(extruded(polygon, 3)))
    assert (outline.yaw_symmetry, outline.mirror_symmetric) == (order, mirror)
    assert outline.area == pytest.approx(polygon.area * 1e-6, rel=1e-5)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', ['l', 'three_holes'])
def test_outline_does_not_depend_on_frame_and_subdivision(solid, name):
    polygon, order, mirror = SHAPES[name]
    outline = flat_outline(solid(moved(extruded(polygon, 3).subdivide(), 2)))
    assert (outline.yaw_symmetry, outline.mirror_symmetric) == (order, mirror)
    assert outline.area == pytest.approx(polygon.area * 1e-6, rel=1e-5)
    assert len(outline.polygon.interiors) == len(polygon.interiors)
    # A tilt by rounding can show both ends of a few edges.
    more = shapely.get_num_coordinates(outline.polygon) - shapely.get_num_coordinates(polygon)
    assert 0 <= more <= 16


@pytest.mark.slow
def test_noise_of_a_scan_leaves_one_outline_with_its_hole(solid):
    ring = shapely.Polygon(circle(100), [circle(70, 5.0)])
    mesh = extruded(ring, 3).subdivide()
    noise = np.random.default_rng(4).uniform(-1e-2, 1e-2, mesh.vertices.shape)
    mesh.vertices = mesh.vertices + noise
    outline = flat_outline(solid(moved(mesh, 1)))
    assert len(outline.polygon.interiors) == 1
    assert outline.area == pytest.approx(ring.area * 1e-6, rel=3e-3)
    assert outline.yaw_symmetry == 0


@pytest.mark.slow
def test_round_part_that_rolls_has_no_family(part, solid):
    coarse = trimesh.creation.cylinder(10, 50, sections=16)
    ball = solid(trimesh.creation.icosphere(3, 10))
    for shape in (part('cylinder_d20_h20'), solid(coarse), ball):
        outlines = find_outlines(shape, find_aspects(shape))
        assert [o.family for o in outlines] == [()] * len(outlines)
    assert [o.yaw_symmetry for o in outlines] == [0]


@pytest.mark.slow
def test_cross_hole_appears_in_the_family_of_a_roller(solid):
    # A bar of 24 sides with a slot: only in some directions is the slot seen through.
    slot = shapely.Polygon(circle(24), [])
    ends = [extruded(slot, 12).apply_translation((0, 0, z)) for z in (0, 18)]
    halves = [shapely.intersection(slot, shapely.box(-11, y, 11, y + 8)) for y in (2.0, -10.0)]
    middle = [extruded(half, 6).apply_translation((0, 0, 12)) for half in halves]
    shape = solid(trimesh.boolean.union([*ends, *middle], engine='manifold'))
    aspects = find_aspects(shape)
    outlines = [o for o in find_outlines(shape, aspects) if o.family]
    assert outlines
    holes = {len(each.interiors) for o in outlines for each in (o.polygon, *o.family)}
    assert holes == {0, 1}


def box_faces(skipped=()):
    mesh = trimesh.creation.box((2, 1, 1))
    keep = [k for k, n in enumerate(mesh.face_normals) if tuple(np.round(n)) not in skipped]
    return np.array(mesh.vertices), np.array(mesh.faces)[keep]


def test_mesh_without_top_or_inside_out_has_the_same_silhouette():
    vertices, faces = box_faces({(0, 0, 1)})
    for each in (faces, faces[:, ::-1]):
        outline = silhouette(vertices, each, closed=False, radius=1.2)
        assert outline.symmetric_difference(shapely.box(-1, -0.5, 1, 0.5)).area < 1e-8


@pytest.mark.parametrize('gap', [1e-9, 1e-4])
def test_gap_of_rounding_is_closed(gap):
    vertices, faces = box_faces()
    both = np.concatenate([vertices, vertices + np.array([2 + gap, 0, 0])])
    outline = silhouette(both, np.concatenate([faces, faces + len(vertices)]), True, 2.0)
    assert outline.area == pytest.approx(4, rel=1e-3)
    assert len(outline.exterior.coords) - 1 <= 8


@pytest.mark.slow
def test_foil_of_many_triangles_is_seen_from_its_edge():
    # It is thinner than the distance of the samples of the union of many triangles.
    mesh = trimesh.creation.cylinder(radius=1, height=1e-4, sections=3000)
    turned = Rotation.from_euler('xz', [90, 31], degrees=True).apply(mesh.vertices)
    outline = silhouette(turned, mesh.faces, closed=True, radius=1.0)
    # Its border of length 4 is rounded to GRID.
    assert outline.area == pytest.approx(2e-4, abs=4 * GRID)


def test_separate_pieces_are_refused():
    vertices, faces = box_faces()
    both = np.concatenate([vertices, vertices + np.array([2.5, 0, 0])])
    with pytest.raises(PartError, match='2 separate pieces'):
        silhouette(both, np.concatenate([faces, faces + len(vertices)]), True, 2.0)


def test_sheet_seen_from_its_edge_is_refused():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1.0]])
    with pytest.raises(PartError, match='from its edge'):
        silhouette(vertices, np.array([[0, 1, 2], [0, 2, 3]]), False, 1.0)


def test_facets_that_meet_within_rounding_are_united(part):
    """Here a union without a grid loses two flanges of 100 mm2, which touch within 1e-16 R."""
    half = [0.48804768005008825, -0.5116731984360005]
    seen = seen_outline(
        part('u_bracket'), np.array([half[0], half[1], half[1], 0.4880476800500883])
    )
    assert seen.area == pytest.approx(600e-6)


@pytest.mark.slow
def test_slightly_stretched_circle_is_round(solid):
    mesh = trimesh.creation.cylinder(radius=10, height=5, sections=200)
    mesh.apply_scale([1, 1.0015, 1])
    assert flat_outline(solid(mesh)).yaw_symmetry == 0


def test_rings_have_their_directions_and_holes(part):
    outline = flat_outline(part('washer'))
    assert outline.polygon.is_valid
    assert outline.polygon.exterior.is_ccw
    assert [ring.is_ccw for ring in outline.polygon.interiors] == [False]
    # Regular polygons of 64 corners, with the radii of the washer.
    sector = 32 * np.sin(2 * np.pi / 64)
    assert outline.area == pytest.approx(sector * (8e-3**2 - 4.2e-3**2), rel=2e-2)


def test_outline_agrees_with_the_orientation_of_its_aspect(part):
    shape = part('l_bracket')
    aspects = find_aspects(shape)
    for outline in find_outlines(shape, aspects):
        orientation = aspects[outline.aspect - 1].orientation
        np.testing.assert_array_equal(outline.orientation, orientation)
        points = projected(shape, orientation).reshape(-1, 2)
        low, high = points.min(axis=0), points.max(axis=0)
        np.testing.assert_allclose(outline.polygon.bounds, [*low, *high], atol=1e-7)


@pytest.mark.slow
def test_no_pinholes_in_a_fine_mesh_seen_at_an_angle(solid):
    mesh = trimesh.creation.torus(10, 3, major_sections=64, minor_sections=32)
    shape = solid(moved(mesh, 5))
    for seed in range(5):
        outline = seen_outline(shape, quaternion(seed))
        assert outline.is_valid
        assert len(outline.interiors) <= 1
