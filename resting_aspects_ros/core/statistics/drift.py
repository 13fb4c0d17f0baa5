"""Drift: whether the parts of a window still have the shares of the simulation; see g_test."""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.batch_scatter import BatchScatter
from resting_aspects_ros.core.statistics.comparison import square_and_add
from resting_aspects_ros.core.statistics.g_test import g_statistic, p_of_window
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    SIMULTANEOUS,
    Array,
    Counts,
    bounds,
)

LEVEL = 0.01
MIN_LEVEL, MAX_LEVEL = 1e-4, 0.25
# Maximum number of windows up to the last alarm, and after it, in which drift is searched.
MAX_SEARCHED = 1000


@dataclass(frozen=True)
class Deviation:
    """The class whose share deviates most from the simulation.

    index : int
        Index of the class, from 0. It has the largest absolute standardised residual.
    share, expected : float
        Its share of the counted parts and of the simulated drops.
    lower, upper : float
        Bounds of the true difference share - expected. The bounds of all classes hold together
        with ``confidence``, so choosing the largest does not weaken them.
    residual : float
        Standardised residual: the difference in standard errors.
    """

    index: int
    share: float
    expected: float
    lower: float
    upper: float
    residual: float
    confidence: float

    @property
    def difference(self) -> float:
        """Share of the counted parts minus that of the simulated drops."""
        return self.share - self.expected


@dataclass(frozen=True, eq=False)
class DriftTest:
    """The tests of successive windows of parts against simulated drops.

    simulated : (c,) int
        Simulated drops in each class.
    windows : (w, c) int
        Counted parts of each window in each class.
    g, p_values : (w,) float
        G statistic of each window, and the probability of one at least as large without drift.
    level : float
        Probability of an alarm in a window without drift.
    drifted : range
        Indices of the windows that deviate, empty without an alarm; see `drifted_windows`. If the
        windows recovered, it ends before the last one.
    scatter : BatchScatter or None
        By how much batches differ more than by chance; None if it is not known, and chance alone
        is assumed.
    """

    simulated: Counts
    windows: Counts
    g: Array
    p_values: Array
    level: float
    drifted: range
    scatter: BatchScatter | None = None

    @property
    def alarms(self) -> Counts:
        """Indices of the windows with an alarm."""
        return np.flatnonzero(self.p_values <= self.level)

    def deviation(self, windows: range, confidence: float = CONFIDENCE) -> Deviation:
        """Return the largest deviation of the parts of some windows together."""
        parts = self.windows[windows.start : windows.stop].sum(axis=0)
        return largest_deviation(parts, self.simulated, confidence, self.scatter)


def find_drift(
    windows: Counts,
    simulated: Counts,
    generator: np.random.Generator,
    level: float = LEVEL,
    scatter: BatchScatter | None = None,
) -> DriftTest:
    """Test each window of counted parts against the simulated drops.

    Without drift, the probability of an alarm is ``level`` for each window. It holds on average
    over simulations: all windows are compared with the same simulated drops, so the alarms are
    not independent if the drops are few in comparison with a window.

    Parameters
    ----------
    windows : (w, c) int
        Parts in each class; at least one part in each window. Each part is in one window only.
    simulated : (c,) int
        Simulated drops in each of two or more classes, at least one in total.
    generator : Generator
        Draws the random tables.
    level : float
        MIN_LEVEL to MAX_LEVEL.
    scatter : BatchScatter, optional
        Of the batches of which the windows consist.

    Raises
    ------
    InvalidValueError
        If an argument is invalid.
    """
    check_level(level)
    simulated = check_simulated(simulated)
    given = np.asarray(windows, dtype=np.int64)
    if given.shape[1:] != simulated.shape or (given < 0).any() or not given.any(axis=1).all():
        raise InvalidValueError(
            f'invalid windows {shown(given.tolist())}: expected counts of {len(simulated)} '
            'classes, 0 or more, with at least one part in each window'
        )
    p_values = np.array([p_of_window(row, simulated, generator, level, scatter) for row in given])
    factor = 1.0 if scatter is None else max(scatter.factor, 1.0)
    drifted = drifted_windows(given, simulated, p_values, level, factor)
    g = g_statistic(given, simulated)
    return DriftTest(simulated, given, g, p_values, level, drifted, scatter)


