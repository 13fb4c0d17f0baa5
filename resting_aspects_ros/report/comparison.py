"""Two distributions, or aspects and clusters of poses, compared in tables, texts and documents."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.aspects.clusters import Agreement, Clusters, Differences
from resting_aspects_ros.report.document import SCHEMA_VERSION, numbers, plain, share_fields
from resting_aspects_ros.report.drops import shares
from resting_aspects_ros.report.format import (
    bounds_text,
    decimals_of,
    direction_text,
    interval_of,
    outside_aspects,
    percent_text,
    points,
    shown_difference,
)
from resting_aspects_ros.report.table import DOWN, NOTHING, Table
from resting_aspects_ros.statistics.comparison import REST, TABLES, Comparison, DropCounts
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, INTERVAL, Interval, intervals
from resting_aspects_ros.statistics.model_range import ModelRange

MAX_DECIMALS = 2


@dataclass(frozen=True, eq=False)
class ComparedResults:
    """Two sets of drops, and their comparison.

    ids, names : tuple of int, tuple of str
        Ids of the aspects or symmetry classes (see ``what``), and the same as text, such as '3+4'
        for classes that were counted together.
    a, b : DropCounts
        Counts of the two sides.
    models : (ModelRange or None, ModelRange or None)
        The model ranges of both, of the share in all drops; None if not known.
    """

    ids: tuple[int, ...]
    names: tuple[str, ...]
    a: DropCounts
    b: DropCounts
    comparison: Comparison
    what: Literal['aspect', 'class'] = 'aspect'
    labels: tuple[str, str] = ('A', 'B')
    models: tuple[ModelRange | None, ModelRange | None] = (None, None)

    @property
    def tallies(self) -> tuple[DropCounts, DropCounts]:
        """The counts of both sides."""
        return self.a, self.b

    def tally_texts(self, after_label: str = ' ') -> list[str]:
        """Return label and counts of each side, as 'A 93 of 100'."""
        return [
            f'{label}{after_label}{tally.counts.sum()} of {tally.drops}'
            for label, tally in zip(self.labels, self.tallies, strict=True)
        ]

    def row_text(self, k: int) -> str:
        """Return the name of a row in a sentence, such as 'class 3+4' or 'aspects 1 and 2'."""
        several = self.what == 'aspect' and not self.names[k].isdigit()
        return f'{self.what}{"s" if several else ""} {self.names[k]}'

    @property
    def shares(self) -> list[list[Interval]]:
        """For each side, the share of each aspect in the drops that are in an aspect."""
        confidence = self.comparison.confidence
        return [
            intervals(tally.counts, int(tally.counts.sum()), confidence=confidence)
            for tally in self.tallies
        ]

    @property
    def ranges(self) -> list[list[Interval | None]]:
        """For each side, the model range of each aspect; None if it is not known."""
        return [
            [None] * len(self.ids)
            if model is None
            else [
                Interval(int(count) / tally.drops, *bounds)
                for count, bounds in zip(tally.counts, model.by_aspect.tolist(), strict=True)
            ]
            for tally, model in zip(self.tallies, self.models, strict=True)
        ]


def comparison_table(sides: ComparedResults, title: str) -> Table:
    """Return a table with a row for each aspect, and for each outcome in no aspect.

    Shares of aspects refer to the drops in an aspect, other shares to all drops. Model ranges are
    below the interval of the first side, and below the share of the second.
    """
    confidence = sides.comparison.confidence
    percent = f'{100 * confidence:.10g} %'
    first, second = sides.labels
    headings = (
        sides.what,
        f'{first}\n(%)',
        f'{percent}\ninterval of {first}' + (',\nmodel range' if sides.models[0] else ''),
        f'{second} (%),\nmodel\nrange' if sides.models[1] else f'{second}\n(%)',
        f'{first} - {second}\n(%)',
        f'{percent}\nsimultaneous',
    )
    table = Table(title, headings)
    rows = zip(*sides.shares, *sides.ranges, strict=True)
    for k, ((a, b, *ranges), (difference, bounds, decimals)) in enumerate(
        zip(rows, _difference_texts(sides), strict=True)
    ):
        below, below_other = (f'\n{bounds_text(model)}' if model else '' for model in ranges)
        table.add_row(
            sides.names[k],
            percent_text(a.probability, decimals),
            f'{bounds_text(a)}{below}',
            f'{percent_text(b.probability, decimals)}{below_other}',
            difference,
            bounds,
        )
    table.add_section()
    for name in REST:
        counts = [getattr(tally, name) for tally in sides.tallies]
        if any(counts):
            a, b = (
                intervals([count], tally.drops, confidence=confidence)[0]
                for count, tally in zip(counts, sides.tallies, strict=True)
            )
            share, other = (percent_text(each.probability, decimals_of(each)) for each in (a, b))
            table.add_row(name, share, bounds_text(a), other)
    return table


def _difference_texts(sides: ComparedResults) -> Iterator[tuple[str, str, int]]:
    """Yield the difference of each row, its bounds, and the decimals of both shares.

    The difference is that of the shares that are shown. It has one digit more than its bounds,
    because it is computed from exact counts.
    """
    rows = zip(*sides.shares, sides.comparison.lower, sides.comparison.upper, strict=True)
    for a, b, lower, upper in rows:
        own = decimals_of(Interval(0.0, lower, upper))
        decimals = min(own + 1, MAX_DECIMALS)
        difference = shown_difference(a.probability, b.probability, decimals)
        ends = (points(x, min(own, decimals)) for x in (lower, upper))
        yield points(difference, decimals), ' to '.join(ends), decimals


def difference_texts(sides: ComparedResults) -> list[str]:
    """Return the difference of each row in percentage points, as '+3.1 (-0.9 to +7.0)'."""
    return [f'{difference} ({bounds})' for difference, bounds, _ in _difference_texts(sides)]


def measures(sides: ComparedResults) -> dict[str, str]:
    """Return how much the sides differ, and whether chance explains it, as texts by name."""
    comparison = sides.comparison
    k = comparison.largest_aspect - 1
    largest = difference_texts(sides)[k]
    many = 'aspects' if sides.what == 'aspect' else 'classes'
    by = 'chi-square' if comparison.p_by == 'chi-square' else f'Monte Carlo, {TABLES} tables'
    rows = {
        'total variation': f'{100 * comparison.total_variation:.3g} %',
        'largest deviation': f'{largest} points in {sides.row_text(k)}',
        'mean absolute deviation': f'{100 * comparison.mean_deviation:.3g} % over {many}',
        'p value': f'{p_text(comparison.p_value).removeprefix("p = ")} by {by}',
        'drops in aspects': ', '.join(sides.tally_texts()),
    }
    if any(getattr(tally, name) for tally in sides.tallies for name in REST):
        ranged = ' and model ranges' if any(sides.models) else ''
        rows['shares'] = f'aspects: of drops in aspects; others{ranged}: of all drops'
    return rows


def comparison_document(
    sides: ComparedResults, inputs: Mapping[str, Mapping[str, object]]
) -> dict[str, object]:
    """Return the comparison as a JSON document; shares are from 0 to 1, and not rounded.

    inputs : the fields that describe each side, under ``a`` and ``b``: file, part, drops, ...
    """
    comparison, shares, ranges = sides.comparison, sides.shares, sides.ranges
    lower, upper = comparison.largest_bounds
    return {
        'schema_version': SCHEMA_VERSION,
        **{
            name: {
                **inputs[name],
                **{outcome: getattr(tally, outcome) for outcome in REST},
                'model_uncertain': model and list(model.uncertain),
            }
            for name, tally, model in zip('ab', sides.tallies, sides.models, strict=True)
        },
        'confidence': comparison.confidence,
        'interval': INTERVAL,
        'by': sides.what,
        'aspects': [
            {
                'id': sides.ids[k],
                'name': sides.names[k],
                **{
                    name: {
                        'count': int(tally.counts[k]),
                        'share': side[k].probability,
                        'lower': side[k].lower,
                        'upper': side[k].upper,
                        'model_lower': (model := ranged[k]) and model.lower,
                        'model_upper': model and model.upper,
                    }
                    for name, tally, side, ranged in zip(
                        'ab', sides.tallies, shares, ranges, strict=True
                    )
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


def verdict(sides: ComparedResults) -> str:
    """State whether the sides differ by more than chance explains, and where they differ most.

    The confidence of the comparison is the level of the test.
    """
    comparison = sides.comparison
    p_value = p_text(comparison.p_value)
    if comparison.p_value >= 1 - comparison.confidence:
        return f'The distributions do not differ significantly ({p_value}).'
    certain = np.flatnonzero((comparison.lower > 0) | (comparison.upper < 0))
    among = certain if len(certain) else np.arange(len(sides.ids))
    k = int(among[np.abs(comparison.deviation[among]).argmax()])
    difference = f'{difference_texts(sides)[k]} points in {sides.row_text(k)}'
    if len(certain):
        return f'They differ by {difference} ({p_value}).'
    return (
        f'They differ significantly ({p_value}), but no single {sides.what} does: the largest '
        f'difference is {difference}.'
    )


def p_text(p_value: float) -> str:
    """Return 'p = 0.031' or 'p < 0.0001'."""
    return f'p = {p_value:.2g}' if p_value >= 1e-4 else 'p < 0.0001'


# Within this angle of an aspect of a part with flat sides, no other aspect is possible.
NEAR = np.radians(1.0)

# Maximum number of rows for single clusters; the other clusters share one row.
MAX_ROWS = 20
# The cell for the direction of a cluster without a mean direction.
RING = 'all round'

Ids = npt.NDArray[np.int64]


def cluster_table(distribution: Distribution, clusters: Clusters, title: str) -> Table:
    """Return a table of the largest clusters, the other clusters, and the unsettled poses.

    ``distribution`` has the counts of the clusters in place of aspects.
    """
    percent = f'{100 * CONFIDENCE:g} % interval'
    headings = ('cluster', DOWN, 'spread\n(degrees)', 'share', percent, 'count')
    table = Table(title, headings, texts={DOWN})
    drops = distribution.drops
    shown = clusters.counts[:MAX_ROWS]
    for k, interval in enumerate(distribution.intervals()[:MAX_ROWS]):
        table.add_row(
            str(k + 1),
            RING if np.isnan(clusters.mean[k]).any() else direction_text(clusters.mean[k]),
            NOTHING if np.isnan(clusters.spread[k]) else f'{np.degrees(clusters.spread[k]):.2f}',
            *shares(interval, int(shown[k]), drops),
        )
    table.add_section()
    more = len(clusters) - len(shown)
    rest = [(f'{more} more', int(clusters.counts[MAX_ROWS:].sum()))] if more else []
    for name, count in [*rest, *outside_aspects(distribution)]:
        table.add_row('', name, '', *shares(interval_of(distribution, count), count, drops))
    table.add_row('', 'poses in total', '', '', '', str(drops), bold=True)
    return table


def agreement_table(
    distribution: Distribution, agreement: Agreement, clusters: Clusters, title: str
) -> Table:
    """Return a table of the aspects, each beside the cluster with most of its poses."""
    percent = f'{100 * CONFIDENCE:g} % interval'
    headings = ('aspect', DOWN, 'share', percent, 'count', 'cluster:\nits count')
    table = Table(title, headings, texts={DOWN})
    drops = distribution.drops
    rows = zip(
        distribution.aspects,
        distribution.counts,
        distribution.intervals(),
        agreement.cluster_of,
        strict=True,
    )
    for aspect, count, interval, cluster in rows:
        table.add_row(
            str(aspect.id),
            direction_text(aspect.down_in_part),
            *shares(interval, int(count), drops),
            f'{cluster}: {clusters.counts[cluster - 1]}' if cluster else NOTHING,
        )
    table.add_section()
    for name, count in outside_aspects(distribution):
        table.add_row('', name, *shares(interval_of(distribution, count), count, drops), '')
    table.add_row('', 'poses in total', '', '', str(drops), '', bold=True)
    return table


def agreement_line(agreement: Agreement, differences: Differences) -> str:
    """State on how many poses aspects and clusters agree, and whether on all near an aspect."""
    settled = len(agreement.agree)
    near = int(np.count_nonzero(differences.angle <= NEAR))
    where = f'within {np.degrees(NEAR):g} degree of an aspect'
    return (
        f'Aspects and clusters agree on {settled - len(differences)} of {settled} settled poses, '
        + (f'but differ on {near} {where}.' if near else f'including all poses {where}.')
        + (' --json lists the others.' if len(differences) else '')
    )


def cluster_document(
    distribution: Distribution, clusters: Clusters, tolerance: float
) -> dict[str, object]:
    """Return the document of the clusters, for which the part is not needed.

    ``distribution`` has the counts of the clusters; ``down_in_part`` is the mean direction, null
    if there is none; ``tolerance`` is in rad.
    """
    return {
        'schema_version': SCHEMA_VERSION,
        'tolerance': tolerance,
        'drops': distribution.drops,
        'unsettled': distribution.unsettled,
        'failed': distribution.failed,
        'confidence': distribution.confidence,
        'interval': distribution.interval,
        'clusters': [
            {
                'id': k + 1,
                'down_in_part': None if np.isnan(mean).any() else numbers(mean),
                'spread': plain(float(clusters.spread[k])),
                **share_fields(int(clusters.counts[k]), interval),
            }
            for k, (mean, interval) in enumerate(
                zip(clusters.mean, distribution.intervals(), strict=True)
            )
        ],
    }


def agreement_fields(
    distribution: Distribution,
    agreement: Agreement,
    differences: Differences,
    places: Sequence[Ids],
) -> dict[str, object]:
    """Return the fields that need the part: aspects with their clusters, and differences.

    places : two of (n,) int, indices of all compared poses, and their lines in the file.
    """
    index, line = places
    rows = zip(distribution.aspects, distribution.counts, distribution.intervals(), strict=True)
    return {
        'unclassified': distribution.unclassified,
        'agreed': int(agreement.agree.sum()),
        'aspects': [
            {
                'id': aspect.id,
                'down_in_part': numbers(aspect.down_in_part),
                'com_height': float(aspect.com_height),
                **share_fields(int(count), interval),
                'cluster': int(agreement.cluster_of[k]),
                'count_in_cluster': int(agreement.shared[k]),
            }
            for k, (aspect, count, interval) in enumerate(rows)
        ],
        'differing': [
            {
                'pose': int(index[pose]),
                'line': int(line[pose]),
                'nearest_aspect': int(differences.nearest[k]),
                'angle': plain(float(differences.angle[k])),
                'aspect': int(differences.aspect[k]),
                'cluster': int(differences.cluster[k]),
            }
            for k, pose in enumerate(differences.pose)
        ],
    }
