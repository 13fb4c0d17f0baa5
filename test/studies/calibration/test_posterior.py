"""The posterior against formulas and exact posteriors, and its coverage on known counts."""

import dataclasses

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import beta, betabinom, binom, dirichlet, dirichlet_multinomial, kstest

from resting_aspects_ros.studies.calibration.checks import find_estimates
from resting_aspects_ros.studies.calibration.posterior import (
    DISCREPANCIES,
    DISCREPANCY_SCALE,
    EFFECTIVE,
    Fit,
    Mixture,
    fit_surface,
    log_density,
    own_discrepancies,
    share_moments,
)

from .conftest import HEIGHTS, box_shares, surface_counts

TRUTH = (0.4, 0.6)


def moments(fit):
    """Return mean and standard deviation of the points of a fit."""
    weights = fit.weights().sum(axis=0)
    mean = weights @ fit.points
    return mean, np.sqrt(weights @ (fit.points - mean) ** 2)


@pytest.mark.parametrize('rho', [0.3, 0.01, 1e-4])
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


def test_simulated_shares_have_a_dirichlet_distribution():
    shares, rho = share_moments(np.array([[12, 30, 0]]))
    theirs = dirichlet([12 + 1 / 3, 30 + 1 / 3, 1 / 3])
    assert shares[0] == pytest.approx(theirs.mean())
    assert rho[0] * shares[0] * (1 - shares[0]) == pytest.approx(theirs.var())


def test_discrepancies_of_parts_vary_about_the_common_one():
    own = own_discrepancies(DISCREPANCIES)
    assert own.sum(axis=1) == pytest.approx(1)
    rng = np.random.default_rng(1)
    k = 8
    drawn = DISCREPANCIES[k] * np.sqrt(4 / rng.chisquare(4, 20_000))
    edges = np.sqrt(DISCREPANCIES[1:] * DISCREPANCIES[:-1])
    shares = np.bincount(np.searchsorted(edges, drawn), minlength=len(own)) / len(drawn)
    assert np.abs(shares - own[k]).max() < 4 * np.sqrt(0.25 / len(drawn))


def test_mixture_is_drawn_with_its_density():
    rng = np.random.default_rng(2)
    mixture = Mixture(np.array([[-1.0], [2.0]]), np.array([0.3, 0.7]), np.array([[0.4]]), 0.2)
    x = np.linspace(-9, 9, 6001)
    density = np.exp(mixture.log_density(x[:, None]))
    cumulative = np.cumsum(density) * (x[1] - x[0])
    assert cumulative[-1] == pytest.approx(1, abs=1e-6)
    drawn = mixture.draw(4000, rng)[:, 0]
    assert kstest(drawn, lambda values: np.interp(values, x, cumulative)).pvalue > 0.001


def test_marginal_of_a_mixture_is_its_integral():
    root = np.array([[0.5, 0.0], [0.3, 0.4]])
    mixture = Mixture(np.array([[0.0, 1.0], [1.0, -1.0]]), np.array([0.4, 0.6]), root, 0.1)
    x = np.linspace(-7, 7, 701)
    pairs = np.stack(np.meshgrid([0.3], x, indexing='ij'), axis=-1).reshape(-1, 2)
    integral = np.exp(mixture.log_density(pairs)).sum() * (x[1] - x[0])
    one = np.exp(mixture.marginal(0).log_density(np.array([[0.3]])))
    assert one == pytest.approx([integral], rel=1e-6)


def one_box(counts):
    """Return counts of one box, with one fitted condition."""
    given = surface_counts([counts], heights=HEIGHTS[:1])
    return dataclasses.replace(given, factors=given.factors[:1])


def test_share_that_is_the_condition_has_a_beta_posterior():
    """Uniform prior and a binomial count: Beta (k + 1, n - k + 1)."""
    rng, drops = np.random.default_rng(4), 100_000

    def simulate(points):
        return [rng.multinomial(drops, np.hstack([points, 1 - points]))]

    fit = fit_surface(one_box((30, 100)), simulate, points=256, seed=1, discrepancy=False)
    exact = beta(31, 71)
    mean, deviation = moments(fit)
    error = exact.std() / np.sqrt(EFFECTIVE)
    assert mean == pytest.approx([exact.mean()], abs=4 * error)
    assert deviation == pytest.approx([exact.std()], abs=4 * error / np.sqrt(2))
    drawn = fit.draws(4000, rng)[:, 0]
    assert np.quantile(drawn, [0.05, 0.95]) == pytest.approx(exact.ppf([0.05, 0.95]), abs=0.02)


