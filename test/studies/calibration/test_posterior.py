"""The posterior, its checks and predictions: formulas, exact posteriors and coverage."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, logit, logsumexp
from scipy.stats import betabinom, binom, dirichlet_multinomial, power_divergence

from resting_aspects_ros.statistics.model_range import DISCREPANCY, discrepancy
from resting_aspects_ros.studies.calibration import posterior
from resting_aspects_ros.studies.calibration.posterior import (
    DISCREPANCIES,
    DISCREPANCY_SCALE,
    ShareModel,
    deviated,
    find_fit_test,
    fit_surface,
    log_density,
    predict,
    shortest_interval,
)

from .conftest import HEIGHTS, box_shares, counted, fitted, surface_counts

TRUTH = (0.4, 0.6)


def moments(fit):
    """Return mean and standard deviation of the posterior on the unit cube."""
    weights = fit.weights().sum(axis=0)
    mean = weights @ fit.candidates
    return mean, np.sqrt(weights @ (fit.candidates - mean) ** 2)


@pytest.mark.parametrize('rho', [0.3, 1e-4])
def test_density_is_that_of_scipy(rho):
    counts = np.array([[12, 30, 8], [0, 45, 5]])
    shares = np.array([[0.2, 0.7, 0.1], [0.3, 0.3, 0.4]])
    found = log_density(counts[:, None], shares, np.full(2, rho))
    theirs = [
        [dirichlet_multinomial.logpmf(y, p * (1 / rho - 1), y.sum()) for p in shares]
        for y in counts
    ]
    # Up to a constant of the counts.
    assert found[:, 0] - found[:, 1] == pytest.approx(np.subtract(*np.transpose(theirs)), rel=1e-6)


def test_no_discrepancy_is_the_multinomial():
    shares = np.stack([np.linspace(0.1, 0.9, 9), np.linspace(0.9, 0.1, 9)], axis=1)
    found = log_density(np.array([30, 70]), shares, np.zeros(9))
    theirs = binom.logpmf(30, 100, shares[:, 0])
    assert found - found[2] == pytest.approx(theirs - theirs[2], rel=1e-4, abs=1e-3)


def test_polynomial_is_found_again_within_its_error():
    rng = np.random.default_rng(1)
    points = rng.random((80, 2))

    def logits(x, y):
        return -0.5 + 2 * x - 1.5 * y + x * y

    p = expit(logits(*(2 * points - 1).T))
    counts = rng.binomial(400, p)
    model = ShareModel.of(points, np.stack([counts, 400 - counts], axis=1), np.ones(80))
    where = rng.random((200, 2))
    shares, error = model.at(where)
    exact = expit(logits(*(2 * where - 1).T))
    apart = (shares[:, 0] - exact) / np.sqrt(error * exact * (1 - exact))
    assert shares.sum(axis=1) == pytest.approx(1)
    assert np.sqrt((apart**2).mean()) < 2  # standard errors
    # 80 points with 400 drops each, and 21 coefficients.
    assert np.sqrt(np.median(error)) == pytest.approx(np.sqrt(21 / 80 / 400), rel=0.5)


def test_misfit_of_a_polynomial_widens_its_error():
    """Shares that scatter by 10 points about a constant have a misfit of (0.1 / 0.5)^2."""
    rng = np.random.default_rng(1)
    points, scatter = rng.random((300, 1)), 0.5 + 0.1 * rng.choice([-1, 1], 300)
    counts = rng.binomial(1000, scatter)
    model = ShareModel.of(points, np.stack([counts, 1000 - counts], axis=1), np.ones(300))
    assert model.misfit == pytest.approx(0.04, rel=0.1)


def exact_posterior(counts, side=60):
    """Return points of a grid and their weights, with the shares that are known exactly."""
    middles = (np.arange(side) + 0.5) / side
    grid = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    prior = np.exp(-((DISCREPANCIES / DISCREPANCY_SCALE) ** 2) / 2) * np.gradient(DISCREPANCIES)
    logs = np.log(prior)[:, None] + np.zeros(len(grid))
    scale = (1 / DISCREPANCIES**2 - 1)[:, None]
    for (k, n), height in zip(counts, HEIGHTS, strict=True):
        p = box_shares(grid, height)[:, 0]
        logs += betabinom.logpmf(k, n, p * scale, (1 - p) * scale)
    return grid, np.exp(logs - logsumexp(logs)).sum(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize('drops', [50, 1000])
def test_posterior_is_the_exact_one_on_a_grid(drops):
    counts = counted(TRUTH, drops, np.random.default_rng(3))
    grid, weights = exact_posterior(counts)
    exact = weights @ grid
    deviation = np.sqrt(weights @ (grid - exact) ** 2)
    mean, own = moments(fitted(counts, per_point=20 * drops))
    assert mean == pytest.approx(exact, abs=float(0.2 * deviation.max()))
    assert own == pytest.approx(deviation, rel=0.15)


def test_region_of_highest_density_has_its_probability(agreeing):
    inside = agreeing.log_density(agreeing.candidates) >= agreeing.level(0.9)
    assert agreeing.weights().sum(axis=0)[inside].sum() == pytest.approx(0.9, abs=0.01)


def test_stopped_work_has_the_rounds_that_are_complete():
    generator, rounds = np.random.default_rng(1), iter([True, True])

    def simulate(points):
        if not next(rounds, False):
            return None
        return [generator.multinomial(100, box_shares(points, h)) for h in HEIGHTS]

    given = surface_counts([(5000, 10_000)] * 3)
    fit = fit_surface(given, simulate, points=64, seed=1)
    assert (len(fit.points), fit.checked) == (96, None)
    assert fit_surface(given, simulate, points=64, seed=1) is None


@pytest.mark.slow
def test_regions_p_values_and_intervals_hold_as_often_as_stated(monkeypatch):
    """Counts of bodies that deviate from surfaces within the ranges as measured ones do."""
    monkeypatch.setattr(posterior, 'CANDIDATES', 1 << 10)
    generator, n = np.random.default_rng(5), 24
    inside, p, predicted = [], [], []
    for seed in range(n):
        truth, counts = generator.random(2), []
        for height in HEIGHTS:
            real = deviated(box_shares([truth], height), DISCREPANCY, generator)
            counts.append((generator.binomial(300, real[0, 0]), 300))
        fit = fitted(counts, per_point=150, seed=seed)
        inside.append(fit.log_density(truth[None])[0] >= fit.level(0.9))
        p.append(find_fit_test(fit, generator).p)
        predicted += [each.inside for each in predict(fit, generator, left_out=True)]
    # Three standard deviations of regions, four of the p values, three of the predictions.
    assert abs(sum(inside) - 0.92 * n) <= 3 * np.sqrt(n * 0.9 * 0.1)
    assert np.mean(np.array(p) < 0.1) < 0.1 + 4 * np.sqrt(0.09 / n)
    assert np.mean(predicted) > 0.9 - 3 * np.sqrt(0.09 / len(predicted))


def rng():
    return np.random.default_rng(1)


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=40))
def test_shortest_interval_is_ascending_and_has_its_values(values):
    low, high = shortest_interval(np.array(values), np.ones(len(values)))
    assert low <= high
    assert sum(low <= each <= high for each in values) >= 0.9 * len(values)
    # Weights count as often as they say.
    weights = np.array([0.5, 0.2, 0.25, 0.05])
    assert shortest_interval(np.array([3.0, 1.0, 2.0, 9.0]), weights) == (1.0, 3.0)


def test_statistic_is_that_of_scipy_for_the_best_candidate(agreeing):
    """Without a discrepancy, it is Pearson's."""
    exact = dataclasses.replace(agreeing, discrepancies=np.zeros(1))
    theirs = np.zeros(len(exact.candidates))
    for part, (shares, _) in zip(exact.given.parts, exact.shares, strict=True):
        theirs += power_divergence(part.counts, part.drops * shares, 0, 1, 'pearson').statistic
    assert find_fit_test(exact, rng()).statistic == pytest.approx(theirs.min())


