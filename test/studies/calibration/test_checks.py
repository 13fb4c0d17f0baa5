"""The G test, predictions and parts that are left out, on counts of known origin."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import kstest, power_divergence

from resting_aspects_ros.studies.calibration import checks
from resting_aspects_ros.studies.calibration.checks import g_test, leave_one_out, predict

TRUTH = (0.4, 0.6)


def test_statistic_is_that_of_scipy_at_the_best_point(agreeing):
    parts = agreeing.given.parts
    pairs = list(zip(parts, agreeing.posterior.shares, strict=True))
    best = sum(np.log(shares) @ part.counts for part, shares in pairs).argmax()
    theirs = sum(
        power_divergence(
            part.counts, part.drops * shares[best], lambda_='log-likelihood'
        ).statistic
        for part, shares in pairs
    )
    assert g_test(agreeing, np.random.default_rng(1)).statistic == pytest.approx(theirs)


def test_counts_of_the_simulation_are_explained(agreeing, contradicting):
    assert g_test(agreeing, np.random.default_rng(1)).p > 0.01
    assert g_test(contradicting, np.random.default_rng(1)).p == pytest.approx(
        1 / (1 + checks.REPETITIONS)
    )


@pytest.mark.slow
def test_p_values_of_the_simulation_are_uniform(invented, monkeypatch):
    monkeypatch.setattr(checks, 'REPETITIONS', 99)
    rng = np.random.default_rng(5)
    values = []
    for _ in range(60):
        counts = invented.counted(TRUTH, 300, rng)
        values.append(g_test(invented.fit(counts, discrepancy=False), rng).p)
    # Where a test with a probability of error of 0.1 % would find a difference.
    assert kstest(values, 'uniform').pvalue > 0.001


def test_predictions_are_near_the_truth(agreeing):
    for k, each in enumerate(predict(agreeing, np.random.default_rng(1))):
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
    wrong = [*counts[:2], (2500, 5000)]
    right, moved = (
        leave_one_out(invented.fit(each), np.random.default_rng(1)) for each in (counts, wrong)
    )
    assert right[2].model == pytest.approx(moved[2].model, abs=1e-6)
    assert right[2].deviation < 0.03
    assert moved[2].deviation > 0.1
    assert not moved[2].inside


def test_one_part_has_no_part_to_leave_out(invented):
    fit = invented.fit(invented.counted(TRUTH, 300, np.random.default_rng(3)))
    given = dataclasses.replace(fit.given, parts=fit.given.parts[:1])
    assert leave_one_out(dataclasses.replace(fit, given=given), np.random.default_rng(1)) == []


@pytest.mark.slow
def test_intervals_of_new_counts_contain_them_as_often_as_they_say(invented):
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(40):
        found = leave_one_out(invented.fit(invented.counted(rng.random(2), 300, rng)), rng)
        inside += [each.inside for each in found]
    # With a discrepancy that the counts do not have, the intervals are too wide. n = 120.
    assert np.mean(inside) > 0.9 - 3 * np.sqrt(0.09 / 120)
