"""The hull as facets, edges and corners, compared with Euler's formula and known solids."""

import numpy as np
import pytest

from resting_aspects_ros.part.hull import polyhedron


def scaled(mesh):
    """Corners from the centre of mass in units of R, and R."""
    points = mesh.vertices - mesh.center_mass
    radius = np.linalg.norm(points, axis=1).max()
    return points / radius, radius


@pytest.mark.parametrize(
    ('name', 'arguments', 'corners', 'edges', 'facets'),
    [
        ('tetrahedron', (), 4, 6, 4),
        ('box', (10, 20, 30), 8, 12, 6),
        ('icosphere', (0,), 12, 30, 20),
        ('prism', (6,), 12, 18, 8),
        ('prism', (64,), 128, 192, 66),
        ('washer', (16,), 32, 48, 18),
        ('random_sphere', (60,), 60, 3 * 60 - 6, 2 * 60 - 4),
    ],
)
@pytest.mark.parametrize('seed', [0, 1])
def test_corners_edges_and_facets_of_a_hull(solids, name, arguments, corners, edges, facets, seed):
    mesh = solids.turned(getattr(solids, name)(*arguments), solids.a_turn(seed))
    body = polyhedron(scaled(mesh)[0])
    assert (len(body.points), len(body.ends), len(body.normals)) == (corners, edges, facets)


@pytest.mark.parametrize('seed', range(10))
def test_random_hulls_satisfy_eulers_formula(solids, seed):
    body = polyhedron(scaled(solids.irregular(seed, 60))[0])
    assert len(body.points) - len(body.ends) + len(body.normals) == 2
    for k in (0, 1):
        for end in (0, 1):
            normal = body.normals[body.sides[:, k]]
            height = body.heights[body.sides[:, k]]
            reach = (normal * body.points[body.ends[:, end]]).sum(axis=1)
            np.testing.assert_allclose(reach, height, atol=1e-12)  # rounding
    # Seen from outside the first side is on the left of the way from end to end.
    along = body.points[body.ends[:, 1]] - body.points[body.ends[:, 0]]
    left = np.cross(body.normals[body.sides[:, 0]], body.normals[body.sides[:, 1]])
    assert ((left * along).sum(axis=1) > 0).all()
    assert (body.points @ body.normals.T <= body.heights + 1e-12).all()


def test_feet_and_margins_of_a_box_are_its_half_sides(solids):
    points, radius = scaled(solids.box(10, 20, 30))
    body = polyhedron(points)
    np.testing.assert_allclose(body.feet, 0.5, atol=1e-12)
    half = np.array([5, 10, 15]) / radius
    for sides, margins in zip(body.sides, body.margins, strict=True):
        # From one facet's foot to the edge it is as far as the other facet is away.
        np.testing.assert_allclose(margins, np.abs(body.normals[sides[::-1]]) @ half, atol=1e-12)
    np.testing.assert_allclose(body.angles, np.pi / 2, atol=1e-12)


def test_float32_noise_does_not_create_facets(solids, solid):
    # 1 m off the coordinates of a 20 mm part are right to 6e-8 m, 4e-6 of its radius.
    mesh = solids.turned(solids.prism(16), solids.a_turn(2), (1000, -700, 400))
    part = solid(mesh)
    body = polyhedron((part.hull_vertices - part.centre_of_mass) / part.hull_radius)
    assert len(body.normals) == 18
