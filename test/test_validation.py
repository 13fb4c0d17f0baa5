"""The fit, the measured bodies and the shifts of `make validate`."""

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import binom
from validation import engines as validate_engines
from validation.fit import Posterior, polynomial_deviance
from validation.measured import deviance
from validation.paired import ONE_SIDED, shifts

from resting_aspects_ros.statistics.model_range import discrepancy


def test_deviance_is_twice_the_log_likelihood_ratio():
    count, rolls, share = 30, 100, 0.2
    ratio = binom.logpmf(count, rolls, count / rolls) - binom.logpmf(count, rolls, share)
    assert deviance([count], [rolls], [share])[0] == pytest.approx(2 * ratio)


def made_posterior(scale, rng, cases=12, points=200):
    """Counts of which the model is off by a known scale, and points of one condition."""
    position = rng.random(points)
    slopes, middles = rng.normal(0, 2, cases), rng.normal(-1, 1, cases)
    truth = middles + slopes * (position[0] - 0.5)
    off = discrepancy(expit(truth), scale) * rng.standard_normal(cases)
    rolls = np.full(cases, 1000)
    counts = rng.binomial(rolls, expit(truth + off))
    shares = expit(middles + slopes * (position[:, None] - 0.5))
    return Posterior(counts, rolls, shares, 100_000), position


def test_fit_finds_the_conditions_of_the_counts():
    posterior, position = made_posterior(0.05, np.random.default_rng(1))
    weights = posterior.weights().sum(axis=0)
    mean = weights @ position
    spread = np.sqrt(weights @ (position - mean) ** 2)
    assert spread < 0.1  # of 0.29 before the counts
    assert abs(mean - position[0]) < 3 * spread


def test_ranges_of_cases_that_are_left_out_contain_their_share():
    rng, inside, n = np.random.default_rng(2), 0, 0
    for _ in range(25):
        posterior, _ = made_posterior(0.4, rng)
        for k in range(12):
            low, _, high = posterior.range_of(k, 1.645, without=k)
            inside += low <= posterior.counts[k] / posterior.rolls[k] <= high
            n += 1
    # The scale is estimated from 11 cases, and the measured share has noise of its own.
    assert 0.8 < inside / n < 0.97


def test_polynomial_through_all_cases_leaves_no_deviance():
    counts, rolls = np.array([5, 40, 200, 370]), np.array([500, 400, 400, 400])
    x = np.array([0.0, 1.0, 2.0, 3.0])
    assert polynomial_deviance(x, counts, rolls, 3) == pytest.approx(0, abs=1e-6)


def test_shift_and_error_are_those_of_paired_shares():
    counts = np.zeros((1, 5, 5), dtype=np.int64)
    counts[0, 0, 0], counts[0, 0, 1], counts[0, 1, 0], counts[0, 1, 1] = 500, 40, 10, 450
    found = shifts(counts)
    assert found.largest[0] == 0
    assert abs(found.shift[0, :2]).tolist() == [0.03, 0.03]
    # 40 parts leave the first column and 10 come: sqrt(50 - 30^2 / 1000) / 1000.
    assert found.error[0, 0] == pytest.approx(np.sqrt(50 - 0.9) / 1000, rel=0.02)
    assert found.different == pytest.approx(0.05)
    assert found.bound == pytest.approx(0.03 + ONE_SIDED * found.error[0, 0])


def test_bound_covers_the_largest_change_in_19_of_20_samples():
    generator = np.random.default_rng(1)
    p = np.array([0.28, 0.02, 0.0, 0.1, 0.5, 0.02, 0.02, 0.01, 0.05])
    true = p.reshape(3, 3)
    largest = abs(true.sum(axis=0) - true.sum(axis=1)).max()
    n = 1000
    samples = generator.multinomial(2000, p, size=n).reshape(n, 1, 3, 3)
    covered = np.mean([shifts(counts).bound >= largest for counts in samples])
    # The share of covered samples has the standard error sqrt(0.95 x 0.05 / n).
    assert covered > 0.95 - 3 * np.sqrt(0.95 * 0.05 / n)


def test_difference_of_two_shares_is_that_of_a_fourfold_table():
    one, other = np.array([[300, 700, 0]]), np.array([[360, 640, 0]])
    cells = validate_engines.difference(one, other).split(' | ')
    # Pearson's statistic of a table of two rows and two columns.
    statistic = 2000 * (300 * 640 - 360 * 700) ** 2 / (1000 * 1000 * 660 * 1340)
    assert cells[0] == f'{statistic:.1f} (1)'
    assert abs(float(cells[2])) == pytest.approx(0.06)
    error = 1.96 * np.sqrt((0.3 * 0.7 + 0.36 * 0.64) / 1000)
    low, high = map(float, cells[3].split(' to '))
    assert (high - low) / 2 == pytest.approx(error, abs=1e-4)
