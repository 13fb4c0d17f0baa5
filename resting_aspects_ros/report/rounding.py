"""Numbers as a person reads them: no more digits than are known."""

import math

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.distribution import Distribution, Interval


def interval_of(distribution: Distribution, count: int) -> Interval:
    """The probability, with its interval, of an outcome that ``count`` of all the drops had.

    For outcomes that are no aspect: drops that are unclassified, or several aspects together.
    """
    rest = distribution.drops - count
    counted = Distribution(distribution.aspects, np.array([count, rest]), 0, 0, 0)
    return counted.intervals()[0]


def decimals_of(interval: Interval, *, percent: bool = True) -> int:
    """Decimals that a probability is shown with: two digits of its interval's width.

    An interval that is 0.05 wide gives 0.278 or 27.8 %; more drops give more digits.
    """
    width = max(interval.upper - interval.lower, 1e-12)
    decimals = math.ceil(-math.log10(width)) + 1
    return max(decimals - (2 if percent else 0), 0)


def probability_text(interval: Interval) -> str:
    """In percent, as '27.8 %'."""
    return f'{100 * interval.probability:.{decimals_of(interval)}f} %'


def interval_text(interval: Interval) -> str:
    """Both ends in percent, as '25.1 to 30.7 %'."""
    decimals = decimals_of(interval)
    return f'{100 * interval.lower:.{decimals}f} to {100 * interval.upper:.{decimals}f} %'


def direction_text(direction: npt.NDArray[np.float64]) -> str:
    """A unit vector (3,), as '+0.55 +0.83  0.00': of one length, and zero has no sign."""
    return ' '.join(_signed(float(x)) for x in direction)


def millimetre_texts(lengths: npt.NDArray[np.float64]) -> list[str]:
    """Lengths (n,), m, in mm: four digits of the longest, and all with its decimals."""
    longest = float(lengths.max(initial=0.0)) * 1000
    whole_digits = math.floor(math.log10(longest)) + 1 if longest > 0 else 1
    return [f'{1000 * length:.{max(4 - whole_digits, 0)}f}' for length in lengths]


def _signed(value: float) -> str:
    text = f'{value:+.2f}'
    return ' 0.00' if text in ('+0.00', '-0.00') else text