def test_many_parts_need_hardly_more_memory(agreeing, monkeypatch):
    monkeypatch.setattr(posterior, 'REPETITIONS', 99)
    given = dataclasses.replace(agreeing.given, parts=8 * agreeing.given.parts)
    many = dataclasses.replace(agreeing, given=given, models=8 * agreeing.models)
    assert len(many.shares) == len(given.parts)  # they are kept
    tracemalloc.start()
    try:
        find_fit_test(many, rng())
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    tables = 8 * posterior.REPETITIONS * len(many.candidates)  # bytes of one part
    assert most < len(given.parts) * tables / 2


def test_counts_of_the_simulation_are_explained(agreeing, contradicting):
    assert find_fit_test(agreeing, rng()).p > 0.05
    found = find_fit_test(contradicting, rng())
    assert found.p == pytest.approx(1 / (1 + posterior.REPETITIONS))
    assert found.part in (0, 2)  # the flat and the tall box, whose labels are swapped
    means = [
        float(fit.weights().sum(axis=1) @ fit.discrepancies) for fit in (agreeing, contradicting)
    ]
    assert means[0] < 0.07  # less than the mean of the prior, 0.08
    assert means[1] > 0.15


@pytest.mark.parametrize('shares', [[0.03, 0.97], [0.3, 0.3, 0.2, 0.15, 0.05]])
def test_log_odds_deviate_as_those_of_measured_bodies(shares):
    given = np.tile(shares, (20_000, 1))
    found = deviated(given, DISCREPANCY, rng())
    assert found.sum(axis=1) == pytest.approx(1)
    spread = logit(found).std(axis=0)
    assert spread == pytest.approx(discrepancy(np.array(shares)), rel=0.15)


def test_a_part_that_is_left_out_is_predicted_by_the_others(agreeing):
    moved = dataclasses.replace(agreeing.given.parts[2], counts=np.array([300, 0]))
    given = dataclasses.replace(agreeing.given, parts=(*agreeing.given.parts[:2], moved))
    other = dataclasses.replace(agreeing, given=given)
    assert not np.allclose(other.weights(), agreeing.weights())
    right, wrong = (predict(each, rng(), left_out=True)[2] for each in (agreeing, other))
    assert right.model == pytest.approx(wrong.model)
    assert right.deviation < 0.1 < wrong.deviation
    assert not wrong.inside
    given = dataclasses.replace(agreeing.given, parts=agreeing.given.parts[:1])
    alone = dataclasses.replace(agreeing, given=given, models=agreeing.models[:1])
    assert predict(alone, rng(), left_out=True) == []
