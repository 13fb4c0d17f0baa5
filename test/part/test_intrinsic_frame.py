"""The intrinsic frame belongs to the shape: it turns with the part, independent of the mesh."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import a_turn, turned

from resting_aspects_ros.part.mass import (
    POWERS,
    higher_moments,
    symmetric_top_axes,
)

SEEDS = st.integers(0, 2**32 - 1)

# Noise of float32 in the inertia, 1e-7, is divided by the relative gap between two moments, which
# is at least 0.03 in these tests, when it turns the axes.
ANGLE = 1e-5


def seven_corners(seed: int) -> trimesh.Trimesh:
    points = np.random.default_rng(seed).uniform(-20, 20, size=(7, 3))
    return trimesh.convex.convex_hull(points)


def s_profile() -> trimesh.Trimesh:
    """Symmetric about its centre, so that all its third moments are zero."""
    outline = [(0, 0), (20, 0), (20, 5), (5, 5), (5, 20), (-15, 20), (-15, 15), (0, 15)]
    return trimesh.creation.extrude_polygon(shapely.Polygon(outline), 7)


def test_moments_of_a_tetrahedron():
    """Dirichlet: the integral of x^i y^j z^k over it is i! j! k! / (i + j + k + 3)!."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    expected = [
        math.prod(math.factorial(power) for power in powers) / math.factorial(sum(powers) + 3)
        for powers in POWERS.tolist()
    ]
    found = higher_moments(corners, faces, np.eye(3))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@given(shape=SEEDS, turn=SEEDS)
def test_frame_turns_with_an_asymmetric_part(solid, shape, turn):
    mesh = seven_corners(shape)
    part = solid(mesh)
    gaps = np.diff(part.principal_moments) / part.principal_moments[2]
    assume(gaps.min() > 0.03)
    found = higher_moments(
        (part.vertices - part.centre_of_mass) / part.hull_radius, part.faces, part.principal_axes
    ) / (part.volume / part.hull_radius**3)
    assume(np.abs(found[:3]).min() > 1e-4)
    axes = solid(turned(mesh, a_turn(turn))).principal_axes
    np.testing.assert_allclose(axes, a_turn(turn) @ part.principal_axes, atol=ANGLE)
    assert np.linalg.det(axes) == pytest.approx(1)


@given(turn=SEEDS)
def test_frame_of_a_part_with_a_centre_of_symmetry_turns_with_it(solid, turn):
    """The mesh of the part that is turned has more triangles."""
    part = solid(s_profile())
    axes = solid(turned(s_profile().subdivide(), a_turn(turn))).principal_axes
    found = part.principal_axes.T @ a_turn(turn).T @ axes
    # The axis of the extrusion keeps its sign; half a turn about it is a symmetry of the part.
    normal = int(np.abs(part.principal_axes[2]).argmax())
    expected = np.where(np.arange(3) == normal, 1.0, np.sign(found[normal - 1, normal - 1]))
    np.testing.assert_allclose(found, np.diag(expected), atol=ANGLE)


def test_frame_of_a_given_inertia_has_its_axes_and_the_signs_of_the_solid(solid):
    turn = a_turn(4)
    inertia = turn @ np.diag([1e-7, 2e-7, 2.5e-7]) @ turn.T
    part = solid(seven_corners(3), mass=1e-2, inertia=inertia)
    np.testing.assert_allclose(np.abs(turn.T @ part.principal_axes), np.eye(3), atol=1e-12)
    found = higher_moments(part.vertices - part.centre_of_mass, part.faces, part.principal_axes)
    assert found[0] > 0
    assert found[1] > 0


def test_frame_of_an_open_mesh_has_the_signs_of_its_hull(solid):
    """The hull of a convex part is the part, so that a missing triangle must change nothing."""
    mesh = seven_corners(3)
    whole = solid(mesh)
    given = {'mass': whole.mass, 'centre_of_mass': whole.centre_of_mass, 'inertia': whole.inertia}
    opened = solid(trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False), **given)
    assert np.isnan(opened.volume)
    np.testing.assert_allclose(opened.principal_axes, whole.principal_axes, atol=1e-12)


# -- Parts with two equal moments of inertia: their frames and ids turn with the part -------------


MOMENTS = np.array([1.0, 1.0, 2.0])


def pinwheel(arms, height=6.0):
    """A hub with bent arms: an axis of symmetry, and no mirror plane through it."""
    arm = shapely.union_all([shapely.box(-2, 0, 2, 20), shapely.box(-2, 16, 9, 20)])
    turns = [shapely.affinity.rotate(arm, 360 * k / arms, origin=(0, 0)) for k in range(arms)]
    return trimesh.creation.extrude_polygon(
        shapely.union_all([shapely.Point(0, 0).buffer(6, 2 * arms), *turns]), height
    )


@pytest.mark.slow
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


def test_axes_that_are_right_already_stay_bit_for_bit(part):
    # Otherwise the poses of drops would change with rounding.
    axes = part('hex_nut').principal_axes
    assert np.isin(axes, (-1, 0, 1)).all()
