"""The texts in the rows of a report page."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drop_figures import MAX_SHOWN
from resting_aspects_ros.report.drops import down_text
from resting_aspects_ros.report.format import (
    Row,
    class_of,
    ids_text,
    interval_text,
    millimetre_texts,
    probability_text,
    share_text,
    short_name,
)
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

OUTSIDE = {
    'unclassified': 'came to rest, but in none of the stable aspects of the shape',
    'unsettled': 'still moving at the end of the simulated time',
    'failed': 'the simulation failed numerically',
    'lost': 'left the surroundings',
    'sliding': 'still slid or rolled at the end of the simulated time',
}


@dataclass(frozen=True)
class RowText:
    """The texts of one row. A text that does not apply is empty.

    oblique, above, small : str
        Pictures as data URIs.
    bar : (float, float, float)
        Length of the bar, and start and length of its whisker, as percentages of the width.
    facts : tuple of (str, str, str)
        Properties of the aspect that follow from the shape: label, value, explanation.
    members : tuple of (id, down in part, count, probability, interval)
        The individual aspects of the row.
    """

    name: str
    short: str
    note: str
    colour: str
    count: int
    seen: bool
    probability: str
    interval: str
    bar: tuple[float, float, float]
    facts: tuple[tuple[str, str, str], ...] = ()
    members: tuple[tuple[int, str, int, str, str], ...] = ()
    oblique: str = ''
    above: str = ''
    small: str = ''


def row_texts(
    distribution: Distribution,
    rows: Sequence[Row],
    pictures: Sequence[Sequence[str]],
    part: Part | None,
    *,
    level: bool = True,
) -> list[RowText]:
    """Return the texts of each row.

    Parameters
    ----------
    rows : sequence of Row
        The rows of the distribution.
    pictures : sequence of three str
        The oblique, top and small picture of each row as data URIs; empty without a picture.
    part : Part or None
    level : bool
        Whether the parts lie on a level plane. If not, the facts that are true there say so.
    """
    longest = max((row.interval.upper for row in rows), default=1.0)
    heights = millimetre_texts(
        np.array([row.aspects[0].com_height if row.aspects else 0.0 for row in rows])
    )
    classes = distribution.aspects.classes()
    intervals = distribution.intervals()
    return [
        RowText(
            name=row.name,
            short=short_name(row),
            note=_note(row),
            colour=row.colour,
            count=row.count,
            seen=row.count > 0,
            probability=_probability(row, distribution.drops),
            interval=interval_text(row.interval),
            bar=_bar(row.interval, longest),
            facts=_facts(row, height, part, classes, level=level) if row.aspects else (),
            members=tuple(
                (
                    aspect.id,
                    down_text(aspect),
                    int(distribution.counts[aspect.id - 1]),
                    probability_text(intervals[aspect.id - 1]),
                    interval_text(intervals[aspect.id - 1]),
                )
                for aspect in row.aspects
            ),
            oblique=oblique,
            above=above,
            small=small,
        )
        for row, height, (oblique, above, small) in zip(rows, heights, pictures, strict=True)
    ]


def largest_rows(rows: Sequence[RowText]) -> list[RowText]:
    """Return the ``MAX_SHOWN`` rows with the most drops, in their original order."""
    order = sorted(range(len(rows)), key=lambda k: -rows[k].count)
    return [rows[k] for k in sorted(order[:MAX_SHOWN])]


def unseen_text(rows: Sequence[Row]) -> str:
    """List the rows in which no drop ended, with the upper bound of their probability."""
    return ', '.join(
        f'{row.name} (at most {interval_text(row.interval).removeprefix("0 to ")})'
        for row in rows
        if not row.count
    )


def _note(row: Row) -> str:
    if not row.aspects:
        return OUTSIDE[row.name]
    return f'{len(row.aspects)} aspects that look the same' if len(row.aspects) > 1 else ''


def _probability(row: Row, drops: int) -> str:
    if not drops:
        return 'no drops'
    return probability_text(row.interval) if row.count else 'never seen'


def _bar(interval: Interval, longest: float) -> tuple[float, float, float]:
    whisker = interval.upper - interval.lower
    fill, left, width = (
        round(x * 100 / longest, 2) for x in (interval.probability, interval.lower, whisker)
    )
    return fill, left, width


def _facts(
    row: Row,
    height: str,
    part: Part | None,
    classes: Sequence[tuple[Aspect, ...]],
    *,
    level: bool,
) -> tuple[tuple[str, str, str], ...]:
    basin = sum(aspect.basin_share for aspect in row.aspects)
    where = '' if level else ', level plane'
    return (
        ('rests on', resting_on(part, row.aspects[0]), 'where the part touches the surface'),
        (f'centre of mass{where}', f'{height} mm high', 'height above the surface'),
        (
            f'minimum barrier{where}',
            _barrier(row, classes),
            'smallest rise of the centre of mass that tips the part over, and into which aspect',
        ),
        (
            f'basin{where}',
            f'{share_text(basin)} %',
            'share of all orientations from which the part rolls here if released without speed',
        ),
    )


def _barrier(row: Row, classes: Sequence[tuple[Aspect, ...]]) -> str:
    aspect = row.aspects[0]
    if not aspect.neighbour:
        return 'none'
    members = class_of(aspect.neighbour, classes)
    if members == row.aspects:
        target = 'an aspect that looks the same'
    else:
        target = f'aspect{"s" * (len(members) > 1)} {ids_text(members)}'
    return f'{1000 * aspect.min_barrier:.3g} mm, to {target}'
