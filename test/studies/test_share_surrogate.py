"""Surrogate of shares: against known shares, and its uncertainty."""

import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import qmc

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate
from resting_aspects_ros.studies.softmax_fit import contrasts, fit_softmax, log_evidence
from resting_aspects_ros.studies.surrogate_form import likely_scales

DROPS = 400


def smooth(points):
    """Shares of three classes, which no polynomial of the logits has."""
    x, y = points.T
    logits = [np.sin(3 * x) + y**2, 2 * x * y - 1, np.cos(2 * y + x) - 2 * x]
    return softmax(np.stack(logits, axis=1), axis=1)


@pytest.fixture(scope='module')
def surrogates():
    found = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        points = qmc.Sobol(2, seed=rng).random(32)
        found.append(ShareSurrogate.fit(points, rng.multinomial(DROPS, smooth(points)), rng))
    return found


def test_shares_are_near_the_truth_where_no_drops_were_made(surrogates):
    points = np.random.default_rng(0).random((300, 2))
    errors = np.array([s.shares(points) - smooth(points) for s in surrogates])
    # About 12 numbers for each of 3 classes are fitted to 32 points: an error of a point's own
    # drops, sqrt(0.22 / 400), times sqrt(12 / 32).
    assert np.sqrt((errors**2).mean()) < 0.0235 * np.sqrt(12 / 32)
    assert np.abs(errors.mean(axis=(0, 1))).max() < 0.005


def test_draws_cover_the_truth(surrogates):
    points = np.random.default_rng(0).random((100, 2))
    rng = np.random.default_rng(1)
    covered = []
    for each in surrogates:
        low, high = np.quantile(each.draws(points, rng, 200), [0.05, 0.95], axis=0)
        covered.append(((low <= smooth(points)) & (smooth(points) <= high)).mean())
    # The points of one surrogate are dependent: n is the number of surrogates.
    error = np.std(covered) / np.sqrt(len(covered))
    assert abs(np.mean(covered) - 0.9) < 0.03 + 3 * error


def test_cross_validated_error_is_the_error_of_the_shares(surrogates):
    points = np.random.default_rng(0).random((300, 2))
    errors = [np.sqrt(((s.shares(points) - smooth(points)) ** 2).mean()) for s in surrogates]
    stated = np.sqrt(np.mean([s.cross_validated_error**2 for s in surrogates]))
    # It is that of a fit with fewer points, among them those at the edge.
    assert 0.3 < stated / np.sqrt(np.mean(np.square(errors))) < 3


def test_error_of_a_form_that_does_not_fit_widens_the_draws():
    rng = np.random.default_rng(3)
    points = qmc.Sobol(2, seed=rng).random(32)
    step = np.where(points[:, :1] > 0.5, [[0.9, 0.1]], [[0.2, 0.8]])
    found = ShareSurrogate.fit(points, rng.multinomial(100_000, step), rng)
    assert found.inflation > 2
    assert found.cross_validated_error > 0.01


def test_classes_without_drops_have_small_shares():
    rng = np.random.default_rng(3)
    points = rng.random((20, 2))
    counts = np.column_stack([np.full(20, 300), np.zeros(20)])
    found = ShareSurrogate.fit(points, counts, rng)
    shares = found.shares(points)
    assert (shares[:, 1] < 1 / 300).all()
    assert np.quantile(found.draws(points, rng, 100)[:, :, 1], 0.95) < 3 / 300


def test_order_of_the_classes_does_not_matter():
    rng = np.random.default_rng(3)
    points = rng.random((20, 2))
    counts = rng.multinomial(100, smooth(points))
    forward = ShareSurrogate.fit(points, counts, np.random.default_rng(0))
    backward = ShareSurrogate.fit(points, counts[:, ::-1], np.random.default_rng(0))
    assert forward.shares(points)[:, ::-1] == pytest.approx(backward.shares(points), abs=1e-6)


def test_drops_at_one_point_can_be_divided():
    rng = np.random.default_rng(3)
    points = rng.random((10, 1))
    counts = rng.multinomial(100, smooth(np.hstack([points, points])))
    features = np.hstack([np.ones((10, 1)), points])
    precision = np.array([0.01, 0.1])
    once = fit_softmax(features, counts.astype(float), precision)
    twice = fit_softmax(np.vstack([features] * 2), np.vstack([counts / 2] * 2), precision)
    assert once.weights == pytest.approx(twice.weights, abs=1e-6)


