"""Numbers, intervals, rows, names and colours as people read them."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.table import Number
from resting_aspects_ros.statistics.distribution import OUTSIDE, Distribution
from resting_aspects_ros.statistics.intervals import Interval


def interval_of(distribution: Distribution, count: int) -> Interval:
    """Return the probability of an outcome that ``count`` drops had, such as several aspects."""
    rest = distribution.drops - count
    return with_counts(distribution, np.array([count, rest])).intervals()[0]


def with_counts(distribution: Distribution, counts: Counts, unclassified: int = 0) -> Distribution:
    """Return a distribution with other counts, and with no drop in another outcome."""
    others: dict[str, Any] = {**dict.fromkeys(OUTSIDE, 0), 'unclassified': unclassified}
    return dataclasses.replace(distribution, counts=counts, **others)


def outside_aspects(distribution: Distribution) -> list[tuple[str, int]]:
    """Return the name and the count of each outcome in no aspect that occurred."""
    return [(name, int(count)) for name in OUTSIDE if (count := getattr(distribution, name))]


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
    text = percent_text(interval.probability, decimals_of(interval))
    return Number(f'{text} %', 100 * interval.probability)


def interval_text(interval: Interval) -> str:
    """Return both bounds in percent, as '25.1 to 30.7 %' or '0 to 0.38 %'."""
    return Number(f'{bounds_text(interval)} %', 100 * interval.lower, 100 * interval.upper)


def bounds_text(interval: Interval, to: str = ' to ') -> str:
    """Return both bounds in percent without the percent sign, as '25.1 to 30.7'."""
    decimals = decimals_of(interval)
    lower, upper = (percent_text(each, decimals) for each in (interval.lower, interval.upper))
    return Number(f'{lower}{to}{upper}', 100 * interval.lower, 100 * interval.upper)


def model_range(model: Interval) -> str:
    """Return a model range where no heading says so, as 'model range 15 to 40 %'."""
    return f'model range {interval_text(model)}'


def points_text(deviation: float, lower: float, upper: float) -> str:
    """Return a difference of shares in percentage points, as '+3.1 (-0.9 to +7.0)'."""
    decimals = decimals_of(Interval(deviation, lower, upper))
    difference, low, high = (points(x, decimals) for x in (deviation, lower, upper))
    return Number(f'{difference} ({low} to {high})', 100 * deviation, 100 * lower, 100 * upper)


def shown_difference(first: float, second: float, decimals: int) -> float:
    """Return first - second of two shares as they are shown, in percent with these decimals."""
    return (round(100 * first, decimals) - round(100 * second, decimals)) / 100


def share_text(share: float) -> str:
    """Return a share in percent, as '27.8', or below 1 % with two digits, as '0.034'."""
    percent = 100 * share
    text = f'{percent:.1f}' if percent >= 0.995 or not percent else f'{percent:.2g}'
    return Number(text, percent)


def share_percent_text(share: float) -> str:
    """Return a share in percent, as '27.8 %'."""
    return Number(f'{share_text(share)} %', 100 * share)


def direction_text(direction: npt.NDArray[np.float64]) -> str:
    """Return a unit vector (3,) as text of constant length, as '+0.55 +0.83  0.00'."""
    return ' '.join(_signed(float(x)) for x in direction)


def millimetre_texts(lengths: npt.NDArray[np.float64]) -> list[str]:
    """Return lengths (n,), m, in mm, all with the decimals that give the longest four digits."""
    longest = float(lengths.max(initial=0.0)) * 1000
    whole_digits = math.floor(math.log10(longest)) + 1 if longest > 0 else 1
    decimals = max(4 - whole_digits, 0)
    return [Number(f'{1000 * x:.{decimals}f}', 1000 * x) for x in lengths.tolist()]


def millimetres_text(length: float) -> str:
    """Return a length, m, in mm with three significant digits."""
    return number_text(1000 * length) if length else '0'


def size_text(part: Part) -> str:
    """Return the lengths along the axes of the mesh, as '40 x 30 x 12.5 mm'."""
    sides = 1000 * np.ptp(part.vertices, axis=0)
    # Numbers have no exponent, even if a wrong unit makes them huge.
    texts = (
        np.format_float_positional(side, precision=4, fractional=False, trim='-') for side in sides
    )
    return ' x '.join(texts) + ' mm'


def percent_text(share: float, decimals: int) -> str:
    """Return a share in percent without the percent sign; '0' if it is exactly zero."""
    # An exact zero has no decimals: they would suggest that it was measured precisely.
    return Number(f'{100 * share:.{decimals}f}' if share else '0', 100 * share)


def points(share: float, decimals: int) -> str:
    """Return a difference of shares in percentage points, as '+3.1'."""
    # Adding 0.0 turns -0.0 into 0.0.
    return f'{round(100 * share, decimals) + 0.0:+.{decimals}f}'


def _signed(value: float) -> str:
    text = f'{value:+.2f}'
    return ' 0.00' if text in ('+0.00', '-0.00') else text


def number_text(number: float) -> str:
    """Return a number with three significant digits, or as an integer from 100."""
    return Number(f'{number:.0f}' if number >= 99.95 else f'{number:#.3g}', number)


def minutes_text(minutes: float) -> str:
    """Return a duration: '1 minute', '1.5 minutes'."""
    return f'{minutes:g} {"minute" if minutes == 1 else "minutes"}'


# The first seven are from Okabe and Ito (2008). Any two of these colours, and the grey, differ by
# more than 10 in CIELAB, also for viewers with red or green colour blindness.
COLOURS = (
    '#0072B2',
    '#E69F00',
    '#009E73',
    '#D55E00',
    '#56B4E9',
    '#CC79A7',
    '#F0E442',
    '#882255',
    '#B9D98B',
    '#4A3FD0',
)
GREY = '#B8B8B8'  # for drops in no aspect


# After the ten colours follow ten lighter and ten darker ones: white or black, and its share.
_SHADES = ((0.0, 0.0), (1.0, 0.5), (0.0, 0.4))


def aspect_colour(aspect: Aspect) -> str:
    """Return the colour of the aspect's symmetry class as '#RRGGBB'; 30 colours repeat."""
    shade, k = divmod(aspect.symmetry_class - 1, len(COLOURS))
    target, share = _SHADES[shade % len(_SHADES)]
    mixed = [round(255 * (c + (target - c) * share)) for c in rgb(COLOURS[k])]
    return '#{:02X}{:02X}{:02X}'.format(*mixed)


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of '#RRGGBB', each from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


