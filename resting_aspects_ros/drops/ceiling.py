"""How many drops a run can have. Who only asks for drops needs no engine to know it."""

from resting_aspects_ros.core.intervals import CONFIDENCE, INTERVAL
from resting_aspects_ros.core.stopping import drops_for
from resting_aspects_ros.drops.run import MOST_DROPS


def most_drops(
    drops: int,
    precision: float,
    aspects: int = 1,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
) -> int:
    """How many drops a run has at most that is asked for with so many, and a precision.

    Parameters
    ----------
    drops : int
        0 with a precision: as many as it can take.
    precision : float
        0: the run makes all its drops.

    Raises
    ------
    InvalidValueError
        If the precision cannot be.
    """
    if precision == 0:
        return drops
    return drops_for(precision, drops or MOST_DROPS, aspects, interval, confidence)
