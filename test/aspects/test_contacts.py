"""Contacts of poses with known contacts: a box on a floor, at a wall, and in a corner."""

import itertools

import numpy as np
import pytest
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
)

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
    position = put(part, turn, *planes) if planes else np.array([0.0, 1.0, 1.0])
    return finder.find(position[None], turn.as_quat()[None])[0].tolist()


def side(block, turn, plane):
    """The aspect whose down direction is the direction into a plane, in the part frame."""
    down = turn.inv().apply(-plane.normal)
    _, aspects = block
    return max(aspects.aspects, key=lambda a: a.down_in_part @ down).id


def test_sides_on_floor_and_wall_are_those_of_the_pose(block):
    for turn in Rotation.create_group('O'):
        expected = [side(block, turn, FLOOR), side(block, turn, WALL)]
        assert found(block, turn, FLOOR, WALL) == expected


def test_a_part_away_from_a_plane_does_not_touch_it(block):
    turn = Rotation.identity()
    assert found(block, turn) == [NONE, NONE]
    far = ContactPlane('far', WALL.normal, 0.2)
    assert found(block, turn, FLOOR, far) == [side(block, turn, FLOOR), NONE]


def test_a_part_turned_about_the_vertical_leans_with_an_edge(block):
    turn = Rotation.from_euler('z', 20, degrees=True)
    assert found(block, turn, FLOOR, WALL) == [side(block, turn, FLOOR), EDGE]


def test_a_part_without_a_parallel_edge_leans_with_a_corner(block):
    turn = Rotation.from_euler('xyz', [20, 30, 40], degrees=True)
    assert found(block, turn, FLOOR, WALL) == [CORNER, CORNER]


def test_margin_of_the_engine_counts_as_contact(block):
    part, aspects = block
    finder = ContactFinder(part, aspects, [FLOOR])
    z = -part.hull_vertices[:, 2].min()
    gaps = np.array([0.0, 0.005, 0.02]) * part.hull_radius
    position = np.stack([np.zeros(3), np.zeros(3), z + gaps], axis=1)
    codes = finder.find(position, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)))[:, 0]
    assert (codes != NONE).tolist() == [True, True, False]


def test_class_of_contacts_agrees_with_brute_force(block):
    """Two pairs are in one class if and only if a rotation of the box maps them to each other."""
    _, aspects = block
    down = np.array([a.down_in_part for a in aspects.aspects])
    ids = range(1, len(down) + 1)
    # The rotations of a box with three different sides: by half a turn about each axis.
    half_turns = [np.diag(s) for s in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    images = [1 + np.argmax(down @ r.T @ down.T, axis=1) for r in half_turns]
    pairs = list(itertools.product(ids, repeat=2))
    for one, other in itertools.product(pairs, repeat=2):
        same = any((m[one[0] - 1], m[one[1] - 1]) == other for m in images)
        classes = class_of_contacts(aspects, one), class_of_contacts(aspects, other)
        assert (classes[0] == classes[1]) == same


def test_angle_between_poses_is_that_of_the_rotation_between_them():
    turns = Rotation.random(20, random_state=1)
    other = Rotation.random(random_state=2)
    expected = (turns.inv() * other).magnitude()
    angles = pose_angles(turns.as_quat(), other.as_quat(), np.eye(3)[None], None)
    np.testing.assert_allclose(angles, expected, atol=1e-7)


def test_angle_between_poses_is_the_minimum_over_symmetry():
    group = Rotation.create_group('D2')
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
