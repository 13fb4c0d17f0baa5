"""Confidence intervals of the probabilities count / drops, and the stopping rule of a run."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import betaincinv, ndtri

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown

CONFIDENCE = 0.95
INTERVAL = 'wilson'
SIMULTANEOUS = 'simultaneous'
METHODS = (INTERVAL, SIMULTANEOUS)


@dataclass(frozen=True)
class Interval:
    """A probability with its confidence interval."""

    probability: float
    lower: float
    upper: float


def intervals(
    counts: npt.ArrayLike, drops: int, method: str = INTERVAL, confidence: float = CONFIDENCE
) -> list[Interval]:
    """Return the share of the drops of each of k counts, with its interval; see `bounds`."""
    lower, upper = bounds(counts, drops, method, confidence)
    shares = np.asarray(counts) / max(drops, 1)
    rows = zip(shares.tolist(), lower.tolist(), upper.tolist(), strict=True)
    return [Interval(*row) for row in rows]


def bounds(
    counts: npt.ArrayLike,
    drops: npt.ArrayLike,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> tuple[Array, Array]:
    """Return the lower and upper bounds of the probabilities behind counts.

    The lower bound of a count of zero is 0, the upper bound of a count of all drops is 1. Without
    drops the bounds are 0 and 1.

    Parameters
    ----------
    counts : (..., k) int
        Drops in each of the k aspects of a part.
    drops : (...) int
        All drops, including those that are in no aspect.
    method : str
        One of METHODS.
    confidence : float
        More than 0.5 and less than 1.

    Raises
    ------
    InvalidValueError
        If an argument is invalid.
    """
    check_interval_method(method)
    check_confidence(confidence)
    c, n = _checked(counts, drops)
    divisor = np.maximum(n, 1)  # avoids a division by zero without drops
    if method == SIMULTANEOUS:
        lower, upper = _clopper_pearson(c, divisor, (1 - confidence) / 2 / max(c.shape[-1], 1))
    else:
        lower, upper = _wilson(c, divisor, (1 - confidence) / 2)
    lower, upper = containing(c / divisor, lower.clip(0.0, 1.0), upper.clip(0.0, 1.0))
    return np.where(c == 0, 0.0, lower), np.where(c == n, 1.0, upper)


def containing(
    value: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> tuple[Array, Array]:
    """Return bounds that are extended to the value that they belong to, so that they contain it.

    The mean of a skewed distribution can be outside its quantiles, an estimate at the border of
    what is possible outside those of draws, and bounds can miss a share by a rounding error.
    """
    return np.minimum(lower, value), np.maximum(upper, value)


def check_interval_method(method: str) -> None:
    """Raise InvalidValueError if there is no such method."""
    if method not in METHODS:
        raise InvalidValueError(f'invalid interval {method!r}: expected {" or ".join(METHODS)}')


def check_confidence(confidence: float) -> None:
    """Raise InvalidValueError unless the confidence is above 0.5 and below 1."""
    number = isinstance(confidence, int | float) and not isinstance(confidence, bool)
    if not (number and 0.5 < confidence < 1):
        raise InvalidValueError(
            f'invalid confidence {confidence!r}: expected more than 0.5 and less than 1'
        )


def check_number(name: str, value: float, low: float, high: float) -> None:
    """Raise InvalidValueError unless a value is a number from ``low`` to ``high``."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and low <= value <= high):
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected {low:g} to {high:g}')


def _checked(counts: npt.ArrayLike, drops: npt.ArrayLike) -> tuple[Counts, Counts]:
    c = np.asarray(counts, dtype=np.int64)
    n = np.asarray(drops, dtype=np.int64)[..., None]
    if (c < 0).any() or (c.sum(axis=-1, keepdims=True) > n).any():
        raise InvalidValueError(
            f'invalid counts {c.tolist()}: expected 0 or more, at most '
            f'{np.asarray(drops).tolist()} in total'
        )
    return c, n


