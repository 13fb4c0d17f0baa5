"""The symmetry of parts, held to geometry: groups that anybody can count on the solid."""

from itertools import product

import numpy as np
import pytest
import solids
import trimesh
from scipy.spatial import KDTree
from shapely.geometry import Polygon
from trimesh.creation import box, cylinder, extrude_polygon, icosphere, revolve

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.symmetry import find_symmetry

NO_LANDMARKS = np.zeros((0, 3))
TURN = solids.a_turn(8)


def hull(points):
    return trimesh.convex.convex_hull(np.array(points, dtype=float) * 10)


def circle(radius, sides, centre=(0.0, 0.0), phase=0.0):
    angle = 2 * np.pi * np.arange(sides) / sides + phase
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius + centre


def plate(outline, height, holes=(), depth=None):
    """A plate with holes, through or to a depth from the top; mm."""
    if depth is None:
        return extrude_polygon(Polygon(outline, holes), height)
    pockets = [extrude_polygon(Polygon(hole), depth + 1) for hole in holes]
    for pocket in pockets:
        pocket.apply_translation((0, 0, height - depth))
    whole = extrude_polygon(Polygon(outline), height)
    return trimesh.boolean.difference([whole, *pockets], engine='manifold')


def around(mesh_radius, count, size, sides=24, phase=0.3):
    """Circles on a circle."""
    return [circle(size, sides, c) for c in circle(mesh_radius, count, phase=phase)]


def cut_corner(size):
    """A cube of 9 without one corner, so that only the turns about that diagonal are left."""
    points = [p for p in product((0.0, 0.9), repeat=3) if p != (0.9, 0.9, 0.9)]
    return hull([*points, *(0.9 - size * np.eye(3)[i] for i in range(3))])


def threaded_nut():
    """M3, with a helical V groove in the wall of its hole."""
    height, pitch, minor, depth = 2.4, 0.5, 1.23, 0.27
    levels = np.arange(-pitch, height + 2 * pitch, pitch / 6)
    profile = [(0, levels[0]), *((minor, z) for z in levels), (0, levels[-1])]
    screw = revolve(profile, sections=36)
    x, y, z = screw.vertices.T
    turns = (z - height / 2) / pitch - np.arctan2(y, x) / (2 * np.pi)
    screw.vertices[:, :2] *= 1 + depth / minor * np.abs(2 * (turns[:, None] % 1) - 1)
    nut = plate(circle(5.5 / np.sqrt(3), 6), height)
    return trimesh.boolean.difference([nut, screw], engine='manifold')


def blunt_prism():
    """The ends of a hexagonal prism are pyramids whose slopes are joined to one side."""
    rise = 10 + 5 * np.sqrt(3) * np.tan(np.radians(1.5))
    rim = [(x, y, z) for x, y in circle(1, 6) for z in (-1, 1)]
    return hull([*rim, (0, 0, rise / 10), (0, 0, -rise / 10)])


def uneven(radius, sides, centre=(0.0, 0.0), seed=0):
    """A circle with vertices at uneven distances."""
    shift = np.random.default_rng(seed).uniform(-0.3, 0.3, sides)
    angle = 2 * np.pi * (np.arange(sides) + shift) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius + centre


