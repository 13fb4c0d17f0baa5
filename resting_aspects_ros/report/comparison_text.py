"""What a page says of drops beside other counts of the same part."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.statistics.comparison import REST, Comparison, DropCounts
from resting_aspects_ros.core.statistics.intervals import Interval, intervals
from resting_aspects_ros.report.rounding import (
    chance_text,
    decimals_of,
    points_text,
    probability_text,
)
from resting_aspects_ros.report.rows import Row


@dataclass(frozen=True, eq=False)
class ReferenceCounts:
    """What the drops are held against, counted by symmetry class.

    name : str
        Of the file.
    own, tally : Tally
        Of the drops, and of the others.
    comparison : Comparison
        Of the two.
    """

    name: str
    own: DropCounts
    tally: DropCounts
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
class ComparisonText:
    """A comparison as a reader sees it, in percent and percentage points.

    rows : tuple of (str, str, str, str)
        Name, simulated, measured, difference.
    """

    verdict: str
    rows: tuple[tuple[str, ...], ...]
    mean: str
    largest: str
    chance: str


def comparison_text(measured: ReferenceCounts, rows: Sequence[Row]) -> ComparisonText:
    """The comparison in words; ``rows`` are those of the classes."""
    found = measured.comparison
    differences = difference_texts(found)
    (_, simulated), (_, counted) = measured.sides()
    lines: list[tuple[str, ...]] = [
        (row.name, probability_text(a), probability_text(b), difference)
        for row, a, b, difference in zip(rows, simulated, counted, differences, strict=True)
    ]
    for name in REST:
        counts = getattr(measured.own, name), getattr(measured.tally, name)
        if any(counts):
            drops = measured.own.drops, measured.tally.drops
            shares = [intervals([c], n)[0] for c, n in zip(counts, drops, strict=True)]
            lines.append((f'{name}, of all drops', *map(probability_text, shares), ''))
    largest = found.largest_aspect - 1
    return ComparisonText(
        verdict(found, [row.name for row in rows]),
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


def verdict(found: Comparison, names: Sequence[str]) -> str:
    """Whether the two differ by more than chance explains, and where most, in a sentence.

    Parameters
    ----------
    found : Comparison
        At its confidence.
    names : sequence of str
        Of the aspects or classes.
    """
    if found.p_value >= 1 - found.confidence:
        return f'The two agree within chance ({p_text(found.p_value)}).'
    deviation = found.largest_deviation
    ends = np.sort(np.sign(deviation) * np.array(found.largest_bounds))
    decimals = min(decimals_of(Interval(0, *found.largest_bounds)), 1)
    size, low, high = (f'{100 * x + 0.0:.{decimals}f}' for x in (abs(deviation), *ends))
    return (
        f'They differ: {names[found.largest_aspect - 1]} by {size} points '
        f'({100 * found.confidence:.10g} % interval {low} to {high}; {p_text(found.p_value)}).'
    )


def p_text(p_value: float) -> str:
    """'p = 0.031' or 'p < 0.0001'."""
    return f'p = {p_value:.2g}' if p_value >= 1e-4 else 'p < 0.0001'