def _wilson(count: Counts, drops: Counts, tail: float) -> tuple[Array, Array]:
    """Return the bounds of all p within z sqrt(p (1 - p) / n) of count / n (Wilson 1927)."""
    z = -ndtri(tail)
    share, spread = count / drops, z**2 / drops
    middle = (share + spread / 2) / (1 + spread)
    half = np.sqrt(spread * (share * (1 - share) + spread / 4)) / (1 + spread)
    return middle - half, middle + half


def _clopper_pearson(count: Counts, drops: Counts, tail: float) -> tuple[Array, Array]:
    """Return Clopper and Pearson's bounds (1934), computed as quantiles of beta distributions.

    They contain all p for which a count at most or at least as large has a probability of
    ``tail`` or more. The lower bound of a count of zero and the upper bound of a count of all
    drops are arbitrary.
    """
    lower = betaincinv(np.maximum(count, 1), drops - count + 1, tail)
    upper = 1 - betaincinv(np.maximum(drops - count, 1), count + 1, tail)
    return np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)


# -- Stopping -------------------------------------------------------------------------------------


FIRST_CHECKPOINT = 250
# Checkpoints are multiples of the chunk of drops that a worker simulates, because a checkpoint
# within a chunk would waste the rest of it.
CHECKPOINT_STEP = 125
# 2,000,000 drops, the maximum of a run, reach 0.001 for any probability: for each aspect by itself
# up to a confidence of 99 %, and for up to eight aspects at once at 95 %.
MIN_PRECISION = 0.001
# The first checkpoint reaches 0.1 or better for any probability, so a larger precision than this
# is a mistake.
MAX_PRECISION = 0.25
# Error probability at a checkpoint, as a share of that with a fixed number of drops.
ERROR_SHARE = 0.8


def checkpoints(drop_limit: int) -> list[int]:
    """Return the numbers of drops at which the rule is evaluated, ascending, up to the limit.

    They begin with 250, and each is a quarter more than the one before, rounded up to a multiple
    of 125. Raises InvalidValueError if the limit is less than one drop.
    """
    if drop_limit < 1:
        raise InvalidValueError(f'invalid drop limit {drop_limit}: expected 1 or more')
    found = []
    drops = FIRST_CHECKPOINT
    while drops < drop_limit:
        found.append(drops)
        # In integers, so that the result is the same on every machine.
        drops = -(-5 * drops // (4 * CHECKPOINT_STEP)) * CHECKPOINT_STEP
    return [*found, drop_limit]


def check_precision(precision: float) -> None:
    """Raise InvalidValueError unless the precision is within the limits for a run."""
    check_number('precision', precision, MIN_PRECISION, MAX_PRECISION)


def stopping_confidence(confidence: float = CONFIDENCE) -> float:
    """Return the confidence of the intervals at a checkpoint, and of the run that it stops.

    For a confidence of 0.95 it is 0.96.
    """
    check_confidence(confidence)
    return 1 - ERROR_SHARE * (1 - confidence)


def max_drops(
    drops: int,
    precision: float,
    limit: int,
    aspects: int = 1,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> int:
    """Return the maximum number of drops of a run, for any counts.

    Parameters
    ----------
    drops : int
        Number of drops that are requested; 0 with a precision: as many as it takes, up to
        ``limit``.
    precision : float
        Half width of the intervals at which the run stops; 0: it makes all drops. Raises
        InvalidValueError if it is outside the limits.
    """
    if precision == 0:
        return drops
    for number in checkpoints(drops or limit):
        # Intervals are widest at a share of 1/2.
        widest = [number // 2] + [0] * (aspects - 1)
        if is_precise(widest, number, precision, method, confidence):
            return number
    return drops or limit


def is_precise(
    counts: npt.ArrayLike,
    drops: int,
    precision: float,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> bool:
    """Return whether the interval of every aspect, seen or not, has at most this half width.

    The intervals are those at `stopping_confidence`; for counts and drops see `bounds`.
    """
    check_precision(precision)
    lower, upper = bounds(counts, drops, method, stopping_confidence(confidence))
    return bool(np.all(upper - lower <= 2 * precision))
