"""Minima, saddles, maxima and descent, held to closed forms and to a descent in tiny steps."""

import numpy as np
import pytest
from solids import directions

from resting_aspects_ros.aspects.landscape import Landscape

SHAPES = [
    ('box', (10, 20, 30)),
    ('icosphere', (2,)),
    ('filleted_box', ((10, 14, 20), 2, 4)),
    ('half_round_bar', (32,)),
    ('revolved', ([(10, 0), (0, 20)], 24)),
    ('extruded', ([(0, 0), (10, 0), (20, 10), (10, 10)], 7)),
    ('binom3', ()),
    ('random_sphere', (300, (1, 1, 2))),
    ('uv_sphere', (20,)),
    ('blocks', (1,)),
]


def rolled(corners, down, step, steps):
    """Steepest descent of max p . d, a tiny step at a time: what descend() does in arcs."""
    for _ in range(steps):
        p = corners[(down @ corners.T).argmax(axis=1)]
        slope = p - (p * down).sum(axis=1, keepdims=True) * down
        down = down - step * slope / np.linalg.norm(slope, axis=1, keepdims=True)
        down /= np.linalg.norm(down, axis=1, keepdims=True)
    return down


def maxima(landscape):
    """How many corners the part can balance on, its head."""
    hull = landscape.hull
    below = hull.ends[hull.feet <= 0, 0], hull.ends[hull.feet >= 1, 1]
    return len(hull.points) - len(np.unique(np.concatenate(below)))


@pytest.mark.parametrize(('name', 'arguments'), SHAPES)
def test_minima_follow_morse_and_no_descent_ends_higher(solids, solid, name, arguments):
    mesh = solids.turned(getattr(solids, name)(*arguments), solids.a_turn(1))
    landscape = Landscape(solid(mesh))
    # Morse: the Euler characteristic of the sphere of directions.
    saddles = len(landscape.saddles.edges)
    assert len(landscape.minima) - saddles + maxima(landscape) == 2
    down = directions(3, 2_000)
    found = landscape.descend(down)
    assert found.min() >= 0
    assert found.max() < len(landscape.minima)
    slack = 1e-9 * landscape.radius  # rounding
    support = (down @ landscape.hull.points.T).max(axis=1) * landscape.radius
    assert (landscape.heights[found] <= support + slack).all()
    again = landscape.descend(landscape.directions)
    np.testing.assert_array_equal(again, np.arange(len(landscape.minima)))
    assert landscape.basin_shares.min() > 0
    assert landscape.basin_shares.sum() == pytest.approx(1, abs=1e-5)  # COPLANAR


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'arguments'), [SHAPES[0], SHAPES[4], SHAPES[-1]])
def test_descent_agrees_with_tiny_steps(solids, solid, name, arguments):
    part = solid(getattr(solids, name)(*arguments))
    landscape = Landscape(part)
    down = directions(1, 100)
    # Within 5 mrad of the border of a basin tiny steps may cross it.
    around = down[:, None] + 5e-3 * directions(2, 12)
    around /= np.linalg.norm(around, axis=2, keepdims=True)
    found = landscape.descend(down)
    inside = (landscape.descend(around).reshape(100, -1) == found[:, None]).all(axis=1)
    # And out of a minimum that is shallower than a step.
    over = landscape.saddles
    rim = np.full(len(landscape.minima), np.inf)
    np.minimum.at(rim, over.between.ravel(), np.repeat(over.heights, 2))
    inside &= ((rim - landscape.heights) / landscape.radius > 1e-3)[found]
    corners = (part.hull_vertices - part.centre_of_mass) / part.hull_radius
    end = rolled(corners, down[inside], 1e-3, 12_000)
    along = end @ landscape.directions.T
    there = along.max(axis=1) > np.cos(5e-3)  # a shallow valley takes more steps than these
    assert there.sum() > 40
    np.testing.assert_array_equal(along.argmax(axis=1)[there], found[inside][there])


def test_descent_from_critical_points_ends_beside_them(solids, solid):
    # On its head, on an edge: rounding decides to which side, but to one of them.
    landscape = Landscape(solid(solids.box(10, 20, 30)))
    hull = landscape.hull
    heads = hull.points / np.linalg.norm(hull.points, axis=1, keepdims=True)
    edges = hull.points[hull.ends].sum(axis=1)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    for down in (heads, edges):
        reached = landscape.directions[landscape.descend(down)]
        assert ((reached * down).sum(axis=1) > 0).all()


@pytest.mark.parametrize('n', [3, 16])
def test_minima_and_saddles_of_a_prism_follow_its_outline(solids, solid, n):
    radius, height = 10e-3, 20e-3
    landscape = Landscape(solid(solids.turned(solids.prism(n), solids.a_turn(n))))
    apothem = radius * np.cos(np.pi / n)
    minima = sorted([height / 2] * 2 + [apothem] * n)
    np.testing.assert_allclose(landscape.heights, minima, rtol=1e-6)  # float32
    saddles = sorted([radius] * n + [np.hypot(apothem, height / 2)] * (2 * n))
    np.testing.assert_allclose(landscape.saddles.heights, saddles, rtol=1e-6)


# -- Shares of basins, held to solid angles, to symmetry, and to counts of directions -------------


@pytest.mark.parametrize('thickness', [0.1, 3.0])
def test_a_coin_rests_on_its_side_with_h_over_its_diagonal(solids, solid, thickness):
    part = solid(solids.prism(256, 5.0, 10 * thickness))
    landscape = Landscape(part)
    side = np.abs(landscape.directions[:, 2]) < 0.5
    # A polygon of n sides is a circle up to 1 - cos(pi / n), 7.5e-5.
    expected = thickness / np.hypot(thickness, 1)
    assert landscape.basin_shares[side].sum() == pytest.approx(expected, abs=1e-4)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('binom3', ()),
        ('random_sphere', (100, (1, 1, 2))),
        ('half_round_bar', (16,)),
        ('blocks', (1,)),
    ],
)
def test_shares_agree_with_random_descents(solids, solid, name, arguments):
    landscape = Landscape(solid(getattr(solids, name)(*arguments)))
    n = 20_000
    counts = np.bincount(landscape.descend(directions(6, n)), minlength=len(landscape.minima))
    p = landscape.basin_shares
    # 5 standard deviations of a count, and one more for shares of few counts.
    assert (np.abs(counts - n * p) < 5 * np.sqrt(n * p) + 5).all()


@pytest.mark.parametrize(('name', 'arguments', 'tolerance'), [
    # Some corners have no way down; around a pole, triangles are very narrow.
    ('ellipsoid', (30, 20, 0.01, 4), 1e-3), ('rounded_cylinder', (1, 20, 1, 64, 16), 1e-5),
])  # fmt: skip
def test_facets_that_are_merged_as_noise_have_basins(solids, solid, name, arguments, tolerance):
    landscape = Landscape(solid(getattr(solids, name)(*arguments)))
    assert landscape.basin_shares.sum() == pytest.approx(1, abs=tolerance)
