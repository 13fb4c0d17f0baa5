"""The intrinsic frame belongs to the shape: it turns with the part, independent of the mesh."""

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.geometry.intrinsic_frame import (
    intrinsic_signs,
    principal_frame,
    third_moments,
)
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.part_loading import part_from_bytes

SEEDS = st.integers(0, 2**32 - 1)

# Noise of float32 in the inertia, 1e-7, is divided by the relative gap between two moments, which
# is at least 0.03 in these tests, when it turns the axes.
ANGLE = 1e-5


def part_of(mesh: trimesh.Trimesh, turn: Rotation | None = None, **given) -> Part:
    vertices = turn.apply(mesh.vertices) if turn else mesh.vertices
    turned = trimesh.Trimesh(vertices, mesh.faces, process=False)
    return part_from_bytes(turned.export(file_type='stl'), 'stl', 'part', **given)


def rotation(seed: int) -> Rotation:
    return Rotation.from_quat(np.random.default_rng(seed).normal(size=4))


def angle_bracket() -> trimesh.Trimesh:
    """Symmetric about one plane, so that one direction of its frame has no third moment."""
    legs = [
        trimesh.creation.box(bounds=b)
        for b in ([[0, 0, 0], [45, 8, 20]], [[0, 8, 0], [8, 30, 20]])
    ]
    return trimesh.util.concatenate(legs)


