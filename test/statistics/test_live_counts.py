"""Counted parts with the simulation as their prior."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.counted_parts import LiveCounts


def live(simulated, observed=None, **options):
    observed = [0] * len(simulated) if observed is None else observed
    ids = tuple(range(1, len(simulated) + 1))
    return LiveCounts(ids, np.array(simulated), np.array(observed), **options)


def test_simulation_has_the_weight_of_a_number_of_drops():
    found = live([6000, 4000], [30, 10], weight=100)
    np.testing.assert_allclose(found.concentration, [90, 50], rtol=1e-3)
    first, second = found.intervals()
    assert first.probability == pytest.approx(90 / 140, rel=1e-3)
    assert first.probability + second.probability == pytest.approx(1)
    a, b = found.concentration
    assert (first.lower, first.upper) == pytest.approx(beta.ppf([0.025, 0.975], a, b))


def test_few_drops_have_no_more_weight_than_their_number():
    assert live([6, 4], weight=100).prior_weight == 10
    assert live([6, 4], weight=100).concentration.sum() == pytest.approx(10)


@given(
    st.lists(st.tuples(st.integers(1, 1000), st.integers(0, 1000)), min_size=2, max_size=8),
    st.floats(0.5, 1e4),
)
def test_mean_is_between_simulation_and_counts(rows, weight):
    simulated, observed = np.array(rows).T
    found = live(simulated, observed, weight=weight)
    mean = np.array([each.probability for each in found.intervals()])
    assert mean.sum() == pytest.approx(1)
    prior = (simulated + 0.5) / (simulated + 0.5).sum()
    share = observed / observed.sum() if observed.any() else prior
    assert (np.minimum(prior, share) - 1e-9 <= mean).all()
    assert (mean <= np.maximum(prior, share) + 1e-9).all()
    assert all(each.lower <= each.upper for each in found.intervals())


def test_intervals_cover_shares_that_the_prior_describes():
    rng = np.random.default_rng(2)
    simulated, repetitions = np.array([500, 300, 200]), 1000
    alpha = live(simulated).concentration
    covered = 0
    for shares in rng.dirichlet(alpha, size=repetitions):
        first = live(simulated, rng.multinomial(150, shares)).intervals()[0]
        covered += first.lower <= shares[0] <= first.upper
    assert abs(covered / repetitions - 0.95) <= 3.3 * math.sqrt(0.95 * 0.05 / repetitions)


@pytest.mark.parametrize('weight', [0, -1, float('nan'), float('inf'), True, '60'])
def test_wrong_weight_is_refused(weight):
    with pytest.raises(InvalidValueError, match='invalid prior weight'):
        live([5, 5], weight=weight)
