"""Drift in batches that scatter more than by chance: alarm rate and power, by simulation."""

import numpy as np
import pytest

from resting_aspects_ros.core.statistics.batch_scatter import MAX_UNITS, UNIT, Units, batch_scatter
from resting_aspects_ros.core.statistics.drift import find_drift, largest_deviation
from resting_aspects_ros.core.statistics.drift_power import parts_needed, power_of
from resting_aspects_ros.core.statistics.g_test import p_of_window

FIVE, TWO = np.array([0.27, 0.28, 0.24, 0.13, 0.08]), np.array([0.7, 0.3])
DROPS, SIZE, LEVEL = 10_000, 30, 0.05


def batches(rng, shares, number, deviation, size=SIZE):
    """Return counts of batches whose true shares have this standard deviation (Dirichlet)."""
    if deviation:
        within = deviation**2 / np.mean(shares * (1 - shares))
        shares = rng.dirichlet(shares * (1 / within - 1), size=number)
    return rng.multinomial(size, shares, size=number)


def alarm_rate(shares, deviation, number, repetitions, *, known=True, drifted=None, size=SIZE):
    """Return the share of runs whose last batches, at most 20, raise an alarm."""
    rng = np.random.default_rng(5)
    alarms = 0
    last = min(number, 20)
    for _ in range(repetitions):
        simulated = rng.multinomial(DROPS, shares)
        found = batches(rng, shares, number, deviation, size)
        if drifted is not None:
            found[-last:] = batches(rng, drifted, last, deviation, size)
        scatter = batch_scatter(found) if known else None
        window = found[-last:].sum(axis=0)
        alarms += p_of_window(window, simulated, rng, LEVEL, scatter) <= LEVEL
    return alarms / repetitions


def tolerance(repetitions, rate=LEVEL):
    """Return three standard errors of a rate."""
    return 3 * np.sqrt(rate * (1 - rate) / repetitions)


def test_alarms_are_too_frequent_without_the_scatter_and_not_with_it():
    repetitions = 300
    without = alarm_rate(FIVE, 0.08, 20, repetitions, known=False)
    assert without > LEVEL + 2 * tolerance(repetitions)
    assert alarm_rate(FIVE, 0.08, 20, repetitions) <= LEVEL + tolerance(repetitions)


@pytest.mark.slow
@pytest.mark.parametrize('number', [4, 8, 20, 60])
@pytest.mark.parametrize('deviation', [0.0, 0.03, 0.08])
@pytest.mark.parametrize('shares', [FIVE, TWO], ids=['five', 'two'])
def test_alarm_rate_stays_at_its_level(shares, deviation, number):
    repetitions = 1500
    rate = alarm_rate(shares, deviation, number, repetitions)
    assert rate <= LEVEL + tolerance(repetitions)
    # With many batches the test is not needlessly cautious.
    assert number < 60 or rate > LEVEL / 2 - tolerance(repetitions)


@pytest.mark.slow
@pytest.mark.parametrize('size', [10, 100])
def test_alarm_rate_stays_at_its_level_for_other_sizes_of_batches(size):
    repetitions = 800
    rate = alarm_rate(FIVE, 0.05, 40, repetitions, size=size)
    assert rate <= LEVEL + tolerance(repetitions)


@pytest.mark.slow
@pytest.mark.parametrize('deviation', [0.0, 0.08])
def test_drift_is_found_with_the_stated_power(deviation):
    # The window is long enough for a power of 80 % with the true scatter.
    rng = np.random.default_rng(7)
    scatter = batch_scatter(batches(rng, TWO, 1000, deviation))
    simulated = (DROPS * TWO).astype(np.int64)
    parts = parts_needed(simulated, 0.1, LEVEL, 0.8, scatter)
    last = -(-parts // SIZE)
    repetitions, alarms = 400, 0
    drifted = np.array([0.6, 0.4])
    for _ in range(repetitions):
        found = batches(rng, TWO, 200, deviation)
        window = batches(rng, drifted, last, deviation)
        own = batch_scatter(np.concatenate([found, window]))
        drops = rng.multinomial(DROPS, TWO)
        alarms += p_of_window(window.sum(axis=0), drops, rng, LEVEL, own) <= LEVEL
    # The second term is for the estimated scatter, and for whole batches.
    assert abs(alarms / repetitions - 0.8) <= tolerance(repetitions, 0.8) + 0.03


@pytest.mark.parametrize('deviation', [0.0, 0.03, 0.08])
def test_factor_is_that_of_the_intraclass_correlation(deviation):
    found = batch_scatter(batches(np.random.default_rng(3), FIVE, 4000, deviation))
    within = deviation**2 / np.mean(FIVE * (1 - FIVE))
    expected = 1 + (SIZE - 1) * within
    # The estimate has the relative standard error of the mean of chi-square statistics. The tails
    # of a Dirichlet distribution are somewhat heavier.
    error = expected * found.reference.std()
    assert abs(found.factor - expected) < 5 * error
    assert found.reference.mean() == pytest.approx(1)


def test_one_change_of_the_shares_is_no_scatter():
    rng = np.random.default_rng(2)
    before, after = batches(rng, TWO, 21, 0.0, 500), batches(rng, TWO[::-1], 21, 0.0, 500)
    found = batch_scatter(np.concatenate([before, after]))
    assert found.factor < np.quantile(found.reference, 0.999)


def test_scatter_needs_two_batches_with_two_classes():
    assert batch_scatter(np.zeros((0, 3), dtype=np.int64)) is None
    assert batch_scatter(np.array([[30, 20, 10]])) is None
    assert batch_scatter(np.array([[30, 0, 0], [40, 0, 0]])) is None
    assert batch_scatter(np.array([[30, 20, 10], [20, 30, 10]])).batches == 2


def test_scatter_widens_the_interval_and_needs_more_parts():
    simulated = (DROPS * TWO).astype(np.int64)
    units = batches(np.random.default_rng(3), TWO, 400, 0.1)
    scatter = batch_scatter(units)
    parts = np.array([600, 400])
    plain, wide = (largest_deviation(parts, simulated, 0.95, each) for each in (None, scatter))
    factor = np.sqrt(scatter.inflation(1000, DROPS))
    assert factor > 1.1
    assert wide.difference - wide.lower == pytest.approx(factor * (plain.difference - plain.lower))
    assert wide.lower <= wide.difference <= wide.upper
    assert parts_needed(simulated, 0.05, scatter=scatter) > 1.2 * parts_needed(simulated, 0.05)
    assert power_of(simulated, 1000, 0.05, LEVEL, scatter) < power_of(simulated, 1000, 0.05, LEVEL)


def test_strong_drift_is_found_beside_scattering_batches():
    rng = np.random.default_rng(4)
    good, bad = batches(rng, TWO, 60, 0.05), batches(rng, np.array([0.4, 0.6]), 20, 0.05)
    units = np.concatenate([good, bad])
    windows = units.reshape(8, 10, 2).sum(axis=1)
    found = find_drift(windows, np.array([7000, 3000]), rng, 0.01, batch_scatter(units))
    assert found.drifted == range(6, 8)


def test_small_batches_are_joined_and_old_ones_dropped():
    units = Units()
    for _ in range(3 * (MAX_UNITS + 5)):
        units.add(np.array([UNIT // 3, 0]))
    assert [int(each.sum()) for each in units.counts[:2]] == [UNIT, UNIT]
    assert len(units.counts) == MAX_UNITS
