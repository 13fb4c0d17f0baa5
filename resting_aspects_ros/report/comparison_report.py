"""A terminal table and a JSON document that compare two distributions, A and B."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from rich.table import Table

from resting_aspects_ros.report.document import SCHEMA_VERSION, numbers
from resting_aspects_ros.report.rounding import (
    decimals_of,
    direction_text,
    points,
    shown_difference,
)
from resting_aspects_ros.report.table import DOWN, NOTHING, plain_table
from resting_aspects_ros.statistics.comparison import REST, Comparison, DropCounts
from resting_aspects_ros.statistics.intervals import INTERVAL, Interval, intervals
from resting_aspects_ros.statistics.pearson import TABLES

# A million drops justify more decimals, but the table would not fit 80 columns.
MAX_DECIMALS = 2


@dataclass(frozen=True, eq=False)
class ComparedResults:
    """The two sides of a comparison.

    ids : tuple of int
        Ids of the aspects or symmetry classes.
    what : str
        Whether the ids are of aspects or of symmetry classes.
    down : (k, 3) float
        Unit vectors of gravity, part frame; NaN if the part rolls. None if not known.
    a, b : DropCounts
        Counts of the two sides.
    names : tuple of str
        The ids as text, such as '3+4' for classes that were counted together; by default the ids.
    """

    ids: tuple[int, ...]
    down: npt.NDArray[np.float64] | None
    a: DropCounts
    b: DropCounts
    what: Literal['aspect', 'class'] = 'aspect'
    names: tuple[str, ...] = ()

    def name(self, k: int) -> str:
        """Return the name of row ``k``."""
        return self.names[k] if self.names else str(self.ids[k])

    @property
    def tallies(self) -> tuple[DropCounts, DropCounts]:
        """The counts of both sides."""
        return self.a, self.b

    def down_of(self, k: int) -> list[float] | None:
        """Return the down direction of row ``k``; None if it is not known, or the part rolls."""
        if self.down is None or np.isnan(self.down[k]).any():
            return None
        return numbers(self.down[k])

    def shares(self, confidence: float) -> list[list[Interval]]:
        """Return, for each side, the share of each aspect in the drops that are in an aspect."""
        return [
            intervals(tally.counts, int(tally.counts.sum()), confidence=confidence)
            for tally in self.tallies
        ]


def comparison_table(comparison: Comparison, sides: ComparedResults, title: str) -> Table:
    """Return a table with a row for each aspect, and for each outcome in no aspect.

    It fits 80 columns, and its cells are ASCII. Shares of aspects refer to the drops in an
    aspect, other shares to all drops.

    Parameters
    ----------
    comparison : Comparison
        The comparison of the two sides.
    sides : ComparedResults
    title : str
        Plain text, shown above the table.
    """
    percent = f'{100 * comparison.confidence:.10g} %'
    table = plain_table(
        title,
        sides.what,
        DOWN,
        'A\n(%)',
        f'{percent}\ninterval of A',
        'B\n(%)',
        'A - B\n(%)',
        f'{percent}\nsimultaneous',
    )
    rows = zip(*sides.shares(comparison.confidence), strict=True)
    for k, (a, b) in enumerate(rows):
        bounds = Interval(0.0, float(comparison.lower[k]), float(comparison.upper[k]))
        decimals = max(*map(_share_decimals, (a, b)), _deviation_decimals(bounds))
        difference = shown_difference(a.probability, b.probability, decimals)
        first, second = (
            f'{100 * each.probability:.{decimals}f}' if each.probability else '0'
            for each in (a, b)
        )
        table.add_row(
            sides.name(k),
            _down_text(sides, k),
            first,
            _share_texts(a)[1],
            second,
            points(difference, decimals),
            _deviation_texts(bounds)[1],
        )
    table.add_section()
    for name in REST:
        counts = [getattr(tally, name) for tally in sides.tallies]
        if any(counts):
            (share, interval), (other, _) = (
                _share_texts(intervals([count], tally.drops, confidence=comparison.confidence)[0])
                for count, tally in zip(counts, sides.tallies, strict=True)
            )
            table.add_row('', name, share, interval, other)
    return table


def measures_text(comparison: Comparison, sides: ComparedResults) -> str:
    """Return lines that state how much the sides differ, and whether chance explains it."""
    aspect = sides.name(comparison.largest_aspect - 1)
    deviation = f'{100 * comparison.largest_deviation + 0.0:+.3g}'
    _, bounds = _deviation_texts(
        Interval(comparison.largest_deviation, *comparison.largest_bounds)
    )
    many = 'aspects' if sides.what == 'aspect' else 'classes'
    p_value = f'{comparison.p_value:.2g}' if comparison.p_value >= 1e-4 else 'less than 0.0001'
    by = 'chi-square' if comparison.p_by == 'chi-square' else f'Monte Carlo, {TABLES} tables'
    rows = {
        'total variation': f'{100 * comparison.total_variation:.3g} %',
        'largest deviation': f'{deviation} % in {sides.what} {aspect} ({bounds} %)',
        'mean absolute deviation': f'{100 * comparison.mean_deviation:.3g} % over {many}',
        'p value': f'{p_value} by {by}',
        '': 'how often chance alone gives a difference this large',
    }
    counted = (f'{tally.counts.sum()} of {tally.drops}' for tally in sides.tallies)
    rows['drops in aspects'] = 'A {}, B {}'.format(*counted)
    if any(getattr(tally, name) for tally in sides.tallies for name in REST):
        rows['shares'] = 'aspects: of drops in aspects; others: of all drops'
    return '\n'.join(f'{name:<25}{text}' for name, text in rows.items())


def _down_text(sides: ComparedResults, k: int) -> str:
    if sides.down is None:
        return NOTHING
    return 'rolls' if np.isnan(sides.down[k]).any() else direction_text(sides.down[k])


def _share_decimals(interval: Interval) -> int:
    return min(decimals_of(interval), MAX_DECIMALS - (interval.upper > 0.99995))


def _share_texts(interval: Interval) -> tuple[str, str]:
    """Return share and interval in percent."""
    decimals = _share_decimals(interval)
    share, low, high = (
        f'{100 * x:.{decimals}f}' if x else '0'
        for x in (interval.probability, interval.lower, interval.upper)
    )
    return share, f'{low} to {high}'


def _deviation_texts(interval: Interval) -> tuple[str, str]:
    """Return deviation and bounds in percent, with signs.

    The deviation has one digit more than its bounds, because it is computed from exact counts.
    """
    decimals = _deviation_decimals(interval)
    shown = min(decimals_of(interval), decimals)
    low, high = (points(x, shown) for x in (interval.lower, interval.upper))
    return points(interval.probability, decimals), f'{low} to {high}'


def _deviation_decimals(interval: Interval) -> int:
    limit = MAX_DECIMALS if max(-interval.lower, interval.upper) < 0.1 else MAX_DECIMALS - 1
    return min(decimals_of(interval) + 1, limit)


def comparison_document(
    comparison: Comparison, sides: ComparedResults, inputs: Mapping[str, Mapping[str, object]]
) -> dict[str, object]:
    """Return the comparison as a JSON document; shares are from 0 to 1, and not rounded.

    inputs : the fields that describe each side, under ``a`` and ``b``: file, part, drops, ...
    """
    shares = sides.shares(comparison.confidence)
    lower, upper = comparison.largest_bounds
    return {
        'schema_version': SCHEMA_VERSION,
        **{
            name: {**inputs[name], **{outcome: getattr(tally, outcome) for outcome in REST}}
            for name, tally in zip('ab', sides.tallies, strict=True)
        },
        'confidence': comparison.confidence,
        'interval': INTERVAL,
        'by': sides.what,
        'aspects': [
            {
                'id': sides.ids[k],
                'name': sides.name(k),
                'down_in_part': sides.down_of(k),
                **{
                    name: {
                        'count': int(tally.counts[k]),
                        'share': side[k].probability,
                        'lower': side[k].lower,
                        'upper': side[k].upper,
                    }
                    for name, tally, side in zip('ab', sides.tallies, shares, strict=True)
                },
                'deviation': float(comparison.deviation[k]),
                'deviation_lower': float(comparison.lower[k]),
                'deviation_upper': float(comparison.upper[k]),
            }
            for k in range(len(sides.ids))
        ],
        'total_variation': comparison.total_variation,
        'largest_deviation': {
            'aspect': sides.ids[comparison.largest_aspect - 1],
            'deviation': comparison.largest_deviation,
            'lower': lower,
            'upper': upper,
        },
        'mean_deviation': comparison.mean_deviation,
        'p_value': comparison.p_value,
        'p_by': comparison.p_by,
    }
