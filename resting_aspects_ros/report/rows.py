"""The rows of a picture or a page, one for each symmetry class or other outcome."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.report.colours import GREY, aspect_colour
from resting_aspects_ros.report.rounding import interval_of, outside_aspects
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

# A row with more aspects than this, not consecutive, has an abbreviated list of their numbers.
_MAX_LISTED = 4


@dataclass(frozen=True, eq=False)
class Row:
    """One row of a report: the drops of one symmetry class, or of one outcome in no aspect.

    name : str
        'aspect 3', 'aspects 1 and 2', 'unclassified'.
    colour : str
        '#RRGGBB'.
    aspects : tuple of Aspect
        The aspects of one symmetry class, which look the same; empty if the drops are in no
        aspect.
    """

    name: str
    count: int
    interval: Interval
    colour: str
    aspects: tuple[Aspect, ...] = ()


def class_rows(distribution: Distribution) -> list[Row]:
    """Return a row for each symmetry class, in the order of the class numbers."""
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
    """Return a row for each aspect, even if several aspects look the same."""
    rows = zip(
        distribution.aspects.aspects, distribution.counts, distribution.intervals(), strict=True
    )
    return [
        Row(f'aspect {aspect.id}', int(count), interval, aspect_colour(aspect), (aspect,))
        for aspect, count, interval in rows
    ]


def outside_rows(distribution: Distribution) -> list[Row]:
    """Return a grey row for each outcome in no aspect, such as 'unsettled', that occurred."""
    return [
        Row(name, count, interval_of(distribution, count), GREY)
        for name, count in outside_aspects(distribution)
    ]


def ids_text(aspects: tuple[Aspect, ...]) -> str:
    """Return the ids as '3', '1 and 2', '1, 2 and 4', '1 to 6' or '1, 3, ... 30'."""
    ids = [aspect.id for aspect in aspects]
    text = numbers_text(ids)
    return (
        text if ' to ' in text or len(ids) <= _MAX_LISTED else f'{ids[0]}, {ids[1]}, ... {ids[-1]}'
    )


def numbers_text(numbers: Sequence[int]) -> str:
    """Return ascending numbers as '3', '1 and 2', '1, 2 and 4' or '1 to 6'."""
    if len(numbers) > 2 and all(b == a + 1 for a, b in pairwise(numbers)):
        return f'{numbers[0]} to {numbers[-1]}'
    *first, last = map(str, numbers)
    return f'{", ".join(first)} and {last}' if first else last


def class_of(aspect_id: int, classes: Sequence[tuple[Aspect, ...]]) -> tuple[Aspect, ...]:
    """Return the symmetry class that contains the aspect."""
    return next(each for each in classes if aspect_id in {aspect.id for aspect in each})


def short_name(row: Row) -> str:
    """Return the name without 'aspect': '3', '1 and 2', 'unclassified'."""
    return ids_text(row.aspects) if row.aspects else row.name