def test_simulated_drops_add_their_variance():
    """Half as certain: as many simulated drops as counted ones double the variance."""
    counts = np.array([[50, 50]])
    given = one_box((50, 100))
    shares = np.linspace(0.01, 0.99, 99)
    simulated = np.round(100 * np.stack([shares, 1 - shares], axis=1)).astype(np.int64)
    fit = Fit(given, shares[:, None], (simulated,), np.zeros(99), discrepancy=False)
    variance = moments(fit)[1] ** 2
    assert variance == pytest.approx([2 * 0.25 / 100], rel=0.05)
    assert counts.sum() == given.drops
    assert fit.errors == pytest.approx([1], rel=0.02)


def test_shares_that_do_not_depend_on_the_conditions_leave_the_prior():
    rng = np.random.default_rng(4)

    def simulate(points):
        return [rng.multinomial(100, [0.4, 0.6], size=len(points)) for _ in HEIGHTS]

    fit = fit_surface(surface_counts([(40, 100)] * 3), simulate, points=512, seed=1)
    mean, deviation = moments(fit)
    error = np.sqrt(1 / 12 / fit.effective)
    assert mean == pytest.approx([0.5, 0.5], abs=4 * error)
    assert deviation == pytest.approx([np.sqrt(1 / 12)] * 2, abs=4 * error)
    # The density on the unit cube is 1, also near its borders.
    places = np.random.default_rng(5).random((500, 2))
    assert fit.density(places, 0, 1).mean() == pytest.approx(1, abs=0.1)


def exact_posterior(counts, side=60):
    """Return points of a grid and their weights, with the shares that are known exactly."""
    middles = (np.arange(side) + 0.5) / side
    grid = np.stack(np.meshgrid(middles, middles, indexing='ij'), axis=-1).reshape(-1, 2)
    prior = np.exp(-((DISCREPANCIES / DISCREPANCY_SCALE) ** 2) / 2) * DISCREPANCIES
    own = own_discrepancies(DISCREPANCIES)
    total = np.ones((len(DISCREPANCIES), len(grid)))
    for (k, n), height in zip(counts, HEIGHTS, strict=True):
        p = box_shares(grid, height)[:, 0]
        scale = (1 / DISCREPANCIES**2 - 1)[:, None]
        total *= own @ betabinom.pmf(k, n, p * scale, (1 - p) * scale)
    weights = (prior[:, None] * total).sum(axis=0)
    return grid, weights / weights.sum()


@pytest.mark.parametrize('drops', [50, 1000])
def test_posterior_is_the_exact_one_on_a_grid(invented, drops):
    counts = invented.counted(TRUTH, drops, np.random.default_rng(3))
    grid, weights = exact_posterior(counts)
    exact = weights @ grid
    deviation = np.sqrt(weights @ (grid - exact) ** 2)
    fit = invented.fit(counts, per_point=20 * drops)
    mean, own = moments(fit)
    assert fit.effective >= EFFECTIVE
    assert mean == pytest.approx(exact, abs=float(4 * deviation.max() / np.sqrt(EFFECTIVE)))
    # Besides the sampling of a standard deviation, 2 / 20 of the variance from the simulation.
    assert own == pytest.approx(deviation, rel=4 / np.sqrt(2 * EFFECTIVE) + 0.05)


def test_names_and_order_of_groups_and_parts_have_no_effect(agreeing):
    parts = tuple(
        dataclasses.replace(
            part, groups=part.groups[::-1], names=part.names[::-1], counts=part.counts[::-1]
        )
        for part in agreeing.given.parts[::-1]
    )
    other = dataclasses.replace(
        agreeing,
        given=dataclasses.replace(agreeing.given, parts=parts),
        simulated=tuple(each[:, ::-1] for each in agreeing.simulated[::-1]),
    )
    assert other.weights() == pytest.approx(agreeing.weights(), abs=1e-12)


def test_same_seed_gives_the_same_points(invented):
    counts = invented.counted(TRUTH, 100, np.random.default_rng(3))
    one, same, other = (invented.fit(counts, seed=seed) for seed in (1, 1, 2))
    assert (one.points == same.points).all()
    assert not (one.points[:64] == other.points[:64]).any()


def test_points_are_added_where_the_posterior_lies(invented):
    fit = invented.fit(invented.counted(TRUTH, 1000, np.random.default_rng(3)))
    assert fit.rounds >= 1
    assert len(fit.points) == 64 + 32 * fit.rounds
    mean, deviation = moments(fit)
    near = (np.abs(fit.points - mean) < 3 * deviation).all(axis=1)
    assert near[64:].mean() > 2 * near[:64].mean()


