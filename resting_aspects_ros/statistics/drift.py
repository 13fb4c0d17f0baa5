"""Drift: whether the parts of a window still have the shares of the simulation."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, chndtrinc

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.statistics.comparison import (
    UNIT,
    BatchScatter,
    batch_scatter,
    g_statistic,
    p_of_window,
    square_and_add,
)
from resting_aspects_ros.statistics.counted_parts import ObservedCounts
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    SIMULTANEOUS,
    bounds,
    check_confidence,
    check_number,
)

LEVEL = 0.01
MIN_LEVEL, MAX_LEVEL = 1e-4, 0.25
POWER = 0.8
MIN_POWER, MAX_POWER = 0.01, 0.9999
# A deviation that matters for a feeder: a class with 55 % instead of 50 %.
SHIFT = 0.05
# The rarest class can always deviate by the largest one.
MIN_SHIFT, MAX_SHIFT = 1e-4, 0.4
MAX_PARTS = 100_000_000
# Of windows with as many parts as find a deviation with a probability of 80 %, two in succession
# miss it with 4 %.
GAP = 2


class TooFewDropsError(InvalidValueError):
    """No number of parts finds a deviation, because the simulation has too few drops."""


@dataclass(frozen=True, eq=False)
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
    ends : (w + 1,) int
        Number of parts before the first window, 0, and up to the end of each window.
    g, p_values : (w,) float
        G statistic of each window, and the probability of one at least as large without drift.
    level : float
        Probability of an alarm in a window without drift.
    drifted : range
        Indices of the windows of the last drift, empty without an alarm; see `drifted_windows`. If
        it is over, it ends before the last one.
    scatter : BatchScatter or None
        By how much batches differ more than by chance; None if it is not known, and chance alone
        is assumed.
    confidence : float
        Confidence of the intervals of deviations, for all classes together.
    observed : ObservedCounts
        All counted parts; the columns of the windows are its groups.
    labels : sequence of str
        Batch or time of the begin of each window; empty if not known.
    """

    simulated: Counts
    windows: Counts
    ends: Counts
    g: Array
    p_values: Array
    level: float
    drifted: range
    scatter: BatchScatter | None
    confidence: float
    observed: ObservedCounts
    labels: Sequence[str]

    @property
    def names(self) -> list[str]:
        """The names of the columns: '3', or '3+4' for classes that were counted together."""
        return ['+'.join(map(str, group)) for group in self.observed.groups]

    @property
    def size(self) -> int:
        """Mean number of parts in a window, rounded."""
        return round(int(self.ends[-1]) / len(self.windows))

    @property
    def untested(self) -> int:
        """Number of parts at the end that do not fill a window."""
        return self.observed.parts - int(self.ends[-1])

    @property
    def alarms(self) -> Counts:
        """Indices of the windows with an alarm."""
        return np.flatnonzero(self.p_values <= self.level)

    @property
    def deviation(self) -> Deviation | None:
        """The largest deviation in the drifted windows; None without an alarm."""
        return self.deviation_in(self.drifted) if self.drifted else None

    def deviation_in(self, windows: range) -> Deviation:
        """Return the largest deviation of the parts of some windows together."""
        parts = self.windows[windows.start : windows.stop].sum(axis=0)
        return largest_deviation(parts, self.simulated, self.confidence, self.scatter)


def find_drift(
    observed: ObservedCounts,
    simulated: Counts,
    window: int,
    generator: np.random.Generator,
    level: float = LEVEL,
    confidence: float = CONFIDENCE,
) -> DriftTest:
    """Test each window of counted parts against the simulated drops.

    Without drift, the probability of an alarm is at most ``level`` for each window, with and
    without overdispersion of the batches. It holds on average over simulations: all windows are
    compared with the same simulated drops, so the alarms are not independent if the drops are few
    in comparison with a window.

    Parameters
    ----------
    observed : ObservedCounts
        Counted parts; each part once.
    simulated : (c,) int
        Simulated drops in each of the two or more groups of ``observed``, at least one in total.
    window : int
        Minimum number of parts in a window; at most the number of parts.
    generator : Generator
        Draws the random tables.
    level : float
        MIN_LEVEL to MAX_LEVEL.

    Raises
    ------
    InvalidValueError
        If an argument is invalid.
    """
    check_number('level', level, MIN_LEVEL, MAX_LEVEL)
    check_confidence(confidence)
    simulated = check_simulated(simulated)
    check_windows(observed, window)
    counts, ends, labels = observed.windows(window)
    scatter = batch_scatter(observed.windows(UNIT)[0])
    p_values = np.array([p_of_window(row, simulated, generator, level, scatter) for row in counts])
    return DriftTest(
        simulated,
        counts,
        ends,
        g_statistic(counts, simulated),
        p_values,
        level,
        drifted_windows(np.flatnonzero(p_values <= level), len(counts)),
        scatter,
        confidence,
        observed,
        labels,
    )


