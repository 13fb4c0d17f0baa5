"""The stopping rule: a run stops as soon as the interval of every aspect is narrow enough.

The rule is evaluated only at checkpoints, fixed numbers of drops that are the same for all runs.
So a run stops at the same drop for any number of workers and any batch size.

A run that stops by its own counts errs slightly more often than a run with a fixed number of
drops. A share far from 1/2 has a narrower interval, so a share that is too extreme by chance stops
the run at once, while a correct share gives the next checkpoint another chance to be wrong. With
two checkpoints, the second at a quarter more drops, 6.0 % of runs miss the truth instead of 5 %,
where the true share is such that either checkpoint can be the last (normal shares, with a
correlation of sqrt(1 / 1.25)). Computed exactly, for Wilson's intervals at 95 % and shares of ten
drops or more, the coverage is 0.950 on average over the shares, below 0.938 for one share in a
hundred, and 0.933 in the worst case. (With a fixed number of drops the worst case is 0.933 too,
because counts are integers.) Intervals at `stopping_confidence` correct this: the coverage is
below 0.950 for one share in a hundred, and 0.945 in the worst case. Frey 2010 (The American
Statistician 64:242) corrects intervals of fixed width in the same way.
"""

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    bounds,
    check_confidence,
)

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
    number = isinstance(precision, int | float) and not isinstance(precision, bool)
    if not (number and MIN_PRECISION <= precision <= MAX_PRECISION):
        raise InvalidValueError(
            f'invalid precision {precision!r}: expected {MIN_PRECISION} to {MAX_PRECISION}'
        )


def stopping_confidence(confidence: float = CONFIDENCE) -> float:
    """Return the confidence of the intervals at a checkpoint, and of the run that it stops.

    For a confidence of 0.95 it is 0.96.
    """
    check_confidence(confidence)
    return 1 - ERROR_SHARE * (1 - confidence)


def drops_for(
    precision: float,
    drop_limit: int,
    aspects: int = 1,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> int:
    """Return the number of drops at which a run stops at the latest, for any counts.

    Intervals are widest at a share of 1/2.
    """
    for drops in checkpoints(drop_limit):
        widest = [drops // 2] + [0] * (aspects - 1)
        if is_precise(widest, drops, precision, method, confidence):
            return drops
    return drop_limit


def max_drops(
    drops: int,
    precision: float,
    limit: int,
    aspects: int = 1,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> int:
    """Return the maximum number of drops of a run.

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
    return drops_for(precision, drops or limit, aspects, method, confidence)


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


def stops(
    counts: npt.ArrayLike,
    drops: int,
    precision: float,
    drop_limit: int,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> bool:
    """Return whether a run stops with these counts: at the limit, or at a precise checkpoint.

    With a precision of 0 it stops only at the limit.
    """
    if drops >= drop_limit:
        return True
    at_checkpoint = precision > 0 and drops in checkpoints(drop_limit)
    return at_checkpoint and is_precise(counts, drops, precision, method, confidence)
