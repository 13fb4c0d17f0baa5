"""The G test, predictions, parts that are left out and comparisons, on counts of known origin."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import binom, chi2, power_divergence

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.studies.calibration import checks
from resting_aspects_ros.studies.calibration.checks import (
    compare_surfaces,
    find_estimates,
    g_test,
    predict,
    shortest_interval,
)
from resting_aspects_ros.studies.calibration.posterior import share_moments

from .conftest import HEIGHTS, box_shares

TRUTH = (0.4, 0.6)


def rng():
    return np.random.default_rng(1)


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=40))
def test_shortest_interval_is_ascending_and_has_its_values(values):
    low, high = shortest_interval(np.array(values))
    assert low <= high
    assert sum(low <= each <= high for each in values) >= 0.9 * len(values)


def test_shortest_interval_of_a_normal_distribution():
    low, high = shortest_interval(rng().standard_normal(100_000))
    assert (low, high) == pytest.approx((-1.645, 1.645), abs=0.1)


def test_estimates_contain_the_truth(agreeing):
    for each, unit in zip(find_estimates(agreeing, rng()), TRUTH, strict=True):
        truth = float(each.factor.values(np.array([unit]))[0])
        assert each.low <= truth <= each.high
        assert each.low <= each.best <= each.high
        assert each.low <= each.mean <= each.high


def test_statistic_is_that_of_scipy_for_the_fitted_shares(agreeing):
    weights = dataclasses.replace(agreeing, discrepancy=False).weights()[0]
    theirs = 0.0
    for part, simulated in zip(agreeing.given.parts, agreeing.simulated, strict=True):
        expected = part.drops * (weights @ share_moments(simulated)[0])
        theirs += power_divergence(part.counts, expected, lambda_='log-likelihood').statistic
    assert g_test(agreeing, rng()).statistic == pytest.approx(theirs)


def test_counts_of_the_simulation_are_explained(agreeing, contradicting):
    assert g_test(agreeing, rng()).p > 0.01
    assert g_test(contradicting, rng()).p == pytest.approx(1 / (1 + checks.REPETITIONS))


@pytest.mark.slow
def test_g_test_has_its_level(invented, monkeypatch):
    monkeypatch.setattr(checks, 'REPETITIONS', 99)
    generator, found = np.random.default_rng(5), []
    for seed in range(80):
        counts = invented.counted(generator.random(2), 200, generator)
        found.append(g_test(invented.fit(counts, per_point=800, seed=seed), generator).p)
    # Four standard errors of the share of 80 p values.
    assert np.mean(np.array(found) <= 0.1) < 0.1 + 4 * np.sqrt(0.09 / 80)


def test_predictions_are_near_the_truth(agreeing):
    for k, each in enumerate(predict(agreeing, rng())):
        assert each.counted == pytest.approx(agreeing.given.parts[k].shares)
        assert (each.model_low < each.model).all()
        assert (each.model < each.model_high).all()
        # Sampling, and then also the discrepancy: wider than the model alone.
        assert ((each.high - each.low) > (each.model_high - each.model_low)).all()
        assert each.inside
        assert each.deviation < 0.05
        assert each.model.sum() == pytest.approx(1)


def test_a_part_that_is_left_out_is_predicted_by_the_others(invented):
    counts = invented.counted(TRUTH, 5000, np.random.default_rng(3))
    fit = invented.fit(counts)
    moved = dataclasses.replace(fit.given.parts[2], counts=np.array([2500, 2500]))
    wrong = dataclasses.replace(fit.given, parts=(*fit.given.parts[:2], moved))
    right, moved = (
        predict(each, rng(), left_out=True)[2]
        for each in (fit, dataclasses.replace(fit, given=wrong))
    )
    assert right.model == pytest.approx(moved.model)
    assert right.deviation < 0.05
    assert moved.deviation > 0.1
    assert not moved.inside


def test_one_part_has_no_part_to_leave_out(agreeing):
    given = dataclasses.replace(agreeing.given, parts=agreeing.given.parts[:1])
    alone = dataclasses.replace(agreeing, given=given, simulated=agreeing.simulated[:1])
    assert predict(alone, rng(), left_out=True) == []


@pytest.mark.slow
def test_intervals_of_new_counts_contain_them_as_often_as_they_say(invented):
    generator, inside = np.random.default_rng(5), []
    for seed in range(40):
        counts = invented.counted(generator.random(2), 300, generator)
        fit = invented.fit(counts, seed=seed)
        inside += [each.inside for each in predict(fit, generator, left_out=True)]
    # With a discrepancy that the counts do not have, the intervals are too wide. n = 120.
    assert np.mean(inside) > 0.9 - 3 * np.sqrt(0.09 / 120)


def test_equal_surfaces_are_one_and_others_are_two(invented):
    generator = np.random.default_rng(3)
    one, same, other = (
        invented.fit(invented.counted(point, 1000, generator), surface=name)
        for name, point in (('one', TRUTH), ('same', TRUTH), ('other', (0.8, 0.9)))
    )
    equal, different = (compare_surfaces(one, each, rng()) for each in (same, other))
    assert (equal.one, equal.other, equal.same_parts) == ('one', 'same', True)
    assert equal.log_ratio < 0 < different.log_ratio
    assert equal.overlap > 0.3
    assert different.overlap < 0.05
    assert equal.same_parts_p > 0.01 > different.same_parts_p


@pytest.mark.parametrize('truth', [TRUTH, (0.55, 0.6)])
def test_ratio_of_probabilities_is_that_of_exact_posteriors(invented, truth):
    generator = np.random.default_rng(3)
    counts = [invented.counted(each, 200, generator) for each in (TRUTH, truth)]
    one, other = (invented.fit(each, per_point=4000) for each in counts)
    found = compare_surfaces(one, other, rng())
    side = (np.arange(100) + 0.5) / 100
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    logs = [
        sum(
            binom.logpmf(k, n, box_shares(grid, h)[:, 0])
            for (k, n), h in zip(each, HEIGHTS, strict=True)
        )
        for each in counts
    ]
    mean = [logsumexp(each) - np.log(len(grid)) for each in (*logs, logs[0] + logs[1])]
    assert found.log_ratio == pytest.approx(mean[0] + mean[1] - mean[2], abs=0.6)
    weights = [np.exp(each - logsumexp(each)) for each in logs]
    assert found.overlap == pytest.approx(np.minimum(*weights).sum(), abs=0.15)


def test_same_parts_are_compared_without_the_simulation(agreeing):
    parts = tuple(dataclasses.replace(p, counts=p.counts[::-1]) for p in agreeing.given.parts)
    other = dataclasses.replace(agreeing, given=dataclasses.replace(agreeing.given, parts=parts))
    tables = [np.stack([p.counts, p.counts[::-1]]) for p in agreeing.given.parts]
    g = sum(
        power_divergence(
            table, np.outer(table.sum(axis=1), table.sum(axis=0)) / table.sum(), 3, None,
            'log-likelihood',
        ).statistic
        for table in tables
    )  # fmt: skip
    assert compare_surfaces(agreeing, other, rng()).same_parts_p == pytest.approx(chi2.sf(g, 3))


def test_surfaces_with_other_ranges_are_not_compared(agreeing):
    given = dataclasses.replace(agreeing.given, factors=agreeing.given.factors[:1])
    with pytest.raises(InvalidValueError, match='expected the same ranges'):
        compare_surfaces(agreeing, dataclasses.replace(agreeing, given=given), rng())


def test_surfaces_with_other_parts_are_compared_by_their_conditions(agreeing):
    one, other = (
        dataclasses.replace(
            agreeing,
            given=dataclasses.replace(agreeing.given, parts=agreeing.given.parts[k : k + 1]),
            simulated=agreeing.simulated[k : k + 1],
        )
        for k in (0, 1)
    )
    found = compare_surfaces(one, other, rng())
    assert not found.same_parts
    assert found.same_parts_p is None
    assert found.log_ratio < 0  # both are of the same surface
