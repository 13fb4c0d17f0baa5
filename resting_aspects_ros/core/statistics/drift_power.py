"""Power of the drift test: how many parts find which deviation of a class.

The G statistic of a window has approximately a noncentral chi-square distribution. Its
noncentrality is the G statistic of the mean counts (Agresti 2002, Categorical Data Analysis,
section 6.5.4), with the simulated drops as the second sample: more parts cannot find a deviation
that is smaller than the sampling error of the simulation. This holds for small deviations. With a
larger one the variance of the drifted shares differs from that of the expected ones, and with it
that of the statistic, by which the power is corrected.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import chdtrc, chdtri, chndtr, ndtr, ndtri

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.batch_scatter import BatchScatter
from resting_aspects_ros.core.statistics.drift import (
    LEVEL,
    MAX_LEVEL,
    MIN_LEVEL,
    check_level,
    check_simulated,
)
from resting_aspects_ros.core.statistics.g_test import g_statistic
from resting_aspects_ros.core.statistics.intervals import Array, Counts

POWER = 0.8
# A deviation that matters for a feeder: a class with 55 % instead of 50 %.
SHIFT = 0.05
# The rarest class can always deviate by this much.
MAX_SHIFT = 0.4
MAX_PARTS = 100_000_000
# Noncentrality above which the power is 1 in any case.
_CERTAIN = 1e4
# Values of the error of the scatter over which is averaged.
_QUANTILES = 200


class TooFewDropsError(InvalidValueError):
    """No number of parts finds a deviation, because the simulation has too few drops."""


def power_of(
    simulated: Counts,
    parts: int,
    shift: float,
    level: float = LEVEL,
    scatter: BatchScatter | None = None,
) -> float:
    """Return the probability that a window with a drifted class raises an alarm.

    It is the lowest for any class that deviates by ``shift`` in either direction, if the other
    classes keep their proportions. The class with the share nearest to 1/2 is the hardest to find.

    Parameters
    ----------
    simulated : (c,) int
        Simulated drops in each of two or more classes.
    parts : int
        Parts of the window, 1 or more.
    shift : float
        Change of the share of one class; above 0, at most MAX_SHIFT.
    level : float
        Probability of an alarm without drift.
    scatter : BatchScatter, optional
        Of the batches of which the window consists; its estimate is taken as the truth.
    """
    counts = check_simulated(simulated)
    check_shift(shift)
    check_level(level)
    # Jeffreys' estimate also defines what becomes of the others if only one class was seen.
    expected = (counts + 0.5) / (counts.sum() + len(counts) / 2)
    drifted, which = _drifted_shares(expected, shift)
    drops = int(counts.sum())
    mean = np.minimum(g_statistic(parts * drifted, drops * expected), _CERTAIN)
    factor = 1.0 if scatter is None else float(scatter.inflation(parts, drops))
    # A class without a drop does not contribute, unless it is the one that drifts.
    freedom = np.maximum((counts > 0).sum() - 1 + (counts[which] == 0), 1)
    variance = _variance(parts, drifted, drops, expected) / factor
    mean = mean / factor
    power = 1 - chndtr(_critical(scatter, parts, drops, freedom, level), freedom, mean)
    scale = np.sqrt((variance + 2 * freedom) / (4 * mean + 2 * freedom))
    return float(ndtr(ndtri(power) / scale).min())


def _critical(
    scatter: BatchScatter | None, parts: int, drops: int, freedom: Counts, level: float
) -> Array:
    """Return the statistic, divided by its factor, from which there is an alarm; like freedom.

    The factor is not known exactly, which makes the critical value larger.
    """
    found: Array = np.asarray(chdtri(freedom, level), dtype=np.float64)
    if scatter is None:
        return found
    every = scatter.reference[:: len(scatter.reference) // _QUANTILES]
    ratio = scatter.inflation(parts, drops, every) / scatter.inflation(parts, drops)
    for k in np.unique(freedom).tolist():
        low, high = 0.0, float(chdtri(k, level / 2)) * float(ratio.max()) * 2
        while high - low > 1e-3 * high:
            middle = (low + high) / 2
            beyond = float(chdtrc(k, middle / ratio).mean())
            low, high = (middle, high) if beyond > level else (low, middle)
        found[freedom == k] = high
    return found


def _variance(parts: int, drifted: Array, drops: int, expected: Array) -> Array:
    """Return the variance (m,) of the G statistic by the delta method; 4 x mean without drift."""
    pooled = (parts * drifted + drops * expected) / (parts + drops)
    total = np.zeros(len(drifted))
    for count, share in ((parts, drifted), (drops, expected)):
        slope = 2 * np.log(share / pooled)
        total += count * ((share * slope**2).sum(axis=1) - (share * slope).sum(axis=1) ** 2)
    return total


def parts_needed(
    simulated: Counts,
    shift: float = SHIFT,
    level: float = LEVEL,
    power: float = POWER,
    scatter: BatchScatter | None = None,
) -> int:
    """Return the smallest window in which a class that deviates by ``shift`` is found.

    It is found with a probability of ``power``, whichever class it is. For arguments and errors
    see `power_of`; TooFewDropsError is also raised if the simulated drops are too few to find
    the shift with any number of parts.
    """
    check_power(power)
    return _smallest(
        lambda n: power_of(simulated, n, shift, level, scatter), power, simulated, shift
    )


def parts_for_run_length(
    simulated: Counts,
    run_length: int,
    shift: float = SHIFT,
    power: float = POWER,
    scatter: BatchScatter | None = None,
) -> int:
    """Return the smallest window that finds a shift, for a mean distance of false alarms.

    The level of a window of n parts is n / run_length, so that ``run_length`` is the mean number
    of parts between false alarms. Raises InvalidValueError as `parts_needed`.
    """
    check_power(power)
    return _smallest(
        lambda n: power_of(
            simulated, n, shift, min(max(n / run_length, MIN_LEVEL), MAX_LEVEL), scatter
        ),
        power,
        simulated,
        shift,
    )


def detectable_shift(
    simulated: Counts,
    parts: int,
    level: float = LEVEL,
    power: float = POWER,
    scatter: BatchScatter | None = None,
) -> float:
    """Return the smallest shift that a window of ``parts`` finds; nan above MAX_SHIFT."""
    check_power(power)
    low, high = 0.0, MAX_SHIFT
    if power_of(simulated, parts, high, level, scatter) < power:
        return float('nan')
    while high - low > 1e-6:
        middle = (low + high) / 2
        found = power_of(simulated, parts, middle, level, scatter) >= power
        low, high = (low, middle) if found else (middle, high)
    return high


def check_power(power: float) -> None:
    """Raise InvalidValueError unless the power is between 0 and 1."""
    number = isinstance(power, int | float) and not isinstance(power, bool)
    if not (number and 0 < power < 1):
        raise InvalidValueError(f'invalid power {shown(power)}: expected more than 0, less than 1')


def check_shift(shift: float) -> None:
    """Raise InvalidValueError unless the shift of a share is above 0, at most MAX_SHIFT."""
    number = isinstance(shift, int | float) and not isinstance(shift, bool)
    if not (number and 0 < shift <= MAX_SHIFT):
        raise InvalidValueError(
            f'invalid shift {shown(shift)}: expected more than 0, at most {MAX_SHIFT:g}'
        )


def _drifted_shares(expected: Array, shift: float) -> tuple[Array, Counts]:
    """Return the shares (m, c) after each possible shift, and the class (m,) that has it."""
    changed = expected[:, None] + np.array([-shift, shift])
    which, direction = np.nonzero((changed > 0) & (changed < 1))
    share = changed[which, direction]
    drifted = expected * ((1 - share) / (1 - expected[which]))[:, None]
    drifted[np.arange(len(which)), which] = share
    return drifted, which


def _smallest(
    power_at: Callable[[int], float], power: float, simulated: Counts, shift: float
) -> int:
    low, high = 0, 1
    while power_at(high) < power:
        low, high = high, 2 * high
        if high > MAX_PARTS:
            raise TooFewDropsError(
                f'invalid number of simulated drops {int(np.sum(simulated))}: expected more, '
                f'because a shift of {100 * shift:g} points is not found with a probability of '
                f'{100 * power:g} % with any number of parts'
            )
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power_at(middle) >= power else (middle, high)
    return high
