"""What a page says of drops beside other counts of the same part."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.comparison import REST, Comparison, Tally
from resting_aspects_ros.core.intervals import Interval, intervals
from resting_aspects_ros.report.rounding import chance_text, points_text, probability_text
from resting_aspects_ros.report.rows import Row

# A p value below this is said to be a difference.
TELLING = 0.05


@dataclass(frozen=True, eq=False)
class Measured:
    """What the drops are held against, counted by symmetry class.

    name : str
        Of the file.
    own, tally : Tally
        Of the drops, and of the others.
    comparison : Comparison
        Of the two.
    """

    name: str
    own: Tally
    tally: Tally
    comparison: Comparison

    def sides(self) -> list[tuple[str, list[Interval]]]:
        """Words for each of the two sides, and its shares of the drops that are in an aspect."""
        confidence = self.comparison.confidence
        return [
            (
                f'{name}, {tally.counts.sum()} of {tally.drops} drops are in an aspect',
                intervals(tally.counts, int(tally.counts.sum()), confidence=confidence),
            )
            for name, tally in (('simulated', self.own), (self.name, self.tally))
        ]


@dataclass(frozen=True)
class Line:
    """A row of a table."""

    name: str
    simulated: str
    measured: str
    difference: str


@dataclass(frozen=True)
class ComparisonWords:
    """A comparison as a reader sees it, in percent and percentage points."""

    verdict: str
    rows: tuple[Line, ...]
    mean: str
    largest: str
    chance: str


def comparison_words(measured: Measured, rows: Sequence[Row]) -> ComparisonWords:
    """The comparison in words; ``rows`` are those of the classes."""
    found = measured.comparison
    differences = difference_texts(found)
    (_, simulated), (_, counted) = measured.sides()
    lines = [
        Line(row.name, probability_text(a), probability_text(b), difference)
        for row, a, b, difference in zip(rows, simulated, counted, differences, strict=True)
    ]
    for name in REST:
        counts = getattr(measured.own, name), getattr(measured.tally, name)
        if any(counts):
            drops = measured.own.drops, measured.tally.drops
            shares = [intervals([c], n)[0] for c, n in zip(counts, drops, strict=True)]
            own, other = map(probability_text, shares)
            lines.append(Line(f'{name}, of all drops', own, other, ''))
    largest = found.largest_aspect - 1
    return ComparisonWords(
        _verdict(found),
        tuple(lines),
        f'{100 * found.mean_deviation:.1f}',
        f'{differences[largest].split(" ")[0]} points, {rows[largest].name}',
        chance_text(found.p_value),
    )


def difference_texts(found: Comparison) -> list[str]:
    """Of each class, as '+3.1 (-0.9 to +7.0)', in percentage points."""
    return [
        points_text(float(d), float(low), float(high))
        for d, low, high in zip(found.deviation, found.lower, found.upper, strict=True)
    ]


def _verdict(found: Comparison) -> str:
    if found.p_value < TELLING:
        return 'Simulation and count differ by more than chance explains.'
    unseen = 100 * float(np.max(found.upper - found.lower)) / 2
    return (
        'No difference that chance does not explain; '
        f'with so many drops one of less than about {unseen:.2g} points need not show.'
    )
