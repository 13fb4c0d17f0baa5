"""Drift in windows, its power by simulation, and the class that deviates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, ncx2

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.comparison import DropCounts, batch_scatter, compare
from resting_aspects_ros.statistics.counted_parts import ObservedCounts
from resting_aspects_ros.statistics.drift import (
    MAX_SHIFT,
    TooFewDropsError,
    drifted_windows,
    find_drift,
    largest_deviation,
    parts_needed,
)

from .conftest import batches, generator

SIMULATED = np.array([2700, 2800, 2400, 1300, 800])
TWO = np.array([0.7, 0.3])


def observed(rows):
    rows = np.array(rows)
    groups = tuple((k,) for k in range(1, rows.shape[1] + 1))
    return ObservedCounts.of_rows(rows, 'counts', groups)


def found_in(*rows, window=100, level=0.01, simulated=SIMULATED):
    return find_drift(observed(rows), simulated, window, generator(), level)


def test_power_is_reached_with_the_stated_number_of_parts():
    repetitions, rng, level = 200, np.random.default_rng(6), 0.05
    parts, alarms = parts_needed(SIMULATED, 0.05, level), 0
    # Class 2 is nearest to 1/2, and up is harder than down.
    drifted = np.array([0.25125, 0.33, 0.22333, 0.12097, 0.07445])
    for _ in range(repetitions):
        window = rng.multinomial(parts, drifted)
        simulated = rng.multinomial(10_000, SIMULATED / 10_000)
        alarms += bool(find_drift(observed([window]), simulated, parts, rng, level).drifted)
    # The second term is the error of the approximation.
    tolerance = 3 * np.sqrt(0.8 * 0.2 / repetitions) + 0.015
    assert abs(alarms / repetitions - 0.8) <= tolerance


@given(st.floats(0.02, 0.2), st.sampled_from([0.01, 0.05]), st.sampled_from([0.8, 0.9]))
def test_parts_needed_is_that_of_noncentral_chi_square(shift, level, power):
    # Exact shares of two classes: the noncentrality of n parts is n times that of one.
    drifted = np.array([0.5 + shift, 0.5 - shift])
    of_one = 2 * (drifted * np.log(drifted / 0.5)).sum()
    n = parts_needed(np.array([10**9, 10**9]), shift, level, power)
    less, found = ncx2.sf(chi2.isf(level, 1), 1, np.array([n - 1, n]) * of_one)
    assert less - 1e-5 < power <= found + 1e-5


def test_parts_needed_refuses_few_drops_and_wrong_values():
    with pytest.raises(TooFewDropsError, match='invalid number of simulated drops 100: expected'):
        parts_needed(SIMULATED // 100, 0.05)
    with pytest.raises(InvalidValueError, match='invalid shift'):
        parts_needed(SIMULATED, MAX_SHIFT + 0.01)


def test_drift_lasts_from_the_change_to_the_end():
    good, bad = [54, 56, 48, 26, 16], [40, 90, 40, 20, 10]
    none, found = found_in(good, good), found_in(good, good, bad, bad, bad)
    assert (len(none.alarms), len(none.drifted), none.deviation) == (0, 0, None)
    assert found.drifted == range(2, 5)
    deviation = found.deviation
    assert (deviation.index, deviation.share, deviation.expected) == (1, 0.45, 0.28)
    assert deviation.difference == pytest.approx(0.17)


@pytest.mark.parametrize(
    ('alarms', 'windows', 'drifted'),
    [
        ([1, 2], 4, range(1, 4)),  # one window can miss the deviation
        ([1, 2], 5, range(1, 3)),
        ([0, 1, 4], 5, range(4, 5)),  # two windows without an alarm separate them
    ],
)
def test_drift_has_the_last_alarms(alarms, windows, drifted):
    assert drifted_windows(np.array(alarms, dtype=np.int64), windows) == drifted


def test_strong_drift_is_found_beside_scattering_batches():
    rng = np.random.default_rng(4)
    good, bad = batches(rng, TWO, 60, 0.05), batches(rng, np.array([0.4, 0.6]), 20, 0.05)
    found = found_in(*good, *bad, window=300, simulated=np.array([7000, 3000]))
    assert found.drifted == range(6, 8)
    assert found.scatter.factor > 1


def test_bounds_are_those_of_a_comparison():
    parts = np.array([60, 80, 30, 20, 10])
    found = largest_deviation(parts, SIMULATED, 0.9)
    other = compare(DropCounts(parts), DropCounts(SIMULATED), generator(), 0.9)
    assert found.index == 1
    assert (found.lower, found.upper) == (other.lower[1], other.upper[1])
    table = np.array([parts, SIMULATED])
    rows, columns = table.sum(1) / table.sum(), table.sum(0) / table.sum()
    expected = table.sum() * np.outer(rows, columns)
    residuals = (table - expected) / np.sqrt(expected * np.outer(1 - rows, 1 - columns))
    assert found.residual == pytest.approx(residuals[0, 1])


def test_scatter_widens_the_interval():
    simulated, parts = np.array([7000, 3000]), np.array([600, 400])
    scatter = batch_scatter(batches(np.random.default_rng(3), TWO, 400, 0.1))
    plain, wide = (largest_deviation(parts, simulated, 0.95, each) for each in (None, scatter))
    factor = np.sqrt(scatter.inflation(1000, 10_000))
    assert factor > 1.1
    assert wide.difference - wide.lower == pytest.approx(factor * (plain.difference - plain.lower))


@pytest.mark.parametrize(
    ('rows', 'simulated', 'options', 'message'),
    [
        ([[5]], [10], {}, 'expected those of two or more classes'),
        ([[5, 5]], [5, 5], {'level': 0.3}, 'invalid level 0.3: expected 0.0001 to 0.25'),
        ([[5, 5]], [5, 5], {'window': 11}, 'invalid window 11: expected an integer from 1 to 10'),
    ],
)
def test_wrong_arguments_are_named(rows, simulated, options, message):
    with pytest.raises(InvalidValueError, match=message):
        found_in(*rows, simulated=np.array(simulated), **{'window': 1, **options})
