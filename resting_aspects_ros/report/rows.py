"""What a picture or a page shows of a distribution, from top to bottom."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from resting_aspects_ros.core.aspects.aspect_set import Aspect
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.report.colours import GREY, aspect_colour
from resting_aspects_ros.report.rounding import interval_of, outside_aspects

# Aspects of a row that are named one by one.
_MAX_NAMED = 4


@dataclass(frozen=True, eq=False)
class Row:
    """Drops that a viewer does not tell apart.

    name : str
        'aspect 3', 'aspects 1 and 2', 'unclassified'.
    colour : str
        '#RRGGBB'.
    aspects : tuple of Aspect
        One symmetry class, whose aspects look alike; empty if the drops are in no aspect.
    """

    name: str
    count: int
    interval: Interval
    colour: str
    aspects: tuple[Aspect, ...] = ()


def class_rows(distribution: Distribution) -> list[Row]:
    """A row for each symmetry class, in the order of their numbers."""
    classes = distribution.by_class()
    members = distribution.aspects.classes()
    return [
        Row(f'aspect{"s" * (len(alike) > 1)} {ids_text(alike)}', count, interval, colour, alike)
        for alike, count, interval, colour in zip(
            members,
            classes.counts.tolist(),
            classes.intervals(),
            [aspect_colour(alike[0]) for alike in members],
            strict=True,
        )
    ]


def aspect_rows(distribution: Distribution) -> list[Row]:
    """A row for each aspect, also where several look alike."""
    rows = zip(
        distribution.aspects.aspects, distribution.counts, distribution.intervals(), strict=True
    )
    return [
        Row(f'aspect {aspect.id}', int(count), interval, aspect_colour(aspect), (aspect,))
        for aspect, count, interval in rows
    ]


def outside_rows(distribution: Distribution) -> list[Row]:
    """A grey row for each way in which drops ended in no aspect, of those that there were."""
    return [
        Row(name, count, interval_of(distribution, count), GREY)
        for name, count in outside_aspects(distribution)
    ]


def ids_text(aspects: tuple[Aspect, ...]) -> str:
    """'3', '1 and 2', '1, 2 and 4', '1 to 6', '1, 3, ... 30'."""
    ids = [aspect.id for aspect in aspects]
    if len(ids) > 2 and all(b == a + 1 for a, b in pairwise(ids)):
        return f'{ids[0]} to {ids[-1]}'
    if len(ids) > _MAX_NAMED:
        return f'{ids[0]}, {ids[1]}, ... {ids[-1]}'
    *first, last = map(str, ids)
    return f'{", ".join(first)} and {last}' if first else last


def class_of(aspect_id: int, classes: Sequence[tuple[Aspect, ...]]) -> tuple[Aspect, ...]:
    """Of symmetry classes the one that an aspect is in."""
    return next(each for each in classes if aspect_id in {aspect.id for aspect in each})


def short_name(row: Row) -> str:
    """The name where there is little room: '3', '1 and 2', 'unclassified'."""
    return ids_text(row.aspects) if row.aspects else row.name
