"""The learned estimator: conditions, uncertainty, and its fit."""

import dataclasses

import numpy as np
import pytest

from resting_aspects_ros.core.estimators.aspect_features import aspect_features
from resting_aspects_ros.core.estimators.estimate import estimate, share_interval
from resting_aspects_ros.core.estimators.learned import OUTSIDE_WEIGHT, learned, shipped_model
from resting_aspects_ros.core.estimators.release import RELEASE_FEATURES, TYPICAL, Release
from resting_aspects_ros.core.estimators.resting_shape import RestingShape


@pytest.fixture(scope='module')
def bracket(part):
    return RestingShape(part('l_bracket'))


def test_numbers_of_coefficients_fit_the_features(bracket):
    features, model = aspect_features(bracket), shipped_model()
    assert len(features.names) == len(model.of_aspects.mean)
    assert len(RELEASE_FEATURES) == len(model.of_conditions.mean)
    assert len(TYPICAL.features(features.moments)) == len(RELEASE_FEATURES)
    assert len(features.of_part) == len(model.of_part.mean)


def test_conditions_change_the_prediction_and_are_limited(bracket):
    put_down = Release(height=0.05, restitution=0.0, friction=0.5, rolling_friction=0.003)
    assert np.abs(learned(bracket, put_down)[0] - learned(bracket, TYPICAL)[0]).max() > 0.02
    bounds = shipped_model().bounds
    far = dataclasses.replace(TYPICAL, height=1e4)
    limit = dataclasses.replace(TYPICAL, height=bounds.height[1])
    assert (bounds.outside(far), bounds.outside(limit)) == ('height', '')
    np.testing.assert_array_equal(learned(bracket, far)[0], learned(bracket, limit)[0])


def test_prediction_beyond_the_bounds_is_less_certain(bracket):
    """The spin of `thrown`, 50 rad/s, is beyond the bounds for parts with R above 63 mm."""
    inside, outside = (dataclasses.replace(TYPICAL, speed=0.8, spin=s) for s in (3.9, 4.1))
    assert shipped_model().bounds.outside(inside) == ''
    assert shipped_model().bounds.outside(outside) == 'spin'
    assert learned(bracket, inside)[1] > OUTSIDE_WEIGHT
    assert learned(bracket, outside)[1] == OUTSIDE_WEIGHT
    known, beyond = (estimate(bracket, 'learned', each) for each in (inside, outside))
    for k in range(1, len(known.probabilities) + 1):
        one, other = known.interval([k]), beyond.interval([k])
        assert other.upper - other.lower > one.upper - one.lower


def test_weight_gives_the_intervals_of_as_many_drops(bracket):
    found = estimate(bracket, 'learned')
    assert found.weight > 1
    interval = found.interval([1, 2], 0.9)
    both = found.probabilities[:2].sum()
    assert interval.probability == pytest.approx(both)
    draws = np.random.default_rng(1).beta(found.weight * both, found.weight * (1 - both), 20_000)
    # The standard error of the share beyond a quantile is 0.0015.
    assert np.mean(draws < interval.lower) == pytest.approx(0.05, abs=0.006)
    assert np.mean(draws > interval.upper) == pytest.approx(0.05, abs=0.006)
    assert np.isnan(estimate(bracket, 'csa').interval([1]).lower)
    assert share_interval(1.0, 50.0).lower == 1.0


def test_cube_is_uniform_under_any_conditions(solids, solid):
    shape = RestingShape(solid(solids.turned(solids.box(9, 9, 9), solids.a_turn(3))))
    for friction in (0.0, 0.8):
        release = dataclasses.replace(TYPICAL, friction=friction, spin=1.0)
        np.testing.assert_allclose(learned(shape, release)[0], 1 / 6, atol=1e-3)
