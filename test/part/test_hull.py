"""The smallest rectangle around points, against triangles and rectangles of known sides."""

import numpy as np
import pytest

from resting_aspects_ros.part import near
from resting_aspects_ros.part.hull import polyhedron, smallest_rectangle

# Corners, and the sides of the smallest rectangle with the shortest perimeter. All rectangles
# along the sides of a triangle without an obtuse angle have twice its area.
SHAPES = {
    'right triangle': ([(0, 0), (30, 0), (0, 20)], (30, 20)),
    'acute triangle': ([(0, 0), (14, 0), (5, 12)], (13, 168 / 13)),
    'obtuse triangle': ([(0, 0), (20, 0), (30, 5)], (np.hypot(30, 5), 100 / np.hypot(30, 5))),
    'rectangle': ([(0, 0), (12, 0), (12, 30), (0, 30)], (30, 12)),
    'square': ([(0, 0), (7, 0), (7, 7), (0, 7)], (7, 7)),
}


@pytest.mark.parametrize('name', SHAPES)
def test_smallest_rectangle_does_not_depend_on_rounding(name):
    points, expected = SHAPES[name]
    generator = np.random.default_rng(3)
    found = []
    for _ in range(50):
        noise = generator.uniform(-1e-6, 1e-6, (len(points), 2))  # below float32 of 30
        order = generator.permutation(len(points))
        middle, sides = smallest_rectangle((np.array(points) + noise)[order])
        np.testing.assert_allclose(np.linalg.norm(sides, axis=1), expected, atol=1e-5)
        assert abs(sides[0] @ sides[1]) < 1e-9
        long = np.exp(2j * np.arctan2(sides[0][1], sides[0][0]))  # opposite directions are equal
        found.append([*middle, long.real, long.imag])
    np.testing.assert_allclose(found, np.tile(found[0], (50, 1)), atol=1e-5)


def test_no_rectangle_of_any_direction_is_smaller():
    generator = np.random.default_rng(4)
    angles = np.linspace(0, np.pi, 2000)
    across = np.stack([np.cos(angles), np.sin(angles)])
    for number in (3, 4, 5, 9, 40):
        points = generator.standard_normal((number, 2))
        middle, sides = smallest_rectangle(points)
        area = np.linalg.norm(sides, axis=1).prod()
        others = np.ptp(points @ across, axis=0) * np.ptp(
            points @ np.stack([-across[1], across[0]]), axis=0
        )
        assert area <= others.min() * (1 + 1e-5)
        units = sides / np.linalg.norm(sides, axis=1)[:, None]
        inside = np.abs((points - middle) @ units.T) <= np.linalg.norm(sides, axis=1) / 2 + 1e-9
        assert inside.all()


# -- The hull as facets, edges and corners, compared with Euler's formula and known solids --------


def scaled(mesh):
    """Corners from the centre of mass in units of R, and R."""
    points = mesh.vertices - mesh.center_mass
    radius = np.linalg.norm(points, axis=1).max()
    return points / radius, radius


@pytest.mark.parametrize(
    ('name', 'arguments', 'corners', 'edges', 'facets'),
    [
        ('washer', (16,), 32, 48, 18),
        ('random_sphere', (60,), 60, 3 * 60 - 6, 2 * 60 - 4),
    ],
)
def test_corners_edges_and_facets_of_a_hull(solids, name, arguments, corners, edges, facets):
    mesh = solids.turned(getattr(solids, name)(*arguments), solids.a_turn(1))
    body = polyhedron(scaled(mesh)[0])
    assert (len(body.points), len(body.ends), len(body.normals)) == (corners, edges, facets)


def test_random_hull_satisfies_eulers_formula(solids):
    body = polyhedron(scaled(solids.irregular(1, 60))[0])
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


# -- Distances through the tree of boxes are those to all triangles, one by one -------------------


def fan(n):
    """Needles from the tip of a cone: each box lies over many others."""
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    tip = np.broadcast_to([0.0, 0.0, 0.7], rim.shape)
    return np.stack([tip, rim, np.roll(rim, -1, axis=0)], axis=1)


def distances(triangles, points):
    """Of points (n, 3) from the nearest of triangles, by points of a fine grid on each."""
    u, v = np.meshgrid(*[np.linspace(0, 1, 49)] * 2)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=-1).reshape(-1, 3)
    on = np.einsum('wc,mcj->mwj', weights, triangles).reshape(-1, 3)
    return np.array([np.linalg.norm(on - point, axis=1).min() for point in points])


@pytest.mark.slow
@pytest.mark.parametrize(('crowded', 'pairs'), [(32, 500_000), (1, 50)])
def test_near_and_nearest_agree_with_exhaustive_search(monkeypatch, crowded, pairs):
    """The tree looks ahead, and divides its work, late or early."""
    monkeypatch.setattr(near, 'BATCH', 64)
    monkeypatch.setattr(near, 'CROWDED', crowded)
    monkeypatch.setattr(near, 'MAX_PAIRS', pairs)
    triangles = fan(100)
    points = np.random.default_rng(1).uniform(-1, 1, (80, 3)) * [1, 1, 0.8]
    points[0] = 0, 0, 0.7
    expected = distances(triangles, points)
    grid = 0.02  # half of what is between the points of the grid
    reach = 0.2
    surface = near.TriangleTree(triangles, np.zeros(len(triangles)))
    close = surface.near(points, np.full(len(points), reach), np.zeros(len(points)))
    assert close[0]
    assert close[expected <= reach].all()
    assert not close[expected > reach + grid].any()
    found, _, ways = surface.nearest(points, 3.0)
    np.testing.assert_array_equal(np.sort(found), np.arange(len(points)))
    apart = np.linalg.norm(ways, axis=1)
    assert (apart <= expected[found] + 1e-12).all()
    assert (apart >= expected[found] - grid).all()
