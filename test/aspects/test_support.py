"""Descriptions of what a part rests on, compared with bodies whose sides are known."""

import itertools

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import (
    CORNER,
    EDGE,
    NONE,
    ContactFinder,
    ContactPlane,
    class_of_contacts,
    pose_angles,
    resting_on,
)

TURNED = trimesh.transformations.rotation_matrix(2.1, (0.3, -0.5, 0.81))
TURNED[:3, 3] = 4, -7, 2
create = trimesh.creation


def descriptions(part):
    """What each symmetry class rests on."""
    return sorted(resting_on(part, members[0]) for members in find_aspects(part).classes())


def revolved(*outline):
    """A body of revolution; the outline is (radius, z)."""
    return create.revolve(np.array(outline, dtype=float), sections=64)


def prism(*outline, depth=20):
    return create.extrude_polygon(shapely.Polygon(outline), depth)


def stretched(*factors):
    return create.icosphere(3, 10).apply_scale(factors)


def caltrop():
    """A small tetrahedron with a spike on each of its faces."""
    inner = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) * 3.0
    pairs = [itertools.combinations([j for j in range(4) if j != k], 2) for k in range(4)]
    faces = [(a, b, 4 + k) for k, edges in enumerate(pairs) for a, b in edges]
    mesh = trimesh.Trimesh(np.concatenate([inner, -5 * inner]), faces)
    trimesh.repair.fix_normals(mesh)
    return mesh


HALF_CIRCLE = [(10 * np.cos(a), 10 * np.sin(a)) for a in np.linspace(0, np.pi, 33)]
PIN = revolved((0, 0), (10, 0), (10, 3), (4, 3), (4, 30), (0, 30))
RINGED = revolved((0, 0), (10, 0), (10, 2), (3, 2), (3, 28), (10, 28), (10, 30), (0, 30))
# One of the sides of each body.
SIDES = {
    'cylinder, diameter 8 mm (rolls)': create.cylinder(4, 30, sections=48),
    'cone, diameter 20 mm (rolls)': create.cone(10, 30, sections=64),
    'flat ring, diameter 16 mm': create.annulus(4, 8, 1.6, sections=64),
    'ball, diameter 20 mm (rolls)': create.icosphere(3, 10),
    'dome': stretched(1, 1.3, 1.7),
    'curved side, diameter 20 mm (rolls)': stretched(1, 1, 1.7),
    # The tube of a torus touches the surface in a circle around its hole.
    'ring, diameter 40 mm': create.torus(20, 5),
    'three corners': caltrop(),
    'round flat side, diameter 8 mm': PIN,
    'two rims, diameters 20 and 8 mm (rolls)': PIN,
    'two round sides, diameter 20 mm (rolls)': RINGED,
    # A U, upside down.
    'two flat sides': prism(
        (0, 0), (30, 0), (30, 25), (25, 25), (25, 5), (5, 5), (5, 25), (0, 25)
    ),
    # An L on its leg and its toe: the hull has a side between them that the part has not.
    'two edges': prism((10, 40), (0, 40), (0, 0), (30, 0), (30, 10), (10, 10)),
    # The rectangles along the legs and along the longest side have the same area.
    'flat side 20 x 30 mm': prism((0, 0), (30, 0), (0, 20), depth=40),
    'curved side, radius 10 mm (rocks)': prism(*HALF_CIRCLE, depth=30),
}


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize('expected', SIDES)
def test_what_a_turned_body_rests_on(solid, expected):
    assert expected in descriptions(solid(SIDES[expected].copy().apply_transform(TURNED)))


# -- Contacts of poses with known contacts: a box on a floor, at a wall, and in a corner ----------


FLOOR = ContactPlane('floor', np.array([0.0, 0.0, 1.0]))
WALL = ContactPlane('wall', np.array([0.0, 1.0, 0.0]), 0.01)


@pytest.fixture(scope='module')
def block(solid, solids):
    part = solid(solids.box(10, 20, 30))
    return part, find_aspects(part)


def put(part, turn, *planes):
    """Position at which a turned part touches each of some planes, whose normals are axes."""
    corners = turn.apply(np.array(part.hull_vertices))
    return sum(p.normal * (p.offset - (corners @ p.normal).min()) for p in planes)


def found(block, turn, *planes):
    part, aspects = block
    finder = ContactFinder(part, aspects, [FLOOR, WALL])
    return finder.find(put(part, turn, *planes)[None], turn.as_quat()[None])[0].tolist()


def side(block, turn, plane):
    """The aspect whose down direction is the direction into a plane, in the part frame."""
    down = turn.inv().apply(-plane.normal)
    _, aspects = block
    return max(aspects, key=lambda a: a.down_in_part @ down).id