def drifted_windows(
    windows: Counts, simulated: Counts, p_values: Array, level: float, factor: float = 1.0
) -> range:
    """Return the latest successive windows that most likely deviate; empty without an alarm.

    All windows are divided into those with the simulated shares and runs of windows with other
    shares, so that the sum of the G statistics of the runs, less a penalty for each, is largest
    (optimal partitioning; Jackson et al. 2005, IEEE Signal Processing Letters 12:105). The penalty
    2 log(windows / level) + classes - 1 makes a run that is only due to chance improbable.
    The last run is returned. It lasts to the end unless the later windows speak against it by a
    likelihood ratio of more than 1 / level. If there is no such run, the result is the single
    window with the smallest p value.

    Only MAX_SEARCHED windows up to the last alarm, and as many after it, are searched.

    windows, simulated : (w, c) and (c,) int
    p_values : (w,) float
    factor : by which the scatter of batches increases the statistics
    """
    alarms = np.flatnonzero(p_values <= level)
    if not len(alarms):
        return range(0)
    last, count = int(alarms[-1]) + 1, len(windows)
    begin, end = max(0, last - MAX_SEARCHED), min(count, last + MAX_SEARCHED)
    totals = np.concatenate([windows[:1] * 0, windows[begin:end].cumsum(axis=0)])
    penalty = 2 * np.log((end - begin) / level) + windows.shape[1] - 1
    best, runs = np.zeros(len(totals)), [range(0)] * len(totals)
    for k in range(1, len(totals)):
        scores = best[:k] + g_statistic(totals[k] - totals[:k], simulated) / factor - penalty
        first = int(scores.argmax())
        best[k], runs[k] = best[k - 1], runs[k - 1]
        if scores[first] > best[k]:
            # Two runs that follow each other are one.
            before = runs[first]
            best[k] = scores[first]
            runs[k] = range(before.start if before.stop == first > 0 else first, k)
    run = runs[-1]
    if not run:
        lowest = int(p_values.argmin())
        return range(lowest, lowest + 1)
    ends = totals[[run.stop, -1]] - totals[run.start]
    recovered, lasting = g_statistic(ends, simulated) / factor
    stop = run.stop if recovered - lasting > -2 * np.log(level) else count - begin
    return range(begin + run.start, begin + stop)


def largest_deviation(
    parts: Counts,
    simulated: Counts,
    confidence: float = CONFIDENCE,
    scatter: BatchScatter | None = None,
) -> Deviation:
    """Return the class whose share deviates most; both arguments (c,) with at least one count.

    The residual is the adjusted residual of the table with both rows (Agresti 2002, Categorical
    Data Analysis, section 3.3.1); of equal ones the lowest class is returned. The bounds are as
    in `comparison.compare`, wider by the scatter of batches.
    """
    n, m = int(parts.sum()), int(simulated.sum())
    share, expected = parts / n, simulated / m
    pooled = (parts + simulated) / (n + m)
    error = np.sqrt(pooled * (1 - pooled) * (1 / n + 1 / m))
    residual = (share - expected) / np.where(error > 0, error, 1)
    k = int(np.abs(residual).round(9).argmax())
    lower, upper = square_and_add(
        share,
        bounds(parts, n, SIMULTANEOUS, confidence),
        expected,
        bounds(simulated, m, SIMULTANEOUS, confidence),
    )
    wider = 1.0 if scatter is None else float(np.sqrt(scatter.inflation(n, m)))
    difference = float(share[k] - expected[k])
    low = max(difference - wider * (difference - float(lower[k])), -1.0)
    high = min(difference + wider * (float(upper[k]) - difference), 1.0)
    found = float(share[k]), float(expected[k])
    return Deviation(k, *found, low, high, float(residual[k]) / wider, confidence)


def check_level(level: float) -> None:
    """Raise InvalidValueError unless the level is within the limits of the test."""
    number = isinstance(level, int | float) and not isinstance(level, bool)
    if not (number and MIN_LEVEL <= level <= MAX_LEVEL):
        raise InvalidValueError(
            f'invalid level {shown(level)}: expected {MIN_LEVEL:g} to {MAX_LEVEL:g}'
        )


def check_simulated(simulated: Counts) -> Counts:
    """Return the simulated drops as an array; raises InvalidValueError for a single class."""
    counts = np.asarray(simulated, dtype=np.int64)
    if counts.ndim != 1 or (counts < 0).any() or not counts.any() or len(counts) < 2:
        raise InvalidValueError(
            f'invalid simulated counts {shown(counts.tolist())}: expected those of two or more '
            'classes, 0 or more, not all 0; without a second class no share can drift'
        )
    return counts
