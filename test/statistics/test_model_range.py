"""The range of a probability on a real surface: variances, bounds and coverage."""

import dataclasses

import numpy as np
import pytest
from scipy.special import expit, logit
from scipy.stats import norm

import resting_aspects_ros as ra
from resting_aspects_ros.statistics.distribution import no_drops
from resting_aspects_ros.statistics.intervals import bounds
from resting_aspects_ros.statistics.model_range import (
    Draws,
    between_variance,
    combined_range,
    discrepancy,
    independent_drops,
    model_bounds,
    with_model_range,
)


@pytest.fixture(scope='module')
def aspects():
    return ra.find_aspects(ra.load_part('box_10x20x30'))


def drawn(rng, probabilities, m, common):
    """Outcomes of m drops at each draw; a share of the drops has the same numbers in all."""
    own = rng.random((len(probabilities), m))
    shared = np.broadcast_to(rng.random(m), own.shape)
    return np.where(rng.random(m) < common, shared, own) < probabilities[:, None]


@pytest.mark.parametrize('common', [0.0, 1.0])
def test_variance_between_draws_is_unbiased_also_with_common_numbers(common):
    rng, runs, spread = np.random.default_rng(1), 400, 0.08
    found = [
        between_variance(drawn(rng, 0.4 + spread * rng.standard_normal(16), 500, common))
        for _ in range(runs)
    ]
    # Negative estimates, which are 0, do not occur with this spread.
    assert abs(np.mean(found) - spread**2) < 4 * np.std(found) / np.sqrt(runs)
    # Of one draw or drop, nothing is known.
    assert between_variance(np.ones((1, 50), dtype=bool)) == 0
    assert between_variance(np.ones((5, 1), dtype=bool)) == 0


@pytest.mark.parametrize(('common', 'worth'), [(0.0, 16), (1.0, 1)])
def test_draws_are_worth_all_drops_only_with_numbers_of_their_own(common, worth):
    """The variance of m means, which scatters by sqrt(2 / m), is that of independent drops."""
    m = 2000
    found = independent_drops(drawn(np.random.default_rng(5), np.full(16, 0.3), m, common))
    assert worth * m * (1 - 4 * np.sqrt(2 / m)) <= found <= 16 * m
    assert found <= worth * m * (1 + 4 * np.sqrt(2 / m))


def test_without_discrepancy_and_surface_the_range_is_the_sampling_interval():
    counts = np.array([0, 3, 150, 847])
    found = model_bounds(counts, 1000, np.zeros(4), 0.95, scale=0.0)
    np.testing.assert_allclose(found, np.stack(bounds(counts, 1000), axis=1), atol=1e-12)


def test_with_many_drops_the_range_is_normal_on_the_log_odds():
    n, between = 10**9, np.array([0.0, 0.02**2])
    counts = np.array([n // 10, n // 2])
    p = counts / n
    sd = np.hypot(discrepancy(p), np.sqrt(between) / (p * (1 - p)))
    wanted = expit(logit(p)[:, None] + norm.ppf(0.95) * sd[:, None] * [-1, 1])
    np.testing.assert_allclose(model_bounds(counts, n, between, 0.9), wanted, rtol=1e-3)


def test_discrepancy_is_that_at_one_half_and_larger_for_rare_outcomes():
    # (4 x 0.02 x 0.98)^-1/4 = 1.89
    assert discrepancy([0.5, 0.02, 0.98], 0.25) == pytest.approx(
        [0.25, 0.25 * 1.89, 0.25 * 1.89], rel=1e-3
    )


@pytest.mark.parametrize('middle', [-3.5, 0.3])
def test_range_covers_one_more_surface_with_its_discrepancy(middle):
    """The truth is one more draw of the conditions, and deviates from the model."""
    rng, runs, inside, effect, m = np.random.default_rng(3), 600, 0, 0.5, 500
    for _ in range(runs):
        hits = drawn(rng, expit(middle + effect * rng.standard_normal(16)), m, 0.5)
        between = np.array([between_variance(hits)])
        ((low, high),) = model_bounds(np.array([hits.sum()]), hits.size, between, 0.9)
        p = expit(middle + effect * rng.standard_normal())
        truth = expit(logit(p) + discrepancy(p) * rng.standard_normal())
        inside += low <= truth <= high
    # Five standard errors of a frequency of 0.9; the range is approximate.
    assert abs(inside / runs - 0.9) < 5 * np.sqrt(0.9 * 0.1 / runs)


def test_ranges_contain_the_intervals_and_add_the_aspects_of_a_class(aspects):
    counts = np.array([300, 310, 150, 160, 50, 30])
    given = dataclasses.replace(no_drops(aspects), counts=counts)
    found = with_model_range(given)
    assert (found + found).model is None
    for each, model in zip(given.intervals(), found.model_intervals(), strict=True):
        assert model.lower < each.lower <= each.probability == model.probability
        assert each.upper < model.upper
    few = dataclasses.replace(given, counts=np.array([4, 0, 3, 3, 0, 0]), interval='simultaneous')
    alike = with_model_range(few).by_class()
    for each, model in zip(alike.intervals(), alike.model_intervals(), strict=True):
        assert model.lower <= each.lower <= each.upper <= model.upper
    first, *_ = found.by_class().model_intervals()
    assert [first.lower, first.upper] == pytest.approx(model_bounds([610], 1000, 0.0, 0.95)[0])


def test_range_is_about_the_draws_or_about_the_distribution(aspects):
    counts = np.array([500, 500, 0, 0, 0, 0])
    given = dataclasses.replace(no_drops(aspects), counts=counts)
    ids = np.tile([1, 1, 1, 2, 3], (8, 100))
    made = (Draws(ids, ('friction',), about) for about in (True, False))
    about, alone = (with_model_range(given, draws) for draws in made)
    assert about.model.by_class[0, 0] < alone.model.by_class[0, 0]
    # Never seen: what was not observed can be impossible, and the draws have it.
    assert alone.model.by_aspect[2, 0] == 0
    assert about.model.by_class[1, 1] > 0.2


def test_range_of_several_aspects_together(aspects):
    rng = np.random.default_rng(1)
    # The shares of 1 and 2 vary between the draws, but not their sum.
    first = rng.uniform(0.1, 0.7, (16, 1))
    u = rng.random((16, 2000))
    ids = np.where(u < 0.8, np.where(u < first, 1, 2), 3)
    counts = np.bincount(ids.ravel(), minlength=7)[1:]
    given = dataclasses.replace(no_drops(aspects), counts=counts)
    ranged = with_model_range(given, Draws(ids, ('friction',)))
    one, both = (combined_range(ranged, each) for each in ((1,), (1, 2)))
    assert both.upper - both.lower < 0.5 * (one.upper - one.lower)
    class_range = ranged.by_class().model_intervals()[0]
    assert combined_range(ranged, [a.id for a in aspects.classes()[0]]) == class_range
    known = dataclasses.replace(ranged.model, draws=None)
    assert combined_range(dataclasses.replace(ranged, model=known), (1, 2)) is None
