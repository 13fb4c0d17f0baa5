"""The options of a drift test, and the windows that follow from them."""

import math
from collections.abc import Callable
from functools import partial

from resting_aspects_ros.api.inputs.observed_counts import ObservedCounts
from resting_aspects_ros.core.errors import InvalidValueError, shown, warn
from resting_aspects_ros.core.statistics.batch_scatter import BatchScatter
from resting_aspects_ros.core.statistics.drift import LEVEL, MAX_LEVEL, MIN_LEVEL, check_level
from resting_aspects_ros.core.statistics.drift_power import (
    POWER,
    SHIFT,
    TooFewDropsError,
    check_shift,
    parts_for_run_length,
    parts_needed,
)
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, Counts, check_confidence
from resting_aspects_ros.core.statistics.live_counts import PRIOR_WEIGHT, check_weight

MAX_RUN_LENGTH = 10**12


def check_options(
    observed: ObservedCounts,
    window: int | None = None,
    level: float | None = None,
    run_length: int | None = None,
    shift: float = SHIFT,
    prior_weight: float = PRIOR_WEIGHT,
    confidence: float = CONFIDENCE,
) -> None:
    """Raise InvalidValueError if an option of `watch_drift` is invalid, before any drop."""
    check_confidence(confidence)
    check_weight(prior_weight)
    check_shift(shift)
    if len(observed.groups) < 2:
        several = any(len(group) > 1 for group in observed.groups)
        reason = (
            'all classes are counted together'
            if several
            else ('all aspects of this part look the same')
        )
        raise InvalidValueError(
            'invalid part: expected two or more classes of aspects that look different; '
            f'{reason}, so that their shares cannot drift'
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
        _check_run_length(observed, window, run_length)


def _check_run_length(observed: ObservedCounts, window: int | None, run_length: int) -> None:
    """Raise InvalidValueError if no window has a level within the limits."""
    if window is None:
        least, most = 1.0, float(observed.parts)
    else:
        _, ends, _ = observed.windows(window)
        least = most = int(ends[-1]) / (len(ends) - 1)
    shortest, longest = math.ceil(least / MAX_LEVEL), math.floor(most / MIN_LEVEL)
    if not shortest <= run_length <= longest:
        sizes = f'{"up to " if window is None else ""}{most:.10g}'
        raise InvalidValueError(
            f'invalid run length {run_length}: expected {shortest} to {longest} parts for '
            f'windows of {sizes} parts'
        )


def window_size(
    drops: Counts,
    parts: int,
    window: int | None,
    level: float | None,
    run_length: int | None,
    shift: float,
    scatter: BatchScatter | None = None,
) -> int:
    """Return the number of parts in a window."""
    if window is not None:
        return window
    if run_length is None:
        tested = LEVEL if level is None else level
        needed = partial(parts_needed, drops, shift, tested, scatter=scatter)
        return min(_default_window(needed, drops, shift), parts)
    needed = partial(parts_for_run_length, drops, run_length, shift, scatter=scatter)
    size = _default_window(needed, drops, shift)
    # The level, window / run length, has limits.
    limits = math.ceil(run_length * MIN_LEVEL), math.floor(run_length * MAX_LEVEL)
    return min(max(size, limits[0]), limits[1], parts)


def window_level(parts: float, level: float | None, run_length: int | None) -> float:
    """Return the level of windows with a mean number of parts."""
    if run_length is None:
        return LEVEL if level is None else level
    return min(max(parts / run_length, MIN_LEVEL), MAX_LEVEL)


def _default_window(needed: Callable[[], int], drops: Counts, shift: float) -> int:
    """Return the number of parts that finds the shift, or that of the drops if none does."""
    try:
        return needed()
    except TooFewDropsError:
        count = int(drops.sum())
        warn(
            f'{count} simulated drops are too few to find a class that deviates by '
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
