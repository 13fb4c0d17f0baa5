"""Parts with two equal moments of inertia: their frames and ids turn with the part."""

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import a_turn, turned

from resting_aspects_ros.aspects.aspect_set import POSE_ANGLE
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.mass import symmetric_top_axes

SEEDS = st.integers(0, 2**32 - 1)
MOMENTS = np.array([1.0, 1.0, 2.0])


def pinwheel(arms, height=6.0):
    """A hub with bent arms: an axis of symmetry, and no mirror plane through it."""
    arm = shapely.union_all([shapely.box(-2, 0, 2, 20), shapely.box(-2, 16, 9, 20)])
    turns = [shapely.affinity.rotate(arm, 360 * k / arms, origin=(0, 0)) for k in range(arms)]
    return trimesh.creation.extrude_polygon(
        shapely.union_all([shapely.Point(0, 0).buffer(6, 2 * arms), *turns]), height
    )


def ratchet(teeth=12):
    """A wheel with saw teeth: its lowest moment has the order of the teeth."""
    angle = 2 * np.pi * np.arange(2 * teeth) / (2 * teeth)
    angle[1::2] = angle[::2] + 0.05 / teeth
    radius = np.tile([14.0, 20.0], teeth)
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return trimesh.creation.extrude_polygon(shapely.Polygon(outline), 5)


def disphenoid():
    """Rotoreflection by 90 degrees: its upper half is the lower one, mirrored and turned."""
    upper = np.array([[12.0, 3, 10], [-12, -3, 10], [9, -8, 4], [-9, 8, 4]])
    x, y, z = upper.T
    return trimesh.convex.convex_hull(np.concatenate([upper, np.stack([-y, x, -z], axis=1)]))


BODIES = {
    'pinwheel of 3': lambda: pinwheel(3),
    'disphenoid': disphenoid,
    'pinwheel of 4': lambda: pinwheel(4),
    'ratchet': ratchet,
}


def assert_same_ids(found, expected, turn):
    """Aspects of one class may change places: a rotation of the part maps them onto each other."""
    assert len(found) == len(expected)
    for a, b in zip(expected.aspects, found.aspects, strict=True):
        assert (b.symmetry_class, b.multiplicity) == (a.symmetry_class, a.multiplicity)
        ids, angles = found.locate(found.symmetry.rotations @ (turn @ a.down_in_part))
        assert b.id in ids[angles <= POSE_ANGLE]


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize('name', BODIES)
def test_rotation_and_remeshing_keep_the_ids(solid, name):
    mesh = BODIES[name]()
    plain = find_aspects(solid(mesh))
    turn = a_turn(0)
    assert_same_ids(find_aspects(solid(turned(mesh, turn, (300, -80, 20)))), plain, turn)
    half = np.diag([1.0, -1.0, -1.0])
    assert_same_ids(find_aspects(solid(turned(mesh.subdivide(), half))), plain, half)


def test_faces_of_a_pinwheel_are_two_classes(solid):
    """The mirror image has the faces in the other order: it is the part turned over."""
    mesh = pinwheel(4)
    mirrored = trimesh.Trimesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1], process=False)
    one, other = (
        [a.down_in_part[2] for a in find_aspects(solid(m)).aspects if abs(a.down_in_part[2]) > 0.9]
        for m in (mesh, mirrored)
    )
    assert sorted(one) == pytest.approx([-1, 1])
    assert other == pytest.approx(np.negative(one))


@given(turn=SEEDS, arbitrary=st.floats(0, 2 * np.pi), flip=st.booleans(), arms=st.integers(3, 6))
def test_frame_turns_with_the_part(turn, arbitrary, flip, arms):
    """Up to the rotations of the part, for any axes in the plane of the equal moments."""
    mesh = pinwheel(arms)
    vertices = mesh.vertices - mesh.center_mass
    radius = np.linalg.norm(vertices, axis=1).max()
    volume = mesh.volume / radius**3
    plain = symmetric_top_axes(vertices / radius, mesh.faces, volume, MOMENTS, np.eye(3))
    matrix = a_turn(turn)
    about = Rotation.from_rotvec([0, 0, arbitrary]).as_matrix() @ np.diag(
        [1.0, -1.0, -1.0] if flip else [1.0, 1.0, 1.0]
    )
    found = symmetric_top_axes(
        vertices / radius @ matrix.T, mesh.faces, volume, MOMENTS, matrix @ about
    )
    relative = plain.T @ matrix.T @ found
    angle = np.arctan2(relative[1, 0], relative[0, 0]) * arms / (2 * np.pi)
    np.testing.assert_allclose(relative[:, 2], [0, 0, 1], atol=1e-9)
    assert angle == pytest.approx(round(angle), abs=1e-6)
    assert np.linalg.det(found) == pytest.approx(1)


def test_frame_is_the_nearest_of_equivalent_ones():
    """A square prism has eight frames, which are along its diagonals or along its sides."""
    mesh = trimesh.creation.box((2, 2, 1))
    for axes in (np.eye(3), np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])):
        found = symmetric_top_axes(mesh.vertices / 1.5, mesh.faces, 4 / 1.5**3, MOMENTS, axes)
        along = axes.T @ found
        assert along[2, 2] == pytest.approx(1)
        assert along[0, 0] == pytest.approx(1) or along[0, 0] == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize('moments', [(1.0, 1.0, 1.0), (1.0, 1.1, 1.2)])
def test_other_parts_have_no_such_frame(moments):
    mesh = trimesh.creation.box((1, 1, 1))
    found = symmetric_top_axes(mesh.vertices, mesh.faces, 1.0, np.array(moments), np.eye(3))
    assert found is None


def test_axes_that_are_right_already_stay_bit_for_bit(part):
    # Otherwise the poses of drops would change with rounding.
    axes = part('hex_nut').principal_axes
    assert np.isin(axes, (-1, 0, 1)).all()