FINITE = {
    'cube': (lambda: box((9, 9, 9)), 24),
    'cube_with_a_cut_corner': (lambda: cut_corner(0.1), 3),
    'icosahedron': (trimesh.creation.icosahedron, 60),
    'nearly_round_ellipsoid': (lambda: solids.ellipsoid(10, 9.9, 9.8, 3), 4),
    'irregular': (lambda: solids.irregular(3), 1),
    'disc_with_small_pocket': (lambda: plate(circle(10, 64), 5, around(5, 1, 0.2), 0.5), 1),
    'disc_with_three_pockets': (lambda: plate(circle(10, 64), 5, around(5, 3, 2), 2), 3),
    'disc_with_eight_holes': (lambda: plate(circle(10, 90), 5, around(7, 8, 1)), 16),
    'ratchet': (lambda: solids.ratchet(20), 20),
    'prism_7': (lambda: plate(circle(10, 7), 11), 14),
    'blunt_prism': (blunt_prism, 12),
}
AXIAL = {
    'disc_16': (lambda: cylinder(10, 2, sections=16), 2),
    'cylinder_of_like_moments': (lambda: cylinder(10, 20 * 0.9, sections=32), 2),
    # So fine that the strips beside its top and bottom are rings, flat but for noise.
    'ring_20_400': (lambda: trimesh.creation.torus(10, 3, 20, 400), 2),
    'cup': (lambda: plate(circle(10, 48), 12, [circle(7, 40)], 6), 1),
    'nearly_round_ellipsoid': (lambda: solids.ellipsoid(10, 10, 9.9, 3), 2),
}
SPHERES = {'ico': icosphere(1, 10), 'uv': trimesh.creation.uv_sphere(10, (20, 40))}


def found(symmetry):
    return symmetry.kind, symmetry.order


def assert_is_group(symmetry):
    """The rotations are closed, differ, and begin with the identity."""
    rotations = symmetry.rotations
    assert rotations.shape == (symmetry.order, 3, 3)
    np.testing.assert_array_equal(rotations[0], np.eye(3))
    np.testing.assert_allclose(np.linalg.det(rotations), 1, atol=1e-12)
    products = (rotations[:, None] @ rotations[None]).reshape(-1, 9)
    likeness = products @ rotations.reshape(-1, 9).T  # 3 for the same rotation
    assert likeness.max(axis=1).min() == pytest.approx(3, abs=1e-9)
    np.testing.assert_array_equal(np.bincount(likeness.argmax(axis=1)), symmetry.order)


def assert_maps_corners(part, rotations):
    """Each corner of the hull of a part comes to lie on a corner."""
    points = part.hull_vertices - part.centre_of_mass
    apart, _ = KDTree(points).query(points @ rotations.transpose(0, 2, 1))
    assert apart.max() < 1e-4 * part.hull_radius


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', FINITE)
def test_order_of_finite_groups(solid, name):
    make, order = FINITE[name]
    symmetry = find_aspects(solid(solids.turned(make(), TURN, (30, -50, 7)))).symmetry
    assert found(symmetry) == ('finite', order)
    assert symmetry.axis is None
    assert_is_group(symmetry)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', AXIAL)
def test_body_of_revolution_is_axial_for_any_number_of_sides(solid, name):
    make, order = AXIAL[name]
    symmetry = find_aspects(solid(solids.turned(make(), TURN, (30, -50, 7)))).symmetry
    assert found(symmetry) == ('axial', order)
    assert abs(symmetry.axis @ TURN[:, 2]) == pytest.approx(1, abs=1e-6)
    # The other half of the group turns the axis round.
    np.testing.assert_allclose(
        symmetry.rotations @ symmetry.axis, [symmetry.axis, -symmetry.axis][:order], atol=1e-12
    )


@pytest.mark.slow
def test_shaft_with_a_flat_is_no_body_of_revolution(solid):
    """The flat is as wide as two or three of the flats that the mesh makes of the round side."""
    aspects = find_aspects(solid(solids.d_shaft(32, 9.7)))
    assert found(aspects.symmetry) == ('finite', 2)  # it can be turned end over end
    assert len(aspects.classes()) == 3


L_PROFILE = [(0, 0), (2, 0), (2, 0.4), (0.4, 0.4), (0.4, 1.2), (0, 1.2)]
SLENDER = {
    'strip_1000': (lambda: box((1000, 1, 0.1)), 4, [1, 1, 2, 2]),
    'l_profile': (lambda: plate(L_PROFILE, 300), 1, [1, 2, 3]),
    'coarse_fillets': (lambda: solids.filleted_box((10, 10, 50), 3, 2), 8, [1, 1, 1, 1, 2, 2]),
}