# A row with more aspects than this, not consecutive, has an abbreviated list of their numbers.
_MAX_LISTED = 4


@dataclass(frozen=True, eq=False)
class Row:
    """One row of a report: the drops of one symmetry class, or of one outcome in no aspect.

    The name is such as 'aspects 1 and 2' or 'unclassified'. The aspects are those of the class,
    which look the same; none if the drops are in no aspect. ``model`` is the model range.
    """

    name: str
    count: int
    interval: Interval
    colour: str
    aspects: tuple[Aspect, ...] = ()
    model: Interval | None = None

    @property
    def upper(self) -> float:
        """Where the interval and the model range end."""
        return max(each.upper for each in (self.interval, self.model) if each is not None)


def class_rows(distribution: Distribution) -> list[Row]:
    """Return a row for each symmetry class, in the order of the class numbers."""
    return _rows(distribution.aspects.classes(), distribution.by_class())


def _rows(groups: Sequence[tuple[Aspect, ...]], distribution: Distribution) -> list[Row]:
    """Return a row for each group of aspects, whose counts the distribution has."""
    zipped = zip(
        groups,
        distribution.counts.tolist(),
        distribution.intervals(),
        distribution.model_intervals(),
        strict=True,
    )
    return [
        Row(aspects_text(group), count, interval, aspect_colour(group[0]), group, model)
        for group, count, interval, model in zipped
    ]


def aspect_rows(distribution: Distribution) -> list[Row]:
    """Return a row for each aspect, even if several aspects look the same."""
    return _rows([(aspect,) for aspect in distribution.aspects], distribution)


def outside_rows(distribution: Distribution) -> list[Row]:
    """Return a grey row for each outcome in no aspect, such as 'unsettled', that occurred."""
    return [
        Row(name, count, interval_of(distribution, count), GREY)
        for name, count in outside_aspects(distribution)
    ]


def largest_counts(counts: Sequence[int], number: int) -> list[int]:
    """Return the indices of the ``number`` largest counts, ascending."""
    return sorted(sorted(range(len(counts)), key=lambda k: -counts[k])[:number])


def ids_text(aspects: tuple[Aspect, ...]) -> str:
    """Return the ids as '3', '1 and 2', '1, 2 and 4', '1 to 6' or '1, 3, ... 30'."""
    ids = [aspect.id for aspect in aspects]
    text = numbers_text(ids)
    return (
        text if ' to ' in text or len(ids) <= _MAX_LISTED else f'{ids[0]}, {ids[1]}, ... {ids[-1]}'
    )


def aspects_text(aspects: tuple[Aspect, ...]) -> str:
    """Return the ids with the word 'aspect', as 'aspect 3' or 'aspects 1 and 2'."""
    return f'aspect{"s" * (len(aspects) > 1)} {ids_text(aspects)}'


def aspects_heading(rows: Sequence[tuple[Aspect, ...]]) -> str:
    """Return the heading of the column with the ids of the aspects of each row."""
    return 'aspects' if any(len(row) > 1 for row in rows) else 'aspect'


def numbers_text(numbers: Sequence[int]) -> str:
    """Return ascending numbers as '3', '1 and 2', '1, 2 and 4' or '1 to 6'."""
    if len(numbers) > 2 and all(b == a + 1 for a, b in pairwise(numbers)):
        return f'{numbers[0]} to {numbers[-1]}'
    return list_text([str(number) for number in numbers])


def list_text(words: Sequence[str]) -> str:
    """Return words as 'a', 'a and b' or 'a, b and c'."""
    *first, last = words
    return f'{", ".join(first)} and {last}' if first else last


def class_of(aspect_id: int, classes: Sequence[tuple[Aspect, ...]]) -> tuple[Aspect, ...]:
    """Return the symmetry class that contains the aspect."""
    return next(each for each in classes if aspect_id in {aspect.id for aspect in each})


def short_name(row: Row) -> str:
    """Return the name without 'aspect': '3', '1 and 2', 'unclassified'."""
    return ids_text(row.aspects) if row.aspects else row.name
