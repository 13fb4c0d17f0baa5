"""Test whether counted parts still have the shares of the simulation."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.drift_result import DriftResult
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.inputs.count_files import read_counts
from resting_aspects_ros.api.inputs.counts import (
    CountedDrops,
    check_counts,
    counted_by_class,
    counts_of_run,
)
from resting_aspects_ros.api.inputs.counts_csv import read_observed
from resting_aspects_ros.api.inputs.observed_counts import ObservedCounts, counts_from_array
from resting_aspects_ros.core.errors import InvalidValueError, shown, warn
from resting_aspects_ros.core.statistics.drift import (
    LEVEL,
    MAX_LEVEL,
    MIN_LEVEL,
    check_level,
    find_drift,
)
from resting_aspects_ros.core.statistics.drift_power import (
    POWER,
    SHIFT,
    TooFewDropsError,
    check_shift,
    parts_for_run_length,
    parts_needed,
)
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, Counts, check_confidence
from resting_aspects_ros.core.statistics.live_counts import PRIOR_WEIGHT, LiveCounts, check_weight
from resting_aspects_ros.report.drift_table import DriftWindows

# Seed of the random tables, so that equal inputs give equal results.
SEED = 1
MAX_RUN_LENGTH = 10**12


def watch_drift(
    expected: DropResult | str | Path,
    counts: ObservedCounts | str | Path | npt.ArrayLike,
    *,
    window: int | None = None,
    level: float | None = None,
    run_length: int | None = None,
    shift: float = SHIFT,
    cumulative: bool = False,
    prior_weight: float = PRIOR_WEIGHT,
    confidence: float = CONFIDENCE,
) -> DriftResult:
    """Test whether counted parts still have the shares of the simulation.

    The parts are divided into disjoint windows in the order in which they were counted. Each
    window is compared with the simulated drops by symmetry class.

    Parameters
    ----------
    expected : DropResult, str or Path
        Simulated drops: a result, or a file as in `compare`.
    counts : str, Path, (b, c) int or ObservedCounts
        Newly supplied parts, each counted once: a CSV, an array with a row for each batch and a
        column for each symmetry class, or what `read_observed` returned.
    window : int, optional
        Minimum number of parts in a window; batches are not divided. By default the number with
        which a class that is off by ``shift`` is found with a probability of 80 %. If fewer parts
        were counted, they are one window.
    level : float, optional
        Probability of an alarm in a window without drift, 0.0001 to 0.25; 0.01 by default.
    run_length : int, optional
        Mean number of parts between false alarms, instead of ``level``, which is then the
        window divided by it.
    shift : float
        The deviation of a class that should be found, above 0, at most 0.4.
    cumulative : bool
        Whether each count in the file is the total since the start.
    prior_weight : float
        Weight of the simulated drops in the shares of `DriftResult.live`, in parts.
    confidence : float
        Confidence of the intervals: more than 0.5 and less than 1.

    Returns
    -------
    DriftResult

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a file cannot be read, or the part has only one class.

    Warns
    -----
    RestingAspectsWarning
        The simulated drops are too few to find ``shift`` with any window.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> expected = ra.drop('l_bracket', drops=500, seed=1)
    >>> ra.watch_drift(expected, [[56, 53, 50, 26, 15]], window=200).verdict
    'No drift in 1 window of 200 parts.'
    """
    simulated = _simulated(expected)
    drops = simulated.tally.counts
    if cumulative and not isinstance(counts, str | Path):
        raise InvalidValueError('invalid cumulative True: expected only for counts in a file')
    if isinstance(counts, ObservedCounts):
        observed = counts
    elif isinstance(counts, str | Path):
        observed = read_observed(Path(counts), simulated.ids, cumulative=cumulative)
    else:
        observed = counts_from_array(counts, len(drops))
    check_options(observed, len(drops), window, level, run_length, shift, prior_weight, confidence)
    size, tested_level = _window(drops, observed.parts, window, level, run_length, shift)
    windows, ends, labels = observed.windows(size, len(drops))
    live = LiveCounts(simulated.ids, drops, observed.totals(len(drops)), prior_weight)
    test = find_drift(windows, drops, np.random.default_rng(SEED), tested_level)
    tested = DriftWindows(test, live, ends, labels, confidence, POWER)
    return DriftResult(simulated, observed.source, tested)


def check_options(
    observed: ObservedCounts,
    classes: int,
    window: int | None = None,
    level: float | None = None,
    run_length: int | None = None,
    shift: float = SHIFT,
    prior_weight: float = PRIOR_WEIGHT,
    confidence: float = CONFIDENCE,
) -> None:
    """Raise InvalidValueError if an option of `watch_drift` is invalid, before any drop.

    classes : int
        Number of symmetry classes of the part.
    """
    check_confidence(confidence)
    check_weight(prior_weight)
    check_shift(shift)
    if classes < 2:
        raise InvalidValueError(
            'invalid part: expected two or more classes of aspects that look different; all '
            'aspects of this part look the same, so that their shares cannot drift'
        )
    if level is not None:
        check_level(level)
    if window is not None:
        _check_integer('window', window)
        if window > observed.parts:
            raise InvalidValueError(
                f'invalid window {window}: expected at most {observed.parts}, the number of '
                'counted parts'
            )
    if run_length is not None:
        _check_integer('run length', run_length)
        if level is not None:
            raise InvalidValueError(
                f'invalid run length {run_length}: expected only without a level'
            )


def _simulated(expected: DropResult | str | Path) -> CountedDrops:
    if isinstance(expected, DropResult):
        given = counts_of_run(
            f'run {expected.run.run_id}',
            expected.distribution,
            expected.run,
            complete=expected.complete,
        )
        check_counts(given)
        return counted_by_class(given)
    return counted_by_class(read_counts(Path(expected)))


def _window(
    drops: Counts,
    parts: int,
    window: int | None,
    level: float | None,
    run_length: int | None,
    shift: float,
) -> tuple[int, float]:
    """Return the number of parts in a window and its level; raises InvalidValueError."""
    if run_length is None:
        needed = partial(parts_needed, drops, shift, LEVEL if level is None else level)
    else:
        needed = partial(parts_for_run_length, drops, run_length, shift)
    size = min(_default_window(needed, drops, shift), parts) if window is None else window
    if run_length is not None:
        shortest, longest = math.ceil(size / MAX_LEVEL), math.floor(size / MIN_LEVEL)
        if not shortest <= run_length <= longest:
            raise InvalidValueError(
                f'invalid run length {run_length}: expected {shortest} to {longest} parts for '
                f'windows of {size} parts'
            )
        return size, size / run_length
    return size, LEVEL if level is None else level


def _default_window(needed: Callable[[], int], drops: Counts, shift: float) -> int:
    """Return the number of parts that finds the shift, or that of the drops if none does."""
    try:
        return needed()
    except TooFewDropsError:
        count = int(drops.sum())
        warn(
            f'{count} simulated drops are too few to find a class that is off by '
            f'{100 * shift:g} points with a probability of {100 * POWER:g} %: a window has as '
            'many parts as drops; simulate more drops'
        )
        return count


def _check_integer(name: str, number: int) -> None:
    integer = isinstance(number, int) and not isinstance(number, bool)
    if not (integer and 1 <= number <= MAX_RUN_LENGTH):
        raise InvalidValueError(
            f'invalid {name} {shown(number)}: expected an integer from 1 to {MAX_RUN_LENGTH}'
        )