def test_sides_on_floor_and_wall_are_those_of_the_pose(block):
    for turn in Rotation.create_group('O'):
        expected = [side(block, turn, FLOOR), side(block, turn, WALL)]
        assert found(block, turn, FLOOR, WALL) == expected


def test_a_part_away_from_a_plane_does_not_touch_it(block):
    part, aspects = block
    turn = Rotation.identity()
    beside = ContactPlane('far', WALL.normal, 0.2), ContactPlane('above', FLOOR.normal, 0.2)
    finder = ContactFinder(part, aspects, [FLOOR, *beside])
    contacts = finder.find(put(part, turn, FLOOR)[None], turn.as_quat()[None])[0].tolist()
    assert contacts == [side(block, turn, FLOOR), NONE, NONE]


@pytest.mark.parametrize(
    ('angles', 'contacts'), [((0, 0, 20), ['side', EDGE]), ((20, 30, 40), [CORNER, CORNER])]
)
def test_a_turned_part_leans_with_an_edge_or_a_corner(block, angles, contacts):
    turn = Rotation.from_euler('xyz', angles, degrees=True)
    expected = [side(block, turn, FLOOR) if each == 'side' else each for each in contacts]
    assert found(block, turn, FLOOR, WALL) == expected


def test_margin_of_the_engine_counts_as_contact(block):
    part, aspects = block
    finder = ContactFinder(part, aspects, [FLOOR])
    z = -part.hull_vertices[:, 2].min()
    gaps = np.array([0.0, 0.005, 0.02]) * part.hull_radius
    position = np.stack([np.zeros(3), np.zeros(3), z + gaps], axis=1)
    codes = finder.find(position, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)))[:, 0]
    assert (codes != NONE).tolist() == [True, True, False]


@pytest.mark.slow
def test_class_of_contacts_agrees_with_brute_force(block):
    """Two pairs are in one class if and only if a rotation of the box maps them to each other."""
    _, aspects = block
    down = np.array([a.down_in_part for a in aspects])
    ids = range(1, len(down) + 1)
    # The rotations of a box with three different sides: by half a turn about each axis.
    half_turns = [np.diag(s) for s in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    images = [1 + np.argmax(down @ r.T @ down.T, axis=1) for r in half_turns]
    classes = {pair: class_of_contacts(aspects, pair) for pair in itertools.product(ids, repeat=2)}
    for one, other in itertools.product(classes, repeat=2):
        same = any((m[one[0] - 1], m[one[1] - 1]) == other for m in images)
        assert (classes[one] == classes[other]) == same


@pytest.mark.parametrize('name', ['I', 'D2'])
def test_angle_between_poses_is_the_minimum_over_symmetry(name):
    group = Rotation.identity(1) if name == 'I' else Rotation.create_group(name)
    turns = Rotation.random(20, random_state=3)
    other = Rotation.random(random_state=4)
    expected = np.min([(turns.inv() * other * g).magnitude() for g in group], axis=0)
    angles = pose_angles(turns.as_quat(), other.as_quat(), group.as_matrix(), None)
    np.testing.assert_allclose(angles, expected, atol=1e-7)


def test_rotation_about_a_touched_plane_is_free():
    base = Rotation.random(random_state=5)
    normal = np.array([0.0, 0.6, 0.8])
    turned = Rotation.from_rotvec(np.linspace(0, 3, 7)[:, None] * normal) * base
    angles = pose_angles(turned.as_quat(), base.as_quat(), np.eye(3)[None], normal)
    np.testing.assert_allclose(angles, 0, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize('normal', [None, np.array([0.0, 0.6, 0.8])])
def test_rotations_about_the_axis_of_a_body_of_revolution_are_free(normal):
    axis, flip = np.array([0.6, 0.0, 0.8]), Rotation.from_rotvec([0.0, np.pi, 0.0])
    group = Rotation.concatenate([Rotation.identity(), flip])
    turns, other = Rotation.random(20, random_state=6), Rotation.random(random_state=7)
    rolls = Rotation.from_rotvec(np.linspace(0, 2 * np.pi, 2000)[:, None] * axis)
    about = [Rotation.identity()]
    if normal is not None:
        about = Rotation.from_rotvec(np.linspace(0, 2 * np.pi, 200)[:, None] * normal)
        rolls = rolls[::10]
    expected = [
        min((turn.inv() * n * other * g * rolls).magnitude().min() for g in group for n in about)
        for turn in turns[:3]
    ]
    symmetry = group.as_matrix()
    found = pose_angles(turns[:3].as_quat(), other.as_quat(), symmetry, normal, axis)
    np.testing.assert_allclose(found, expected, atol=4e-2)  # the steps are up to 3.2e-2
