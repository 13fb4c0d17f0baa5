"""The G test, predictions and parts that are left out, on counts of known origin."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import power_divergence

from resting_aspects_ros.studies.calibration import posterior
from resting_aspects_ros.studies.calibration.posterior import (
    find_estimates,
    g_test,
    predict,
    shortest_interval,
)

TRUTH = (0.4, 0.6)


def rng():
    return np.random.default_rng(1)


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=40))
def test_shortest_interval_is_ascending_and_has_its_values(values):
    low, high = shortest_interval(np.array(values), np.ones(len(values)))
    assert low <= high
    assert sum(low <= each <= high for each in values) >= 0.9 * len(values)


def test_estimates_contain_the_truth(agreeing):
    for each, unit in zip(find_estimates(agreeing), TRUTH, strict=True):
        truth = float(each.factor.values(np.array([unit]))[0])
        assert each.low <= truth <= each.high
        assert each.low <= each.best <= each.high
        assert each.low <= each.mean <= each.high


def test_weights_count_as_often_as_they_say():
    values, weights = np.array([3.0, 1.0, 2.0, 9.0]), np.array([0.5, 0.2, 0.25, 0.05])
    assert shortest_interval(values, weights) == (1.0, 3.0)


def test_statistic_is_that_of_scipy_for_the_best_candidate(agreeing):
    theirs = np.zeros(len(agreeing.candidates))
    for part, (shares, _) in zip(agreeing.given.parts, agreeing.shares, strict=True):
        expected = part.drops * shares
        theirs += power_divergence(part.counts, expected, 0, 1, 'log-likelihood').statistic
    assert g_test(agreeing, rng()).statistic == pytest.approx(theirs.min())


def test_counts_of_the_simulation_are_explained(agreeing, contradicting):
    assert g_test(agreeing, rng()).p > 0.01
    assert g_test(contradicting, rng()).p == pytest.approx(1 / (1 + posterior.REPETITIONS))


@pytest.mark.slow
def test_g_test_has_its_level(invented, monkeypatch):
    monkeypatch.setattr(posterior, 'REPETITIONS', 99)
    generator, found = np.random.default_rng(5), []
    for seed in range(80):
        counts = invented.counted(generator.random(2), 200, generator)
        found.append(g_test(invented.fit(counts, per_point=100, seed=seed), generator).p)
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
    alone = dataclasses.replace(agreeing, given=given, models=agreeing.models[:1])
    assert predict(alone, rng(), left_out=True) == []


@pytest.mark.slow
def test_intervals_of_new_counts_contain_them_as_often_as_they_say(invented):
    generator, inside = np.random.default_rng(5), []
    for seed in range(40):
        counts = invented.counted(generator.random(2), 300, generator)
        fit = invented.fit(counts, per_point=150, seed=seed)
        inside += [each.inside for each in predict(fit, generator, left_out=True)]
    # With a discrepancy that the counts do not have, the intervals are too wide. n = 120.
    assert np.mean(inside) > 0.9 - 3 * np.sqrt(0.09 / 120)
