"""The texts of a page that compare simulated drops with other counts of the same part."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.report.rounding import (
    chance_text,
    decimals_of,
    points,
    probability_text,
    shown_difference,
)
from resting_aspects_ros.report.rows import Row
from resting_aspects_ros.statistics.comparison import REST, Comparison, DropCounts
from resting_aspects_ros.statistics.intervals import Interval, intervals


@dataclass(frozen=True, eq=False)
class ReferenceCounts:
    """Simulated and reference counts of the symmetry classes, and their comparison.

    name : str
        Name of the file with the reference counts.
    own, tally : DropCounts
        The simulated counts, and the reference counts.
    comparison : Comparison
        The comparison of the two.
    """

    name: str
    own: DropCounts
    tally: DropCounts
    comparison: Comparison

    def sides(self) -> list[tuple[str, list[Interval]]]:
        """Return the label of each side, and the shares in its drops that are in an aspect."""
        confidence = self.comparison.confidence
        return [
            (
                f'{name}, {tally.counts.sum()} of {tally.drops} drops in an aspect',
                intervals(tally.counts, int(tally.counts.sum()), confidence=confidence),
            )
            for name, tally in (('simulated', self.own), (self.name, self.tally))
        ]


@dataclass(frozen=True)
class ComparisonText:
    """The texts of a comparison, in percent and percentage points.

    rows : tuple of (str, str, str, str)
        Name, simulated, measured, difference.
    """

    verdict: str
    rows: tuple[tuple[str, ...], ...]
    mean: str
    largest: str
    chance: str


def comparison_text(measured: ReferenceCounts, rows: Sequence[Row]) -> ComparisonText:
    """Return the texts of the comparison; ``rows`` are the rows of the symmetry classes."""
    comparison = measured.comparison
    differences = difference_texts(comparison)
    lines: list[tuple[str, ...]] = []
    for k, (row, difference) in enumerate(zip(rows, differences, strict=True)):
        decimals = _decimals(comparison, k)
        sides = (comparison.first[k], comparison.second[k])
        lines.append((row.name, *(f'{100 * p:.{decimals}f} %' for p in sides), difference))
    for name in REST:
        counts = getattr(measured.own, name), getattr(measured.tally, name)
        if any(counts):
            drops = measured.own.drops, measured.tally.drops
            shares = [intervals([c], n)[0] for c, n in zip(counts, drops, strict=True)]
            lines.append((f'{name}, of all drops', *map(probability_text, shares), ''))
    largest = comparison.largest_aspect - 1
    return ComparisonText(
        verdict(comparison, [row.name for row in rows]),
        tuple(lines),
        f'{100 * comparison.mean_deviation:.1f}',
        f'{differences[largest].split(" ")[0]} points in {rows[largest].name}',
        chance_text(comparison.p_value),
    )


def difference_texts(comparison: Comparison) -> list[str]:
    """Return the difference of each class in percentage points, as '+3.1 (-0.9 to +7.0)'."""
    found = []
    for k, (low, high) in enumerate(zip(comparison.lower, comparison.upper, strict=True)):
        decimals = _decimals(comparison, k)
        shares = float(comparison.first[k]), float(comparison.second[k])
        difference = points(shown_difference(*shares, decimals), decimals)
        ends = (points(float(end), decimals - 1) for end in (low, high))
        found.append(f'{difference} ({" to ".join(ends)})')
    return found


def _decimals(comparison: Comparison, k: int) -> int:
    """Return the decimals of the shares of a class and their difference: one more than bounds."""
    return 1 + decimals_of(Interval(0.0, float(comparison.lower[k]), float(comparison.upper[k])))


def verdict(comparison: Comparison, names: Sequence[str]) -> str:
    """State whether the sides differ by more than chance explains, and where they differ most.

    Parameters
    ----------
    comparison : Comparison
        Its confidence is the level of the test.
    names : sequence of str
        Names of the aspects or classes.
    """
    p_value = comparison.p_value
    if p_value >= 1 - comparison.confidence:
        return f'The distributions do not differ significantly ({p_text(p_value)}).'
    certain = np.flatnonzero((comparison.lower > 0) | (comparison.upper < 0))
    among = certain if len(certain) else np.arange(len(names))
    k = int(among[np.abs(comparison.deviation[among]).argmax()])
    deviation, bounds = float(comparison.deviation[k]), (comparison.lower[k], comparison.upper[k])
    ends = np.sort(np.sign(deviation) * np.array(bounds))
    decimals = min(decimals_of(Interval(0, *bounds)), 1)
    size, low, high = (f'{100 * x + 0.0:.{decimals}f}' for x in (abs(deviation), *ends))
    interval = f'{100 * comparison.confidence:.10g} % interval {low} to {high}'
    if len(certain):
        return f'They differ by {size} points in {names[k]} ({interval}; {p_text(p_value)}).'
    what = names[k].split()[0]
    return (
        f'They differ significantly ({p_text(p_value)}), but no single {what} does: the largest '
        f'difference is {size} points in {names[k]} ({interval}).'
    )


def p_text(p_value: float) -> str:
    """Return 'p = 0.031' or 'p < 0.0001'."""
    return f'p = {p_value:.2g}' if p_value >= 1e-4 else 'p < 0.0001'
