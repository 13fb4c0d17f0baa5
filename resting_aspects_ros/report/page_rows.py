"""The rows of a page, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import Aspect
from resting_aspects_ros.core.aspects.support import resting_on
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.report.rounding import (
    interval_text,
    millimetre_texts,
    probability_text,
    share_text,
)
from resting_aspects_ros.report.rows import Row, class_of, ids_text, short_name
from resting_aspects_ros.report.table import down_text

OUTSIDE = {
    'unclassified': 'came to rest on no side that is stable by its shape',
    'unsettled': 'still moved when its time was over',
    'failed': 'went numerically wrong',
}


@dataclass(frozen=True)
class RowText:
    """A row as a reader sees it; what does not apply is empty.

    oblique, above, small : str
        Pictures, as addresses that hold them.
    bar : (float, float, float)
        Length of the bar, and begin and length of its whisker, as percentages of the width.
    facts : tuple of (str, str, str)
        What is known of the aspect by its shape: label, value, explanation.
    members : tuple of (id, down in part, count, probability, interval)
        Each aspect by itself.
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
) -> list[RowText]:
    """Each row in words.

    Parameters
    ----------
    rows : sequence of Row
        Of the distribution.
    pictures : sequence of three str
        Of each row: obliquely, from above, and small; empty where there is none.
    part : Part or None
    """
    longest = max((row.interval.upper for row in rows), default=1.0)
    heights = millimetre_texts(
        np.array([row.aspects[0].com_height if row.aspects else 0.0 for row in rows])
    )
    classes = distribution.aspects.classes()
    of_aspects = list(zip(distribution.counts, distribution.intervals(), strict=True))
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
            facts=_facts(row, height, part, classes) if row.aspects else (),
            members=tuple(
                (
                    aspect.id,
                    down_text(aspect),
                    int(of_aspects[aspect.id - 1][0]),
                    probability_text(of_aspects[aspect.id - 1][1]),
                    interval_text(of_aspects[aspect.id - 1][1]),
                )
                for aspect in row.aspects
            ),
            oblique=oblique,
            above=above,
            small=small,
        )
        for row, height, (oblique, above, small) in zip(rows, heights, pictures, strict=True)
    ]


def _note(row: Row) -> str:
    if not row.aspects:
        return OUTSIDE[row.name]
    return f'{len(row.aspects)} that look alike' if len(row.aspects) > 1 else ''


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
    row: Row, height: str, part: Part | None, classes: Sequence[tuple[Aspect, ...]]
) -> tuple[tuple[str, str, str], ...]:
    basin = sum(aspect.basin_share for aspect in row.aspects)
    return (
        ('rests on', resting_on(part, row.aspects[0]), 'where the part touches the surface'),
        ('centre of mass', f'{height} mm high', 'above the surface'),
        (
            'minimum barrier',
            _barrier(row, classes),
            'how far the centre of mass must rise to tip the part over, and into which aspect',
        ),
        (
            'basin',
            f'{share_text(basin)} %',
            'share of all directions from which the part, let go without speed, rolls here',
        ),
    )


def _barrier(row: Row, classes: Sequence[tuple[Aspect, ...]]) -> str:
    aspect = row.aspects[0]
    if not aspect.neighbour:
        return 'none'
    members = class_of(aspect.neighbour, classes)
    to = 'one that looks alike' if members == row.aspects else ids_text(members)
    return f'{1000 * aspect.min_barrier:.3g} mm, into {to}'
