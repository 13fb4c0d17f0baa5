"""Shares of basins, held to solid angles, to symmetry, and to counts of directions."""

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import join_minima
from resting_aspects_ros.aspects.landscape import Landscape


def directions(n):
    found = np.random.default_rng(6).standard_normal((n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.mark.parametrize('sides', [(10, 20, 30), (10, 10, 40), (1, 100, 100), (1, 2, 100)])
@pytest.mark.parametrize('seed', [0, 1])
def test_shares_of_a_box_are_the_solid_angles_of_its_faces(solids, solid, sides, seed):
    landscape = Landscape(solid(solids.turned(solids.box(*sides), solids.a_turn(seed))))
    h, a, b = np.array([np.roll(np.sort(sides), -k) for k in range(3)]).T / 2
    solid_angle = 4 * np.arctan(a * b / (h * np.sqrt(a**2 + b**2 + h**2)))
    expected = np.repeat(solid_angle / (4 * np.pi), 2)
    np.testing.assert_allclose(landscape.basin_shares, expected, atol=1e-6)  # float32


@pytest.mark.parametrize('thickness', [0.1, 3.0])
def test_a_coin_rests_on_its_side_with_h_over_its_diagonal(solids, solid, thickness):
    part = solid(solids.prism(256, 5.0, 10 * thickness))
    landscape = Landscape(part)
    side = np.abs(landscape.directions[:, 2]) < 0.5
    # A polygon of n sides is a circle up to 1 - cos(pi / n), 7.5e-5.
    expected = thickness / np.hypot(thickness, 1)
    assert landscape.basin_shares[side].sum() == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('binom3', ()),
        ('extruded', ([(0, 0), (30, 0), (0, 8)], 12)),
        ('random_sphere', (100, (1, 1, 2))),
        ('half_round_bar', (16,)),
        *[('irregular', (seed, 30)) for seed in range(2)],
        *[('blocks', (seed,)) for seed in range(3)],
    ],
)
def test_shares_agree_with_random_descents(solids, solid, name, arguments):
    landscape = Landscape(solid(getattr(solids, name)(*arguments)))
    n = 100_000
    counts = np.bincount(landscape.descend(directions(n)), minlength=len(landscape.minima))
    p = landscape.basin_shares
    # 5 standard deviations of a count, and one more for shares of few counts.
    assert (np.abs(counts - n * p) < 5 * np.sqrt(n * p) + 5).all()


@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('filleted_box', ((10, 14, 20), 2, 6)),
        ('random_sphere', (500,)),
        ('random_sphere', (500, (1, 1, 2))),
        ('random_cylinder', (500,)),
        ('icosphere', (2,)),
        ('uv_sphere', (20,)),
        # Around their pole triangles are so narrow that some are one facet, up to noise.
        ('rounded_cylinder', (1, 20, 1, 64, 16)),
    ],
)
def test_shares_are_positive_and_sum_to_one(solids, solid, name, arguments):
    landscape = Landscape(solid(getattr(solids, name)(*arguments)))
    assert landscape.basin_shares.min() > 0
    assert landscape.basin_shares.sum() == pytest.approx(1, abs=1e-5)  # COPLANAR
    joined = join_minima(landscape)
    groups = np.concatenate([each for group in joined for each in (group.minima, group.drained)])
    np.testing.assert_array_equal(np.sort(groups), np.arange(len(landscape.minima)))


def test_a_lens_as_thin_as_the_noise_of_its_facets_has_basins(solids, solid):
    """Facets are merged that fit each other up to COPLANAR: some corners have no way down."""
    landscape = Landscape(solid(solids.ellipsoid(30, 20, 0.01, 4)))
    assert landscape.heights[0] / landscape.radius == pytest.approx(0.01 / 30, abs=1e-5)
    assert landscape.basin_shares.sum() == pytest.approx(1, abs=1e-3)