@pytest.mark.slow
@pytest.mark.parametrize('name', SLENDER)
def test_sides_of_slender_parts_are_alike_only_if_they_are_equal(solid, name):
    make, order, classes = SLENDER[name]
    aspects = find_aspects(solid(solids.turned(make(), solids.a_turn(1))))
    assert found(aspects.symmetry) == ('finite', order)
    assert [a.symmetry_class for a in aspects] == classes


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', SPHERES)
def test_ball_is_spherical_for_any_mesh(solid, name):
    assert found(find_aspects(solid(SPHERES[name])).symmetry) == ('spherical', 1)


@pytest.mark.slow
def test_group_is_found_without_flat_sides_as_landmarks(solid):
    make, order = FINITE['cube_with_a_cut_corner']
    part = solid(make())
    symmetry = find_symmetry(part, NO_LANDMARKS)
    assert found(symmetry) == ('finite', order)
    assert_maps_corners(part, symmetry.rotations)


@pytest.mark.parametrize(('name', 'order'), [
    ('l_bracket', 1),  # its arms are 40 and 30 long; a mirror plane is not a rotation
    ('t_prism', 2), ('box_10x20x30', 4), ('hex_nut', 12), ('tetrahedron', 12),
])  # fmt: skip
def test_groups_of_the_example_parts(part, name, order):
    shape = part(name)
    symmetry = find_aspects(shape).symmetry
    assert found(symmetry) == ('finite', order)
    assert_maps_corners(shape, symmetry.rotations)


@pytest.mark.slow
def test_the_vertices_of_round_faces_need_no_symmetry_of_their_own(solid):
    holes = [uneven(2, 30, c, seed) for seed, c in enumerate(circle(5, 3))]
    part = solid(plate(uneven(10, 64), 3, holes))
    assert found(find_symmetry(part, NO_LANDMARKS)) == ('finite', 6)
    part = solid(plate(uneven(10, 48), 15))
    assert found(find_symmetry(part, NO_LANDMARKS)) == ('axial', 2)


@pytest.mark.parametrize(
    ('centre', 'expected'), [((0, 0, 3e-3), ('axial', 1)), ((3e-3, 0, 0), ('finite', 2))]
)
def test_group_preserves_the_given_centre_of_mass(solid, centre, expected):
    part = solid(cylinder(10, 20, sections=64), centre_of_mass=centre)
    assert found(find_aspects(part).symmetry) == expected


def test_a_mesh_that_is_not_closed_has_the_symmetry_of_its_surface(solid):
    tube = cylinder(10, 16, sections=48)
    tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    given = {'mass': 0.01, 'centre_of_mass': (0, 0, 0), 'inertia': (5e-7, 0, 0, 5e-7, 0, 6e-7)}
    assert found(find_symmetry(solid(tube, **given), NO_LANDMARKS)) == ('axial', 2)


@pytest.mark.slow
def test_modelled_thread_keeps_the_sides_of_a_hexagon_in_one_class(solid):
    part = solid(threaded_nut())
    assert not np.isnan(part.volume)
    aspects = find_aspects(part)
    assert sorted(len(members) for members in aspects.classes()) == [2, 6]
    assert_is_group(aspects.symmetry)


@pytest.mark.slow
@pytest.mark.parametrize(('depth', 'sizes'), [(0.05, [1, 1, 4]), (0.01, [2, 4])])
def test_pocket_keeps_a_side_apart_and_an_engraving_does_not(solid, depth, sizes):
    square, pocket = (circle(r, 4, phase=np.pi / 4) for r in (10, 1))
    part = solid(plate(square, 8, [pocket], depth * np.hypot(10, 4)))  # in R
    classes = find_aspects(part).classes()
    assert sorted(len(members) for members in classes) == sizes


@pytest.mark.slow
@pytest.mark.parametrize(('share', 'classes'), [(0.99, [2, 4]), (1.001, [6])])
def test_one_percent_of_a_length_splits_the_sides_of_a_cube(solid, share, classes):
    aspects = find_aspects(solid(box((10, 10, 10 * share))))
    assert sorted(len(members) for members in aspects.classes()) == classes
