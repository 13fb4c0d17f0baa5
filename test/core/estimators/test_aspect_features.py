"""Features of aspects: what they must not depend on, and what is known of them."""

import numpy as np
import pytest

from resting_aspects_ros.core.estimators import aspect_features as module
from resting_aspects_ros.core.estimators.aspect_features import aspect_features
from resting_aspects_ros.core.estimators.resting_shape import RestingShape


@pytest.fixture(scope='module')
def features(solid):
    return lambda mesh: aspect_features(RestingShape(solid(mesh)))


def test_features_do_not_depend_on_scale_rotation_and_mesh(solids, features):
    mesh = solids.irregular(5)
    plain = features(mesh)
    assert len(plain.values) > 3
    moved = solids.turned(mesh.copy().apply_scale(30.0), solids.a_turn(6), (3, -8, 20))
    for other in (moved, mesh.subdivide()):
        found = features(other)
        np.testing.assert_allclose(found.values, plain.values, atol=2e-3)
        np.testing.assert_allclose(found.of_part, plain.of_part, atol=1e-4)


def test_features_of_a_cylinder_do_not_depend_on_its_number_of_sides(solids, features):
    fine, coarse = (features(solids.prism(n, 10.0, 15.0)) for n in (96, 48))
    # A polygon of n sides differs from a circle by 1 - cos(pi / n), 2e-3; the logarithms of
    # small differences differ by more.
    np.testing.assert_allclose(coarse.values, fine.values, atol=0.06)


def test_faces_of_a_cube_have_equal_features(solids, features):
    values = features(solids.turned(solids.box(9, 9, 9), solids.a_turn(2))).values
    np.testing.assert_allclose(values, values[:1].repeat(6, axis=0), atol=1e-3)


def test_columns_have_the_values_of_a_box(solids, features):
    found = features(solids.box(10, 20, 30))
    radius = np.linalg.norm([10, 20, 30]) / 2
    columns = dict(zip(found.names, found.values.T, strict=True))
    np.testing.assert_allclose(columns['height'], np.repeat([5, 10, 15], 2) / radius, rtol=1e-5)
    over = np.hypot([5, 10, 15], [10, 5, 5]) - [5, 10, 15]
    np.testing.assert_allclose(columns['barrier'], np.repeat(over, 2) / radius, rtol=1e-5)
    for name, column in columns.items():
        if name.startswith(('merge', 'chain')):
            assert np.exp(column).sum() == pytest.approx(1, abs=1e-3)
    moments = np.sort([500, 1000, 1300]) / 12 / radius**2
    np.testing.assert_allclose(found.moments, moments, rtol=1e-4)


def test_passes_between_aspects_are_in_detailed_balance(solids, solid):
    shape = RestingShape(solid(solids.irregular(1)))
    owners = shape.aspect_of_facets[shape.landscape.minima]
    count = len(shape.aspects)
    integrals = module.BasinIntegrals(shape.landscape, owners, count)
    passes = module.Passes(shape.landscape, owners, count)
    rates = module.rates_between(passes, integrals, 0.1)
    volume = integrals.integral(lambda s: -0.1 * np.exp(-s / 0.1))
    flow = volume[:, None] * rates
    np.testing.assert_allclose(flow, flow.T, rtol=1e-9)


def test_cold_part_stays_where_it_has_rolled_to(solids, solid):
    shape = RestingShape(solid(solids.box(10, 20, 30)))
    owners = shape.aspect_of_facets[shape.landscape.minima]
    integrals = module.BasinIntegrals(shape.landscape, owners, 6)
    passes = module.Passes(shape.landscape, owners, 6)
    basin = np.array([aspect.basin_share for aspect in shape.aspects.aspects])
    cold, warm = (
        module.chain_shares(basin, module.rates_between(passes, integrals, temperature))
        for temperature in (0.004, 0.3)
    )
    np.testing.assert_allclose(cold, basin, atol=1e-3)
    assert warm[:2].sum() > basin[:2].sum() + 0.05


def test_part_that_loses_energy_slowly_prefers_the_lower_of_two_sets(solids, solid):
    """With much excess energy, the merge shares approach the basins."""
    shape = RestingShape(solid(solids.box(10, 10, 25)))
    owners = shape.aspect_of_facets[shape.landscape.minima]
    integrals = module.BasinIntegrals(shape.landscape, owners, len(shape.aspects))
    passes = module.Passes(shape.landscape, owners, len(shape.aspects))
    basin = np.array([aspect.basin_share for aspect in shape.aspects.aspects])
    high = [a.com_height > 8e-3 for a in shape.aspects.aspects]
    slow, fast = (module.merge_shares(passes, integrals, excess) for excess in (0.0, 1e4))
    np.testing.assert_allclose(fast, basin, atol=1e-3)
    assert slow[high].sum() < 0.5 * basin[high].sum()
