"""The analytic methods, held to closed forms, to symmetry, and to another implementation."""

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.aspects.estimate import (
    METHODS,
    NotDefinedError,
    RestingShape,
    estimate,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError

# The coordinates in an STL are float32.
FLOAT32 = 1e-5


@pytest.fixture(scope='module')
def shape(solid):
    """Return a function that makes the resting shape of a mesh in mm."""

    def make(mesh):
        part = solid(mesh)
        return RestingShape(part, find_aspects(part))

    return make


def rectangle(a, b, h):
    """Return the solid angle of a rectangle 2a x 2b at the distance h."""
    return 4 * np.arctan2(a * b, h * np.sqrt(a**2 + b**2 + h**2))


def halves(sides):
    """Return half the sides of each face of a box and its distance, lowest first, each twice."""
    a, b, c = np.sort(sides) / 2
    return np.repeat([(b, c, a), (a, c, b), (a, b, c)], 2, axis=0)


def shares(weights):
    return np.asarray(weights) / np.sum(weights)


def predicted(shape, method):
    return estimate(shape, method).probabilities


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('sides', [(10, 20, 30), (0.2, 0.2, 0.8)])
def test_box_agrees_with_the_definitions(solids, shape, sides):
    weights = {
        method: [] for method in ('solid_angle', 'csa', 'crsa', 'stability', 'energy_barrier')
    }
    for a, b, h in halves(sides):
        over = np.hypot(h, [a, a, b, b])
        critical = np.mean([rectangle(a, b, r) for r in over])
        weights['solid_angle'].append(rectangle(a, b, h))
        weights['csa'].append(rectangle(a, b, h) / h)
        weights['crsa'].append((rectangle(a, b, h) - critical) / h)
        weights['stability'].append(4 * a * b / h)
        weights['energy_barrier'].append(min(over) - h)
    weights['quasi_static'] = weights['rolling'] = weights['solid_angle']
    of = shape(solids.turned(solids.box(*sides), solids.a_turn(2)))
    for method in METHODS:
        np.testing.assert_allclose(predicted(of, method), shares(weights[method]), atol=FLOAT32)


@pytest.mark.slow
def test_regular_solid_is_uniform_without_symmetry_classes(solids, shape):
    faces = 20
    of = shape(solids.turned(solids.icosphere(0), solids.a_turn(4)))
    for method, each in METHODS.items():
        np.testing.assert_allclose(predicted(of, method), np.full(faces, 1 / faces), rtol=1e-12)
        # The energy of an edge is a difference of lengths that agree within a tenth.
        tolerance = 2e-4 if method == 'energy_barrier' else FLOAT32
        np.testing.assert_allclose(shares(each.weights(of)), 1 / faces, rtol=tolerance)


def test_face_of_two_facets_is_counted_once(solids, shape):
    """The die of Baktash et al. has unstable facets within a degree of the faces it rests on."""
    mesh = solids.binom3()
    of = shape(mesh)
    down = np.array([a.down_in_part for a in of.aspects])
    assert len(down) == 4
    a, b, c = np.moveaxis(mesh.triangles - mesh.center_mass, 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    dot = lambda x, y: (x * y).sum(axis=1)  # noqa: E731 - the formula as it is printed
    omega = 2 * np.arctan2(
        np.abs(dot(a, np.cross(b, c))),
        la * lb * lc + dot(a, b) * lc + dot(a, c) * lb + dot(b, c) * la,
    )
    near = down @ mesh.face_normals.T > np.cos(np.radians(1))
    assert near.sum() > 4
    np.testing.assert_allclose(predicted(of, 'solid_angle'), shares(near @ omega), atol=FLOAT32)
    # 255 of 329 rolls ended on the two that lean back.
    np.testing.assert_allclose(
        predicted(of, 'rolling'), np.where(down[:, 0] < 0, 0.375, 0.125), atol=0.01
    )


def test_unstable_facet_adds_its_share_to_the_next_side(solids, shape):
    """A leaning frustum: its base tips onto the side below it, its top onto the one above."""
    base = np.array([(x, y, 0.0) for x in (-5, 5) for y in (-4, 4)])
    top = np.array([(24 + x, y, 20.0) for x in (-3, 3) for y in (-2.5, 2.5)])
    of = shape(solids.hull(np.concatenate([base, top])))
    down = np.array([a.down_in_part for a in of.aspects])
    assert len(down) == 4
    assert np.abs(down[:, 2]).max() < 0.9
    body = of.landscape.hull
    omega = of.facet_angles / (4 * np.pi)
    ends = {z: float(omega[body.normals @ [0, 0, z] > 0.999].sum()) for z in (-1, 1)}
    assert min(ends.values()) > 100 * FLOAT32
    expected = of.face_angles / (4 * np.pi)
    below, above = (int((down @ [s, 0, -s]).argmax()) for s in (1, -1))
    expected[below] += ends[-1]
    expected[above] += ends[1]
    np.testing.assert_allclose(predicted(of, 'quasi_static'), expected, atol=FLOAT32)


def test_quasi_static_agrees_with_trimesh_where_it_is_correct(solids, shape):
    mesh = solids.extruded([(0, 0), (20, 0), (20, 5), (0, 15)], 12)
    of = shape(mesh)
    poses, probabilities = trimesh.poses.compute_stable_poses(mesh)
    down = -poses[:, 2, :3]
    ids, _ = of.aspects.locate(down)
    expected = np.bincount(ids - 1, weights=probabilities, minlength=len(of.aspects))
    np.testing.assert_allclose(predicted(of, 'quasi_static'), shares(expected), atol=1e-4)


@pytest.mark.slow
def test_methods_not_defined_for_a_curved_side(solids, shape):
    of = shape(solids.prism(32))
    assert estimate(of, 'solid_angle').probabilities.sum() == pytest.approx(1)
    for method in ('crsa', 'stability'):
        with pytest.raises(NotDefinedError, match=rf'{method} is not defined for solid: aspect 1'):
            estimate(of, method)
    egg = shape(solids.ellipsoid(10, 10, 6, 3))
    assert len(egg.aspects) == 2
    for method in ('solid_angle', 'csa'):
        with pytest.raises(NotDefinedError, match='continues to another aspect without an edge'):
            estimate(egg, method)
    for method in ('quasi_static', 'rolling', 'energy_barrier'):
        np.testing.assert_allclose(predicted(egg, method), 0.5, atol=1e-6)


@pytest.mark.slow
def test_face_of_a_cylinder_ends_at_its_fillets(solids, shape):
    filleted = shape(solids.rounded_cylinder(10.0, 20.0, 1.0, 48, 6))
    side = np.array([a.rolls for a in filleted.aspects])
    # The cylinder and its ends up to the fillets, seen from the middle.
    around, end = 2 * 9 / np.hypot(9, 10), 1 - 10 / np.hypot(10, 9)
    expected = np.where(side, around, end) / (around + 2 * end)
    np.testing.assert_allclose(predicted(filleted, 'solid_angle'), expected, atol=1e-3)


def test_single_aspect_has_probability_one(solids, shape):
    ball = shape(solids.icosphere(2))
    assert [predicted(ball, method).tolist() for method in METHODS] == [[1.0]] * len(METHODS)
    with pytest.raises(InvalidValueError, match="invalid method 'guess': expected one of solid_"):
        estimate(ball, 'guess')