def test_fit_is_the_maximum_of_the_likelihood():
    counts = np.array([[10.0, 30.0, 60.0]])
    found = fit_softmax(np.ones((1, 1)), counts, np.array([1e-9]))
    assert softmax(found.logits(np.ones((1, 1)))) == pytest.approx(counts / 100, abs=1e-5)
    # The inverse precision is the covariance of multinomial logits, projected on the contrasts.
    shares = counts[0] / 100
    fisher = 100 * contrasts(3) @ (np.diag(shares) - np.outer(shares, shares)) @ contrasts(3).T
    assert found.precision_root.T @ found.precision_root == pytest.approx(fisher, abs=1e-3)


@pytest.mark.parametrize(
    ('points', 'counts', 'message'),
    [
        ([[0.0], [1.0]], [[1], [2]], 'at least 2 classes'),
        ([[0.0], [1.0]], [[1, 2]], r'expected \(2, classes\)'),
        ([[0.0], [np.nan]], [[1, 2], [3, 4]], 'invalid points'),
        ([[0.0], [1.0]], [[1, -2], [3, 4]], 'not negative'),
        ([[0.0], [1.0]], [[1, 2], [0, 0]], 'invalid number of points 1'),
    ],
)
def test_invalid_input_is_named(points, counts, message):
    with pytest.raises(InvalidValueError, match=message):
        ShareSurrogate.fit(points, counts, np.random.default_rng(0))


def test_variances_are_those_of_the_draws(surrogates):
    points = np.random.default_rng(0).random((20, 2))
    drawn = surrogates[0].draws(points, np.random.default_rng(1), 4000).var(axis=0)
    found = surrogates[0].variances(points)
    # Four standard errors of a variance of 4000 draws. Of a small share p, whose logarithm has
    # the variance v = found / p^2, the lognormal distribution has 1 + 1.5 v + ... times p^2 v.
    allowed = 4 * np.sqrt(2 / 4000) + 2 * found / surrogates[0].shares(points) ** 2
    assert (np.abs(drawn / found - 1) < allowed).all()


def test_evidence_is_the_integral_over_the_weights():
    # One binary logit: the integral over its weight is one-dimensional.
    features, counts = np.ones((1, 1)), np.array([[30.0, 70.0]])
    values = []
    for precision in (0.1, 10.0):
        found = fit_softmax(features, counts, np.array([precision]))
        weight = np.linspace(-8, 8, 20_001)
        logits = np.sqrt(2) * weight  # of the second class, by the contrasts
        log = -counts[0, 0] * np.logaddexp(0, logits) - counts[0, 1] * np.logaddexp(0, -logits)
        log += np.log(precision) / 2 - precision * weight**2 / 2
        exact = np.log(np.exp(log - log.max()).sum() * (weight[1] - weight[0])) + log.max()
        laplace = log_evidence(found, features, counts, np.array([precision]))
        values.append(exact - laplace)
    # Equal but for a constant and the error of Laplace's approximation, of the order 1 / 100.
    assert values[0] == pytest.approx(values[1], abs=0.02)


def test_condition_that_does_not_matter_has_a_large_scale():
    rng = np.random.default_rng(3)
    points = qmc.Sobol(3, seed=rng).random(64)
    share = 0.5 + 0.3 * np.sin(6 * points[:, 0]) * np.cos(4 * points[:, 1])
    tables = [
        rng.multinomial(DROPS, np.stack([each, 1 - each], axis=1)).astype(float)
        for each in (share, 1 - share)
    ]
    scales = likely_scales(points, tables)
    assert np.prod(scales) == pytest.approx(1)
    assert scales[2] > 2 * max(scales[:2])


def test_surrogate_without_points_does_not_know_them():
    rng = np.random.default_rng(3)
    points = qmc.Sobol(2, seed=rng).random(32)
    counts = rng.multinomial(DROPS, smooth(points))
    changed = counts.copy()
    out = np.arange(32) < 4
    changed[out] = changed[out][:, ::-1]
    found = ShareSurrogate.fit(points, counts, rng)
    one, other = (found.without(points, table, out).shares(points) for table in (counts, changed))
    assert one == pytest.approx(other, abs=1e-9)