def drifted_windows(alarms: Counts, windows: int) -> range:
    """Return the windows of the last drift; empty without an alarm.

    It has the last alarm, and the earlier ones that are at most GAP windows before another one of
    it. It lasts until the last window, unless GAP windows without an alarm follow.
    """
    if not len(alarms):
        return range(0)
    breaks = np.flatnonzero(np.diff(alarms, prepend=alarms[0] - GAP - 1) > GAP)
    first, end = int(alarms[breaks[-1]]), int(alarms[-1]) + 1
    return range(first, windows if windows - end < GAP else end)


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


def parts_needed(
    simulated: Counts, shift: float = SHIFT, level: float = LEVEL, power: float = POWER
) -> int:
    """Return the smallest window in which a class that deviates by ``shift`` raises an alarm.

    The probability of the alarm is ``power``, whichever class deviates in whichever direction, if
    the other classes keep their proportions, and batches scatter only by chance. If their
    variance is larger by a factor, so is the number of parts.

    The G statistic of a window has approximately a noncentral chi-square distribution. Its
    noncentrality is the G statistic of the mean counts (Agresti 2002, Categorical Data Analysis,
    section 6.5.4), with the simulated drops as the second sample: more parts cannot find a
    deviation that is smaller than the sampling error of the simulation.

    Parameters
    ----------
    simulated : (c,) int
        Simulated drops in each of two or more classes.
    shift : float
        Change of the share of one class; MIN_SHIFT to MAX_SHIFT.
    level, power : float
        Probability of an alarm without and with the deviation.

    Raises
    ------
    InvalidValueError
        If an argument is invalid.
    TooFewDropsError
        If the simulated drops are too few to find the shift with any number of parts.
    """
    counts = check_simulated(simulated)
    check_number('level', level, MIN_LEVEL, MAX_LEVEL)
    check_number('shift', shift, MIN_SHIFT, MAX_SHIFT)
    check_number('power', power, MIN_POWER, MAX_POWER)
    drops = int(counts.sum())
    # Jeffreys' estimate also defines what becomes of the others if only one class was seen.
    expected = np.asarray((counts + 0.5) / (drops + len(counts) / 2), dtype=np.float64)
    drifted, which = _drifted_shares(expected, shift)
    # A class without a drop does not contribute, unless it is the one that drifts.
    freedom = np.maximum((counts > 0).sum() - 1 + (counts[which] == 0), 1)
    noncentrality = chndtrinc(chdtri(freedom, level), freedom, 1 - power)

    def is_found(parts: int) -> bool:
        return bool((g_statistic(parts * drifted, drops * expected) >= noncentrality).all())

    if not is_found(MAX_PARTS):
        raise TooFewDropsError(
            f'invalid number of simulated drops {drops}: expected more, because a shift of '
            f'{100 * shift:g} points is not found with a probability of {100 * power:g} % with '
            'any number of parts'
        )
    return 1 + bisect_left(range(1, MAX_PARTS), True, key=is_found)


def _drifted_shares(expected: Array, shift: float) -> tuple[Array, Counts]:
    """Return the shares (m, c) after each possible shift, and the class (m,) that has it."""
    changed = expected[:, None] + np.array([-shift, shift])
    which, direction = np.nonzero((changed > 0) & (changed < 1))
    share = changed[which, direction]
    drifted = expected * ((1 - share) / (1 - expected[which]))[:, None]
    drifted[np.arange(len(which)), which] = share
    return drifted, which


def check_windows(observed: ObservedCounts, window: int) -> None:
    """Raise InvalidValueError unless the parts are in several classes and fill a window."""
    if len(observed.groups) < 2:
        raise InvalidValueError(
            f'invalid counts in {observed.source!r}: expected two or more classes of aspects that '
            'look different and are counted apart; otherwise no share can drift'
        )
    integer = isinstance(window, int) and not isinstance(window, bool)
    if not (integer and 1 <= window <= observed.parts):
        raise InvalidValueError(
            f'invalid window {shown(window)}: expected an integer from 1 to {observed.parts}, the '
            'number of counted parts'
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
