"""Format numbers for people, with no more digits than are known."""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.part.part import Part
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval


def interval_of(distribution: Distribution, count: int) -> Interval:
    """Return the probability and its interval of an outcome that ``count`` drops had.

    It serves outcomes that are not a single aspect: unclassified drops, or several aspects
    together.
    """
    rest = distribution.drops - count
    counted = dataclasses.replace(
        distribution,
        counts=np.array([count, rest]),
        unclassified=0,
        unsettled=0,
        failed=0,
        lost=0,
        sliding=0,
    )
    return counted.intervals()[0]


def outside_aspects(distribution: Distribution) -> list[tuple[str, int]]:
    """Return the name and the count of each outcome in no aspect that occurred."""
    counts = {
        'unclassified': distribution.unclassified,
        'unsettled': distribution.unsettled,
        'failed': distribution.failed,
        'lost': distribution.lost,
        'sliding': distribution.sliding,
    }
    return [(name, count) for name, count in counts.items() if count]


def decimals_of(interval: Interval) -> int:
    """Return the number of decimals of a percentage: two digits of the width of its interval.

    An interval that is 5 % wide gives 27.8 %; more drops give more digits. Exact values have none.
    """
    if interval.upper == interval.lower:
        return 0
    width = max(100 * (interval.upper - interval.lower), 1e-9)
    return max(math.ceil(-math.log10(width)) + 1, 0)


def probability_text(interval: Interval) -> str:
    """Return the probability in percent, as '27.8 %'; '0 %' if the count is zero."""
    return f'{_percent(interval.probability, decimals_of(interval))} %'


def interval_text(interval: Interval) -> str:
    """Return both bounds in percent, as '25.1 to 30.7 %' or '0 to 0.38 %'."""
    decimals = decimals_of(interval)
    return f'{_percent(interval.lower, decimals)} to {_percent(interval.upper, decimals)} %'


def points_text(deviation: float, lower: float, upper: float) -> str:
    """Return a difference of shares in percentage points, as '+3.1 (-0.9 to +7.0)'."""
    decimals = decimals_of(Interval(deviation, lower, upper))
    difference, low, high = (points(x, decimals) for x in (deviation, lower, upper))
    return f'{difference} ({low} to {high})'


def shown_difference(first: float, second: float, decimals: int) -> float:
    """Return first - second of two shares as they are shown, in percent with these decimals.

    A reader who subtracts the shown numbers gets the same. It differs from the exact difference by
    at most one unit of the last digit.
    """
    return (round(100 * first, decimals) - round(100 * second, decimals)) / 100


def chance_text(p_value: float) -> str:
    """Return how often chance alone gives a difference as large, as 'in 12 % of cases'."""
    if p_value < 0.001:
        return 'in less than 1 of 1000 cases'
    percent = 100 * p_value
    return f'in {percent:.1g} % of cases' if percent < 1 else f'in {percent:.0f} % of cases'


def share_text(share: float) -> str:
    """Return a share in percent without the percent sign.

    It has one decimal, as '27.8', or below 1 % two significant digits, as '0.034'.
    """
    percent = 100 * share
    return f'{percent:.1f}' if percent >= 0.995 or not percent else f'{percent:.2g}'


def direction_text(direction: npt.NDArray[np.float64]) -> str:
    """Return a unit vector (3,) as text of constant length, as '+0.55 +0.83  0.00'."""
    return ' '.join(_signed(float(x)) for x in direction)


def millimetre_texts(lengths: npt.NDArray[np.float64]) -> list[str]:
    """Return lengths (n,), m, in mm, all with the decimals that give the longest four digits."""
    longest = float(lengths.max(initial=0.0)) * 1000
    whole_digits = math.floor(math.log10(longest)) + 1 if longest > 0 else 1
    return [f'{1000 * length:.{max(4 - whole_digits, 0)}f}' for length in lengths]


def size_text(part: Part) -> str:
    """Return the lengths along the axes of the mesh, as '40 x 30 x 12.5 mm'."""
    sides = 1000 * np.ptp(part.vertices, axis=0)
    # Numbers have no exponent, even if a wrong unit makes them huge.
    texts = (
        np.format_float_positional(side, precision=4, fractional=False, trim='-') for side in sides
    )
    return ' x '.join(texts) + ' mm'


def _percent(share: float, decimals: int) -> str:
    # An exact zero has no decimals: they would suggest that it was measured precisely.
    return f'{100 * share:.{decimals}f}' if share else '0'


def points(share: float, decimals: int) -> str:
    """Return a difference of shares in percentage points, as '+3.1'."""
    # Adding 0.0 turns -0.0 into 0.0.
    return f'{round(100 * share, decimals) + 0.0:+.{decimals}f}'


def _signed(value: float) -> str:
    text = f'{value:+.2f}'
    return ' 0.00' if text in ('+0.00', '-0.00') else text


def number_text(number: float) -> str:
    """Return a number with three significant digits, or as an integer from 100."""
    return f'{number:.0f}' if number >= 99.95 else f'{number:#.3g}'


def minutes_text(minutes: float) -> str:
    """Return a duration: '1 minute', '1.5 minutes'."""
    return f'{minutes:g} {"minute" if minutes == 1 else "minutes"}'