def test_third_moments_of_a_tetrahedron():
    """Dirichlet: the integral of x^i y^j z^k over it is i! j! k! / (i + j + k + 3)!."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    found = third_moments(corners, faces, np.eye(3))
    np.testing.assert_allclose(found, np.array([6] * 3 + [2] * 6 + [1]) / 720, rtol=1e-14)


def test_third_moments_of_a_box_about_its_corner():
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [2, 3, 5]])
    a, b, c = 2, 3, 5
    expected = [
        a**4 / 4 * b * c,
        b**4 / 4 * a * c,
        c**4 / 4 * a * b,
        a**3 / 3 * b**2 / 2 * c,
        a**3 / 3 * b * c**2 / 2,
        b**3 / 3 * a**2 / 2 * c,
        b**3 / 3 * a * c**2 / 2,
        c**3 / 3 * a**2 / 2 * b,
        c**3 / 3 * a * b**2 / 2,
        (a * b * c) ** 2 / 8,
    ]
    np.testing.assert_allclose(third_moments(mesh.vertices, mesh.faces, np.eye(3)), expected)


def test_third_moments_follow_the_axes():
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [2, 3, 5]])
    turn = rotation(1)
    straight = third_moments(mesh.vertices, mesh.faces, np.eye(3))
    turned = third_moments(turn.apply(mesh.vertices), mesh.faces, turn.as_matrix())
    np.testing.assert_allclose(turned, straight)


@given(shape=SEEDS, turn=SEEDS)
def test_frame_turns_with_an_asymmetric_part(shape, turn):
    points = np.random.default_rng(shape).uniform(-20, 20, size=(7, 3))
    mesh = trimesh.convex.convex_hull(points)
    part = part_of(mesh)
    gaps = np.diff(part.principal_moments) / part.principal_moments[2]
    assume(gaps.min() > 0.03)
    moments = third_moments(
        (part.vertices - part.centre_of_mass) / part.hull_radius, part.faces, part.principal_axes
    ) / (part.volume / part.hull_radius**3)
    assume(np.abs(moments[:3]).min() > 1e-4)
    turned = part_of(mesh, rotation(turn))
    np.testing.assert_allclose(
        turned.principal_axes, rotation(turn).as_matrix() @ part.principal_axes, atol=ANGLE
    )
    assert np.linalg.det(turned.principal_axes) == pytest.approx(1)


@given(turn=SEEDS)
def test_frame_of_a_part_with_a_plane_of_symmetry_turns_with_it(turn):
    part, turned = part_of(angle_bracket()), part_of(angle_bracket(), rotation(turn))
    np.testing.assert_allclose(
        turned.principal_axes, rotation(turn).as_matrix() @ part.principal_axes, atol=ANGLE
    )


@given(turn=SEEDS)
def test_frame_of_a_box_turns_with_it_up_to_its_symmetry(turn):
    mesh = trimesh.creation.box((10, 20, 30))
    expected = rotation(turn).as_matrix()[:, [2, 1, 0]]
    found = part_of(mesh, rotation(turn)).principal_axes
    np.testing.assert_allclose(np.abs(expected.T @ found), np.eye(3), atol=ANGLE)
    assert np.linalg.det(found) == pytest.approx(1)


def test_frame_does_not_depend_on_the_mesh():
    coarse = angle_bracket()
    fine = coarse.subdivide().subdivide()
    np.testing.assert_allclose(
        part_of(fine).principal_axes, part_of(coarse).principal_axes, atol=ANGLE
    )


def test_mirrored_part_has_a_right_handed_frame_too():
    mesh = trimesh.convex.convex_hull(np.random.default_rng(3).uniform(-20, 20, size=(7, 3)))
    mirrored = trimesh.Trimesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1], process=False)
    assert np.linalg.det(part_of(mesh).principal_axes) == pytest.approx(1)
    assert np.linalg.det(part_of(mirrored).principal_axes) == pytest.approx(1)


def test_signs_maximize_the_third_moments():
    assert intrinsic_signs(np.array([-1.0, 1, 1, 0, 0, 0, 0, 0, 0, 0])).tolist() == [-1, 1, -1]
    assert intrinsic_signs(np.array([0.0, -1, 0, 0, 0, 0, 0, 0, 0, 0])).tolist() == [1, -1, -1]
    # A tetrahedron's only moment is xyz, which is the same for all four: the first is taken.
    assert intrinsic_signs(np.array([0.0, 0, 0, 0, 0, 0, 0, 0, 0, -1])).tolist() == [1, 1, 1]


def test_float32_noise_does_not_determine_signs():
    noise = np.array([-1e-7, -1e-7, -1e-7, 1, 0, 0, 0, 0, 0, 0])
    assert intrinsic_signs(noise).tolist() == [1, 1, 1]
    # x2y is the first one that counts, and is negative.
    assert intrinsic_signs(-noise).tolist() == [1, -1, -1]


def test_frame_of_a_given_inertia_has_its_axes_and_the_signs_of_the_solid():
    turn = rotation(4).as_matrix()
    inertia = turn @ np.diag([1e-7, 2e-7, 2.5e-7]) @ turn.T
    mesh = trimesh.convex.convex_hull(np.random.default_rng(3).uniform(-20, 20, size=(7, 3)))
    part = part_of(mesh, mass=1e-2, inertia=inertia)
    np.testing.assert_allclose(np.abs(turn.T @ part.principal_axes), np.eye(3), atol=1e-12)
    moments = third_moments(part.vertices - part.centre_of_mass, part.faces, part.principal_axes)
    assert moments[0] > 0
    assert moments[1] > 0


def test_frame_of_an_open_mesh_has_the_signs_of_its_hull():
    """The hull of a convex part is the part, so that a missing triangle must change nothing."""
    mesh = trimesh.convex.convex_hull(np.random.default_rng(3).uniform(-20, 20, size=(7, 3)))
    solid = part_of(mesh)
    given = {'mass': solid.mass, 'centre_of_mass': solid.centre_of_mass, 'inertia': solid.inertia}
    opened = part_of(trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False), **given)
    assert np.isnan(opened.volume)
    np.testing.assert_allclose(opened.principal_axes, solid.principal_axes, atol=1e-12)


def test_principal_frame_of_a_diagonal_inertia():
    moments, axes = principal_frame(np.diag([3.0, 1.0, 2.0]))
    np.testing.assert_allclose(moments, [1, 2, 3])
    np.testing.assert_array_equal(axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


def test_equal_moments_get_the_same_axes_every_time():
    first, second = (part_of(trimesh.creation.box((20, 20, 20))) for _ in range(2))
    np.testing.assert_array_equal(first.principal_axes, second.principal_axes)
    np.testing.assert_allclose(
        first.principal_axes.T @ first.principal_axes, np.eye(3), atol=1e-12
    )
