"""Expected information gain against channels whose capacity is known."""

import numpy as np
import pytest
from scipy.stats import binom

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.studies.calibration.plan import information_gain, plan_calibration


def test_two_conditions_that_differ_clearly_are_one_bit():
    shares = np.array([[0.9, 0.1], [0.1, 0.9]])
    gain, _ = information_gain(shares, np.zeros(2), 200, np.random.default_rng(1))
    assert gain == pytest.approx(1, abs=1e-6)


def test_equal_shares_tell_nothing():
    gain, _ = information_gain(
        np.full((5, 2), 0.5), np.full(5, 0.01), 100, np.random.default_rng(1)
    )
    assert gain == pytest.approx(0, abs=1e-9)


def test_gain_is_that_of_a_binomial_channel():
    shares = np.array([0.4, 0.6])
    n = 10
    likelihood = binom.pmf(np.arange(n + 1)[:, None], n, shares)
    mean = likelihood.mean(axis=1, keepdims=True)
    exact = (likelihood * np.log2(likelihood / mean)).sum() / 2
    found, error = information_gain(
        np.stack([shares, 1 - shares], axis=1), np.zeros(2), n, np.random.default_rng(1), 4000
    )
    assert abs(found - exact) < 4 * error
    assert error < 0.02


def test_discrepancy_limits_what_many_drops_tell():
    shares = np.linspace(0.3, 0.7, 50)
    shares = np.stack([shares, 1 - shares], axis=1)
    gains = [
        information_gain(shares, np.full(50, rho), 10_000, np.random.default_rng(1))[0]
        for rho in (0.0, 0.02)
    ]
    assert gains[1] < 0.5 * gains[0]


def test_wrong_numbers_are_refused():
    with pytest.raises(InvalidValueError, match='invalid numbers 0'):
        plan_calibration(['tetrahedron'], numbers=[0])
