"""The posterior against formulas, and its coverage on counts of known origin."""

import numpy as np
import pytest
from scipy.stats import binom, dirichlet_multinomial

from resting_aspects_ros.studies.calibration.likelihood import log_density, surrogate_rho
from resting_aspects_ros.studies.calibration.posterior import level_at, with_counts

REPETITIONS = 200


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


def test_surrogate_error_is_an_intraclass_correlation():
    # Variance of a share: p (1 - p) rho.
    shares = np.array([[0.2, 0.8]])
    assert surrogate_rho(shares, 0.03 * shares * (1 - shares)) == pytest.approx([0.03])


def test_more_counts_narrow_the_region(invented):
    rng = np.random.default_rng(3)
    few, many = (
        invented.fit(invented.counted((0.4, 0.6), n, rng), discrepancy=False) for n in (50, 2000)
    )
    assert many.posterior.effective < few.posterior.effective / 3


def test_discrepancy_widens_the_region(invented):
    counts = invented.counted((0.4, 0.6), 1000, np.random.default_rng(3))
    exact, wide = (invented.fit(counts, discrepancy=d) for d in (False, True))
    assert wide.posterior.effective > 1.5 * exact.posterior.effective


def test_discrepancy_is_found_where_counts_contradict(agreeing, contradicting):
    means = [
        float(fit.posterior.weights().sum(axis=1) @ fit.posterior.discrepancies)
        for fit in (agreeing, contradicting)
    ]
    assert means[0] < 0.07  # less than the mean of the prior, 0.08
    assert means[1] > 0.15


def test_a_part_that_is_left_out_has_no_effect(invented):
    rng = np.random.default_rng(3)
    counts = invented.counted((0.4, 0.6), 300, rng)
    one = invented.fit(counts)
    other = invented.fit([*counts[:2], (300, 300)])
    assert one.posterior.weights(without=2) == pytest.approx(other.posterior.weights(without=2))


@pytest.mark.slow
def test_region_contains_the_truth_as_often_as_it_says(invented):
    rng = np.random.default_rng(11)
    posterior = invented.fit([(150, 300)] * 3, discrepancy=False).posterior
    levels = []
    for _ in range(REPETITIONS):
        truth = rng.random(2)
        counts = [np.array([k, n - k]) for k, n in invented.counted(truth, 300, rng)]
        found = with_counts(posterior, counts)
        levels.append(level_at(found, invented.surrogates, counts, truth))
    inside = np.mean(np.array(levels) <= 0.9)
    # 85 to 95 of 100, and three standard errors of 200 repetitions less the margin: 0.021 each.
    assert 0.85 <= inside <= 0.96
