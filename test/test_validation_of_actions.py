"""The shifts and the distances that `make validate` states of actions."""

import numpy as np
import pytest
from scipy.stats import chi2
from validation import reorientation as validate_reorientation
from validation.dropper import Dropper
from validation.paired import (
    ONE_SIDED,
    OUTSIDE,
    action_job,
    class_indices,
    homogeneity,
    paired_counts,
    shifts,
)
from validation.reorientation import farthest

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.workers import LocalWorkers


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


def test_statistic_of_two_columns_is_that_of_mcnemar():
    value, degrees = homogeneity(np.array([[500, 40], [15, 445]]))
    assert degrees == 1
    assert value == pytest.approx((40 - 15) ** 2 / (40 + 15))


def test_columns_that_few_parts_change_are_joined():
    counts = np.array([[500, 40, 1], [15, 445, 0], [0, 0, 3]])
    value, degrees = homogeneity(counts)
    assert degrees == 1
    assert value == pytest.approx((40 - 15) ** 2 / (40 + 15), rel=0.1)


def test_statistic_of_equal_probabilities_is_above_its_quantile_in_1_of_20_samples():
    generator = np.random.default_rng(1)
    p = np.array([[0.3, 0.03, 0.02], [0.03, 0.3, 0.05], [0.02, 0.05, 0.2]])
    n = 1000
    samples = generator.multinomial(2000, p.ravel(), size=n).reshape(n, 3, 3)
    found = [homogeneity(counts) for counts in samples]
    assert {degrees for _, degrees in found} == {2}
    above = np.mean([value > chi2.ppf(0.95, 2) for value, _ in found])
    assert abs(above - 0.05) < 3 * np.sqrt(0.05 * 0.95 / n)


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


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(validate_reorientation, 'SAMPLES', 200)


def test_distance_of_equal_rows_is_within_chance():
    generator = np.random.default_rng(1)
    n, above = 200, 0
    for _ in range(n):
        rows = generator.multinomial(500, [0.3, 0.3, 0.2, 0.2], size=4)
        distance, chance, _ = farthest(rows, rows, generator)
        above += distance > chance
    # 5 % of the samples exceed it; the quantile of 200 samples adds to the standard error.
    assert 0 < above / n < 0.05 + 3 * np.sqrt(2 * 0.05 * 0.95 / n)


def test_bound_of_the_distance_covers_in_19_of_20_samples():
    generator = np.random.default_rng(1)
    rows = np.array([[0.4, 0.3, 0.3], [0.3, 0.4, 0.3]])
    n = 100
    bounds = [
        farthest(found, found, generator)[2]
        for found in (generator.multinomial(400, rows) for _ in range(n))
    ]
    assert np.mean(np.array(bounds) >= 0.1) > 0.95 - 3 * np.sqrt(0.95 * 0.05 / n)


def test_paired_counts_have_every_action_once(part):
    shape, workers = part('box_10x20x30'), LocalWorkers(1)
    aspects = find_aspects(shape)
    try:
        dropper = Dropper(workers)
        job, before = action_job(dropper, shape, shipped_actions().get('tap').action, 100)
        labels = class_indices(aspects)
        counts = paired_counts(dropper, job, aspects, labels, len(before), before)
    finally:
        workers.stop()
    classes = len(aspects.classes())
    columns = classes + len(OUTSIDE)
    assert counts.shape == (classes, columns, columns)
    assert counts.sum(axis=(1, 2)).tolist() == np.bincount(before).tolist() == [100] * classes
    # A tap is weak: most parts stay, in both simulations.
    assert counts[0, 0, 0] > 80
