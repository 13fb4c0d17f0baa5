"""Facets of hulls, held to formulas of boxes and to what holds for every convex body."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.facets import COPLANAR_ANGLE, hull_facets

lengths = st.floats(0.05, 20)


def box_corners(a, b, c):
    return np.array([(x, y, z) for x in (-a, a) for y in (-b, b) for z in (-c, c)])


def rectangle_solid_angle(a, b, h):
    """Of a rectangle 2a x 2b seen from the height h over its middle."""
    return 4 * np.arctan(a * b / (h * np.sqrt(a**2 + b**2 + h**2)))


@given(lengths, lengths, lengths)
def test_a_box_has_six_facets_with_the_solid_angles_of_the_formula(a, b, c):
    facets = hull_facets(box_corners(a, b, c))
    found = {tuple(np.round(f.normal).astype(int) + 0): f for f in facets}
    assert len(facets) == len(found) == 6
    for axis, (p, q, h) in enumerate([(b, c, a), (a, c, b), (a, b, c)]):
        for sign in (-1, 1):
            normal = sign * np.eye(3)[axis]
            facet = found[tuple(normal.astype(int))]
            np.testing.assert_allclose(facet.normal, normal, atol=1e-12)
            assert facet.height == pytest.approx(h)
            assert facet.margin == pytest.approx(min(p, q))
            assert facet.solid_angle == pytest.approx(rectangle_solid_angle(p, q, h))
            assert len(facet.polygon) == 4


def test_a_facet_of_several_triangles_has_its_corners_in_order_seen_from_outside():
    for facet in hull_facets(trimesh.creation.cylinder(1, 0.5, sections=9).vertices):
        p = facet.polygon
        turn = np.cross(np.roll(p, -1, axis=0) - p, np.roll(p, -2, axis=0) - np.roll(p, -1, 0))
        assert (turn @ facet.normal > 0).all()
        np.testing.assert_allclose(p @ facet.normal, facet.height)


@given(st.integers(0, 2**32 - 1), st.integers(4, 40))
@settings(deadline=None)
def test_the_solid_angles_of_all_facets_make_the_whole_sphere(seed, n):
    points = np.random.default_rng(seed).standard_normal((n, 3))
    points -= points.mean(axis=0)  # inside the hull
    facets = hull_facets(points)
    assert sum(f.solid_angle for f in facets) == pytest.approx(4 * np.pi)
    assert all(f.height > 0 for f in facets)


@pytest.mark.parametrize(
    'mesh',
    [
        trimesh.creation.cylinder(10, 20, sections=720),  # half a degree from side to side
        trimesh.creation.uv_sphere(1, count=[48, 48]),  # slivers at the poles
        trimesh.creation.icosphere(3),
        trimesh.creation.capsule(20, 5),
    ],
    ids=['cylinder', 'uv_sphere', 'icosphere', 'capsule'],
)
def test_bent_facets_of_a_fine_mesh_still_make_the_whole_sphere(mesh):
    turned = Rotation.from_rotvec([0.3, -1.1, 0.7]).apply(mesh.vertices).astype(np.float32)
    facets = hull_facets(turned.astype(np.float64))
    assert sum(f.solid_angle for f in facets) == pytest.approx(4 * np.pi)


def test_a_facet_grows_from_its_largest_triangle_and_does_not_creep_round_a_cylinder():
    # 400 sides, 0.9 degrees apart: each within the angle of its neighbours, of no others.
    facets = hull_facets(trimesh.creation.cylinder(10, 20, sections=400).vertices)
    sides = [f for f in facets if abs(f.normal[2]) < 0.5]
    assert 400 / 3 <= len(sides) <= 400
    # At most a side and its two neighbours, which stand on 4 lines.
    assert max(len(f.polygon) for f in sides) <= 8


@pytest.mark.parametrize(('angle', 'facets'), [(0.999, 1), (1.001, 2)])
def test_triangles_are_one_facet_below_the_angle_and_two_above(angle, facets):
    # A pyramid whose floor, a square of side 2, is bent upward along the y axis.
    bend = angle * COPLANAR_ANGLE
    flat = [(0, -1, 0), (0, 1, 0), (1, -1, 0), (1, 1, 0)]
    bent = [(-np.cos(bend), y, np.sin(bend)) for y in (-1, 1)]
    found = hull_facets(np.array([*flat, *bent, (0, 0, 2)]) - [0, 0, 0.5])
    assert len([f for f in found if f.normal[2] < -0.9]) == facets


def test_the_margin_is_the_distance_to_the_nearest_edge_and_negative_outside():
    # A right triangle with legs 3 and 4 under an apex; the inscribed circle has radius 1.
    corners = np.array([(0, 0, 0), (3, 0, 0), (0, 4, 0), (1, 1, 5)], dtype=float)

    def margin(x, y):
        below = [f for f in hull_facets(corners - [x, y, 0.1]) if f.normal[2] < -0.99]
        assert len(below) == 1
        return below[0].margin

    assert margin(1, 1) == pytest.approx(1)
    assert margin(0.5, 1) == pytest.approx(0.5)
    assert margin(1, 0) == pytest.approx(0, abs=1e-12)
    assert margin(1, -0.25) == pytest.approx(-0.25)
    assert margin(3 / 2 + 0.4, 4 / 2 + 0.3) == pytest.approx(-0.5)  # along (4, 3) / 5, off 3-4-5


def test_a_bent_facet_has_the_normal_of_the_triangle_on_which_the_part_comes_to_rest():
    # A roof of 0.6 degrees under the part: its two halves are one facet, and the centre of mass
    # is over the smaller one, which is the one that the part stands on.
    slope = np.radians(0.6)
    corners = [(-2, y, 2 * np.tan(slope)) for y in (-1, 1)]
    corners += [(0, y, 0) for y in (-1, 1)]
    corners += [(0.8, y, 0) for y in (-1, 1)]
    corners += [(x, y, 2) for x in (-2, 0.8) for y in (-1, 1)]
    below = [f for f in hull_facets(np.array(corners) - [0.4, 0, 1]) if f.normal[2] < -0.9]
    assert len(below) == 1
    np.testing.assert_allclose(below[0].normal, [0, 0, -1], atol=1e-12)
    assert below[0].height == pytest.approx(1)


def test_facets_leave_the_vertices_alone():
    vertices = box_corners(1, 2, 3)
    before = vertices.copy()
    vertices.setflags(write=False)
    hull_facets(vertices)
    np.testing.assert_array_equal(vertices, before)
