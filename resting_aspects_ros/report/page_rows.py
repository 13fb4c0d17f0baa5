"""The rows of a page, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspect_set import Sweep
from resting_aspects_ros.core.distribution import Distribution, Interval
from resting_aspects_ros.report.rounding import (
    interval_text,
    millimetre_texts,
    probability_text,
    share_text,
)
from resting_aspects_ros.report.rows import Row, short_name
from resting_aspects_ros.report.table import down_text

SIDES = {
    Sweep.POINT: 'flat side',
    Sweep.ARC: 'curved side, rocks',
    Sweep.RING: 'curved side, rolls',
    Sweep.DOME: 'dome',
    Sweep.SPHERE: 'ball',
}
OUTSIDE = {
    'unclassified': 'came to rest on no side that is stable by its shape',
    'unsettled': 'still moved when its time was over',
    'failed': 'went numerically wrong',
}


@dataclass(frozen=True)
class Bar:
    """A bar and its whisker, as percentages of the width that there is."""

    width: float
    left: float
    whisker: float


@dataclass(frozen=True)
class Member:
    """One of the aspects of a row."""

    id: int
    down: str
    count: int
    probability: str
    interval: str


@dataclass(frozen=True)
class RowText:
    """A row as a reader sees it; what does not apply is empty.

    oblique, above : str
        Pictures, as addresses that hold them.
    facts : tuple of (str, str, str)
        What is known of the aspect by its shape: label, value, explanation.
    """

    name: str
    short: str
    note: str
    colour: str
    count: int
    seen: bool
    probability: str
    interval: str
    bar: Bar
    facts: tuple[tuple[str, str, str], ...] = ()
    members: tuple[Member, ...] = ()
    oblique: str = ''
    above: str = ''


def row_texts(
    distribution: Distribution,
    rows: Sequence[Row],
    pictures: Sequence[tuple[str, str]],
) -> list[RowText]:
    """Each row in words.

    Parameters
    ----------
    rows : sequence of Row
        Of the distribution.
    pictures : sequence of (str, str)
        Of each row: obliquely and from above; empty where there is none.
    """
    longest = max((row.interval.upper for row in rows), default=1.0)
    heights = millimetre_texts(
        np.array([row.aspects[0].com_height if row.aspects else 0.0 for row in rows])
    )
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
            facts=_facts(row, height) if row.aspects else (),
            members=tuple(
                Member(
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
        )
        for row, height, (oblique, above) in zip(rows, heights, pictures, strict=True)
    ]


def _note(row: Row) -> str:
    if not row.aspects:
        return OUTSIDE[row.name]
    return f'{len(row.aspects)} that look alike' if len(row.aspects) > 1 else ''


def _probability(row: Row, drops: int) -> str:
    if not drops:
        return 'no drops'
    return probability_text(row.interval) if row.count else 'never seen'


def _bar(interval: Interval, longest: float) -> Bar:
    scale = 100 / longest
    return Bar(
        round(interval.probability * scale, 2),
        round(interval.lower * scale, 2),
        round((interval.upper - interval.lower) * scale, 2),
    )


def _facts(row: Row, height: str) -> tuple[tuple[str, str, str], ...]:
    basin = sum(aspect.basin_share for aspect in row.aspects)
    return (
        ('centre of mass', f'{height} mm high', 'above the surface'),
        (
            'least barrier',
            _barrier(row),
            'the least rise of the centre of mass that tips the part over, and into which aspect',
        ),
        (
            'basin',
            f'{share_text(basin)} %',
            'share of all directions from which the part, let go without speed, rolls here',
        ),
        ('rests on', SIDES[row.aspects[0].sweep], 'the side on which it lies'),
        (
            'alike',
            str(len(row.aspects)),
            'aspects that a rotation of the part takes to each other (symmetry multiplicity)',
        ),
    )


def _barrier(row: Row) -> str:
    aspect = row.aspects[0]
    if not aspect.neighbour:
        return 'none'
    alike = aspect.neighbour in {each.id for each in row.aspects}
    to = 'one alike' if alike else str(aspect.neighbour)
    return f'{1000 * aspect.least_barrier:.3g} mm, to {to}'
