"""When to stop dropping: as soon as every aspect is known to within a precision.

Counts are looked at only after certain numbers of drops, which are the same for all runs. So a
run stops at the same drop whatever the number of workers and the size of their batches.

A run that stops when its own counts look good enough errs a little more often than one of a
fixed number of drops: a share far from 1/2 has a narrower interval, so a share that is too far
off by chance stops the run at once, and a right one gives the next look another chance to be
wrong. Two looks, one at a quarter more drops, miss what they should miss in 5 % of runs in 6.0 %,
where the true share is such that either can be the last (normal shares, which correlate by
sqrt(1 / 1.25)). Counted exactly, for Wilson's intervals at 95 % and shares of ten drops or more,
coverage is 0.950 on the mean over shares, less than 0.938 for one in a hundred, and 0.933 at
worst. (In a fixed number of drops it is 0.933 at worst too, since counts are whole.) Intervals at
`stopping_confidence` have it back: less than 0.950 for one in a hundred, and 0.945 at worst.
Frey 2010 (The American Statistician 64:242) mends intervals of fixed width in the same way.
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

FIRST_LOOK = 250
# Drops are made in chunks of this many; a look within one would waste the rest of it.
LOOK_STEP = 125
# 2,000,000 drops, the most of a run, reach 0.001 for any probability: of each aspect by itself up
# to a confidence of 99 %, and of up to eight at once at 95 %.
MIN_PRECISION = 0.001
# The first look has 0.1 or better for any probability: to ask for more than this is a mistake.
MAX_PRECISION = 0.25
# Of what the intervals of a fixed number of drops may miss, what is left for the last look.
LAST_LOOK = 0.8


def looks(ceiling: int) -> list[int]:
    """The numbers of drops after which to look, ascending; the last is the ceiling.

    From 250, each a quarter more than the one before, rounded up to a multiple of 125. Raises
    InvalidValueError for a ceiling of less than one drop.
    """
    if ceiling < 1:
        raise InvalidValueError(f'ceiling is {ceiling} drops, allowed is 1 or more')
    found = []
    look = FIRST_LOOK
    while look < ceiling:
        found.append(look)
        # Whole numbers only: the same on every machine.
        look = -(-5 * look // (4 * LOOK_STEP)) * LOOK_STEP
    return [*found, ceiling]


def check_precision(precision: float) -> None:
    """Raises InvalidValueError if no run can be asked for this precision."""
    number = isinstance(precision, int | float) and not isinstance(precision, bool)
    if not (number and MIN_PRECISION <= precision <= MAX_PRECISION):
        raise InvalidValueError(
            f'precision is {precision!r}, allowed is {MIN_PRECISION} to {MAX_PRECISION}'
        )


def stopping_confidence(confidence: float = CONFIDENCE) -> float:
    """The confidence at which to look, and to give the intervals of a run that stopped by it.

    0.96 for 0.95.
    """
    check_confidence(confidence)
    return 1 - LAST_LOOK * (1 - confidence)


def drops_for(
    precision: float,
    ceiling: int,
    aspects: int = 1,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> int:
    """The look, or the ceiling, by which a run stops whatever its counts are.

    Intervals are widest at a share of 1/2.
    """
    for look in looks(ceiling):
        widest = [look // 2] + [0] * (aspects - 1)
        if is_precise(widest, look, precision, method, confidence):
            return look
    return ceiling


def max_drops(
    drops: int,
    precision: float,
    limit: int,
    aspects: int = 1,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> int:
    """How many drops a run makes at most; raises InvalidValueError for a wrong precision.

    Parameters
    ----------
    drops : int
        That are requested; 0 with a precision: as many as it takes, up to ``limit``.
    precision : float
        At which the run stops; 0: it makes all its drops.
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
    """Whether every aspect, seen or not, has an interval of half width ``precision`` or less.

    The intervals are those at `stopping_confidence`; counts and drops are as `bounds` has them.
    """
    check_precision(precision)
    lower, upper = bounds(counts, drops, method, stopping_confidence(confidence))
    return bool(np.all(upper - lower <= 2 * precision))


def stops(
    counts: npt.ArrayLike,
    drops: int,
    precision: float,
    ceiling: int,
    method: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> bool:
    """Whether a run is over with these counts: at the ceiling, or at a look that is precise.

    With a precision of 0: at the ceiling only.
    """
    if drops >= ceiling:
        return True
    at_look = precision > 0 and drops in looks(ceiling)
    return at_look and is_precise(counts, drops, precision, method, confidence)