def test_rounds_are_limited_and_reported(invented):
    seen = []
    counts = invented.counted(TRUTH, 20_000, np.random.default_rng(3))
    fit = invented.fit(counts, discrepancy=False, rounds=2, note=seen.append)
    assert fit.rounds == 2
    assert [each.rounds for each in seen] == [0, 1]
    assert fit.effective < EFFECTIVE


def test_stopped_work_has_the_rounds_that_are_complete():
    rng, calls = np.random.default_rng(1), []

    def simulate(points):
        calls.append(points)
        if len(calls) > limit:
            return None
        return [rng.multinomial(100, box_shares(points, h)) for h in HEIGHTS]

    given = surface_counts([(5000, 10_000)] * 3)
    limit = 2
    fit = fit_surface(given, simulate, points=64, seed=1)
    assert (fit.rounds, len(fit.points)) == (1, 96)
    limit = 0
    assert fit_surface(given, simulate, points=64, seed=1) is None


def test_more_counts_narrow_the_region(invented):
    rng = np.random.default_rng(3)
    few, many = (
        invented.fit(invented.counted(TRUTH, n, rng), discrepancy=False) for n in (50, 2000)
    )
    assert (moments(many)[1] < moments(few)[1] / 1.5).all()


def test_discrepancy_widens_the_region(invented):
    counts = invented.counted(TRUTH, 1000, np.random.default_rng(3))
    exact, wide = (invented.fit(counts, discrepancy=d) for d in (False, True))
    assert (moments(wide)[1] > 1.2 * moments(exact)[1]).all()


def test_discrepancy_is_found_where_counts_contradict(agreeing, contradicting):
    means = [
        float(fit.weights().sum(axis=1) @ fit.discrepancies) for fit in (agreeing, contradicting)
    ]
    assert means[0] < 0.07  # less than the mean of the prior, 0.08
    assert means[1] > 0.15


def test_corrupted_part_has_little_effect(invented):
    """A part that contradicts the two others moves the result less with a discrepancy."""
    counts = invented.counted(TRUTH, 1000, np.random.default_rng(3))
    wrong = [*counts[:2], (950, 1000)]
    shifts = []
    for discrepancy in (False, True):
        right, corrupted = (invented.fit(c, discrepancy=discrepancy) for c in (counts, wrong))
        mean, deviation = moments(corrupted)
        shifts.append(float((np.abs(mean - moments(right)[0]) / deviation).max()))
    assert shifts[1] < shifts[0] / 3


def test_a_part_that_is_left_out_has_no_effect(agreeing):
    moved = dataclasses.replace(agreeing.given.parts[2], counts=np.array([300, 0]))
    given = dataclasses.replace(agreeing.given, parts=(*agreeing.given.parts[:2], moved))
    other = dataclasses.replace(agreeing, given=given)
    assert other.weights(without=2) == pytest.approx(agreeing.weights(without=2))
    assert not np.allclose(other.weights(), agreeing.weights())


def test_smooth_posterior_has_mean_and_covariance_of_the_points(agreeing):
    drawn = ndtr(agreeing.smooth.draw(40_000, np.random.default_rng(1)))
    mean, deviation = moments(agreeing)
    assert drawn.mean(axis=0) == pytest.approx(mean, abs=0.02)
    assert drawn.std(axis=0) == pytest.approx(deviation, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize('discrepancy', [0.0, 0.1])
def test_intervals_contain_the_truth_as_often_as_they_say(invented, discrepancy):
    """Counts at random conditions, whose shares deviate from the simulation if there is one."""
    rng, inside = np.random.default_rng(11), []
    for seed in range(100):
        truth = rng.random(2)
        counts = []
        for height in HEIGHTS:
            p = box_shares([truth], height)[0]
            if discrepancy:
                p = rng.dirichlet(p * (1 / discrepancy**2 - 1))
            counts.append((rng.binomial(200, p[0]), 200))
        fit = invented.fit(counts, per_point=800, seed=seed, discrepancy=discrepancy > 0)
        for each, unit in zip(find_estimates(fit, rng), truth, strict=True):
            value = float(each.factor.values(np.array([unit]))[0])
            inside.append(each.low <= value <= each.high)
    # 90 % of 200 intervals, with three standard errors; the simulated drops only widen them.
    assert np.mean(inside) >= 0.9 - 3 * 0.021
    assert np.mean(inside) <= 0.98
