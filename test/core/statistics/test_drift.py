"""Drift in windows, its power by simulation, and the class that deviates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics.comparison import DropCounts, compare
from resting_aspects_ros.core.statistics.drift import find_drift, largest_deviation
from resting_aspects_ros.core.statistics.drift_power import (
    MAX_SHIFT,
    TooFewDropsError,
    detectable_shift,
    parts_for_run_length,
    parts_needed,
    power_of,
)
from resting_aspects_ros.core.statistics.g_test import p_of_window

SIMULATED = np.array([2700, 2800, 2400, 1300, 800])
REPETITIONS = 1000


def found_in(*windows, level=0.01):
    return find_drift(np.array(windows), SIMULATED, np.random.default_rng(1), level)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('shares', 'drops', 'level', 'drifted'),
    [
        # Class 2 is nearest to 1/2, and up is harder than down.
        ([0.27, 0.28, 0.24, 0.13, 0.08], 10_000, 0.05, [0.25125, 0.33, 0.22333, 0.12097, 0.07444]),
        ([0.5, 0.5], 5000, 0.05, [0.55, 0.45]),
        ([0.9, 0.1], 10_000, 0.05, [0.85, 0.15]),
    ],
)
def test_power_is_reached_with_the_stated_number_of_parts(shares, drops, level, drifted):
    simulated = np.round(drops * np.array(shares)).astype(np.int64)
    parts = parts_needed(simulated, 0.05, level)
    rng = np.random.default_rng(6)
    drifted = np.array(drifted) / sum(drifted)
    rows = zip(
        rng.multinomial(parts, drifted, size=REPETITIONS),
        rng.multinomial(drops, shares, size=REPETITIONS),
        strict=True,
    )
    alarms = sum(p_of_window(*row, rng, level) <= level for row in rows)
    # The second term is the error of the approximation.
    tolerance = 3 * np.sqrt(0.8 * 0.2 / REPETITIONS) + 0.01
    assert abs(alarms / REPETITIONS - 0.8) <= tolerance


@given(st.lists(st.integers(1, 5000), min_size=2, max_size=8), st.floats(0.02, 0.3))
def test_parts_needed_is_the_smallest_number(counts, shift):
    simulated = 10_000 * np.array(counts)
    parts = parts_needed(simulated, shift)
    assert power_of(simulated, parts, shift) >= 0.8
    assert parts == 1 or power_of(simulated, parts - 1, shift) < 0.8
    assert detectable_shift(simulated, parts) <= shift + 1e-5


def test_few_drops_cannot_find_a_small_shift():
    with pytest.raises(TooFewDropsError, match='invalid number of simulated drops 100: expected'):
        parts_needed(SIMULATED // 100, 0.05)
    assert np.isnan(detectable_shift(SIMULATED // 1000, 3))


def test_window_of_a_run_length_has_its_level():
    parts = parts_for_run_length(SIMULATED, 200_000)
    assert parts == parts_needed(SIMULATED, 0.05, parts / 200_000)


def test_windows_without_drift_have_no_alarm():
    found = found_in([27, 28, 24, 13, 8], [54, 56, 48, 26, 16])
    assert list(found.alarms) == []
    assert len(found.drifted) == 0


def test_drift_lasts_from_the_change_to_the_end():
    good, bad = [54, 56, 48, 26, 16], [40, 90, 40, 20, 10]
    found = found_in(good, good, bad, bad, bad)
    assert found.drifted == range(2, 5)
    deviation = found.deviation(found.drifted)
    assert (deviation.index, deviation.share, deviation.expected) == (1, 0.45, 0.28)
    assert deviation.lower < 0.17 < deviation.upper
    assert deviation.difference == pytest.approx(0.17)


def test_passing_drift_is_a_single_window():
    good, bad = [540, 560, 480, 260, 160], [14, 28, 24, 13, 21]
    found = found_in(good, bad, *[good] * 6)
    assert found.drifted == range(1, 2)
    assert list(found.alarms) == [1]


def test_drift_begins_and_ends_with_the_shares():
    good, bad = [54, 56, 48, 26, 16], [40, 90, 40, 20, 10]
    assert found_in(good, bad, bad, good, good).drifted == range(1, 3)
    # The last run counts, and the windows between two of them belong to neither.
    assert found_in(bad, bad, bad, good, good, good, bad).drifted == range(6, 7)
    assert found_in(bad).drifted == range(1)
    # A single window that is nearer to the simulation is no recovery.
    assert found_in(good, bad, bad, [48, 72, 44, 23, 13]).drifted == range(1, 4)


def test_bounds_are_those_of_a_comparison():
    parts = np.array([60, 80, 30, 20, 10])
    found = largest_deviation(parts, SIMULATED, 0.9)
    other = compare(DropCounts(parts), DropCounts(SIMULATED), np.random.default_rng(1), 0.9)
    assert found.index == 1
    assert (found.lower, found.upper) == (other.lower[1], other.upper[1])
    table = np.array([parts, SIMULATED])
    expected = table.sum(1)[:, None] * table.sum(0) / table.sum()
    margins = (1 - table.sum(1) / table.sum())[:, None] * (1 - table.sum(0) / table.sum())
    assert found.residual == pytest.approx(
        ((table - expected) / np.sqrt(expected * margins))[0, 1]
    )


def test_of_two_classes_the_first_is_named():
    found = largest_deviation(np.array([30, 70]), np.array([500, 500]))
    assert (found.index, found.difference) == (0, pytest.approx(-0.2))


@pytest.mark.parametrize(
    ('windows', 'simulated', 'level', 'message'),
    [
        ([[1, 2]], [1, 2, 3], 0.01, 'expected counts of 3 classes'),
        ([[1, -2, 4]], [1, 2, 3], 0.01, 'expected counts of 3 classes, 0 or more'),
        ([[0, 0, 0]], [1, 2, 3], 0.01, 'at least one part in each window'),
        ([[5]], [10], 0.01, 'expected those of two or more classes'),
        ([[5, 5]], [0, 0], 0.01, 'not all 0'),
        ([[5, 5]], [5, 5], 0.3, 'invalid level 0.3: expected 0.0001 to 0.25'),
        ([[5, 5]], [5, 5], float('nan'), 'invalid level nan'),
    ],
)
def test_wrong_arguments_are_named(windows, simulated, level, message):
    rng = np.random.default_rng(1)
    with pytest.raises(InvalidValueError, match=message):
        find_drift(np.array(windows), np.array(simulated), rng, level)


@pytest.mark.parametrize('shift', [0, -0.1, MAX_SHIFT + 0.01, float('nan')])
def test_wrong_shift_is_refused(shift):
    with pytest.raises(InvalidValueError, match='invalid shift'):
        parts_needed(SIMULATED, shift)


def test_wrong_power_is_refused():
    with pytest.raises(InvalidValueError, match='invalid power 1: expected more than 0'):
        parts_needed(SIMULATED, power=1)
