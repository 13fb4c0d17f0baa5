"""A distribution as a table in a terminal."""

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from resting_aspects_ros.core.aspect_set import Aspect
from resting_aspects_ros.core.distribution import Distribution, Interval
from resting_aspects_ros.report.rounding import (
    direction_text,
    interval_of,
    interval_text,
    millimetre_texts,
    outside_aspects,
    probability_text,
)

# Aspects of a class that are named one by one.
_MOST_NAMED = 6
# What a probability is called that nobody has measured.
NOTHING = '-'


def distribution_table(distribution: Distribution, title: str) -> Table:
    """A row for each aspect, seen or not, then what is in none of them, then the drops.

    It fits 80 columns, says all without colour, and its cells are ASCII. Probabilities are
    in percent with the digits that their interval allows, heights in mm.

    Parameters
    ----------
    distribution : Distribution
    title : str
        Plain text, shown above.
    """
    table = _empty_table(title, distribution.confidence)
    drops = distribution.drops
    aspects = distribution.aspects.aspects
    heights = millimetre_texts(np.array([aspect.com_height for aspect in aspects]))
    rows = zip(aspects, heights, distribution.counts, distribution.intervals(), strict=True)
    for aspect, height, count, interval in rows:
        direction = down_text(aspect)
        table.add_row(str(aspect.id), direction, *shares(interval, int(count), drops), height)
    table.add_section()
    for label, count in _alike(distribution):
        table.add_row('', label, *shares(interval_of(distribution, count), count, drops), '')
    for name, count in outside_aspects(distribution):
        table.add_row('', name, *shares(interval_of(distribution, count), count, drops), '')
    table.add_row('', 'drops in total', '', '', str(drops), '', style='bold')
    return table


def never_seen_text(distribution: Distribution) -> str:
    """What is known of aspects in which no drop ended; empty if there are none."""
    rows = zip(
        distribution.aspects.aspects, distribution.counts, distribution.intervals(), strict=True
    )
    texts = [
        f'{aspect.id} (at most {100 * interval.upper:.2g} %; '
        f'the part rolls into it from {100 * aspect.basin_share:.2g} % of all directions)'
        for aspect, count, interval in rows
        if not count
    ]
    return f'Never seen: aspect {", ".join(texts)}.' if texts and distribution.drops else ''


def down_text(aspect: Aspect) -> str:
    """Its down direction, or the axis about which it rolls."""
    if aspect.rolls and aspect.axis.any():
        return f'axis {direction_text(aspect.axis)}'
    return direction_text(aspect.down_in_part)


def _alike(distribution: Distribution) -> list[tuple[str, int]]:
    """Symmetry classes of several aspects, in words, with their counts."""
    found = []
    counts = distribution.by_class().counts.tolist()
    for members, count in zip(distribution.aspects.classes(), counts, strict=True):
        ids = [str(aspect.id) for aspect in members]
        shown = ids if len(ids) <= _MOST_NAMED else [ids[0], '...', ids[-1]]
        if len(ids) > 1:
            found.append((f'{len(ids)} alike: {" ".join(shown)}', count))
    return found


def plain_table(title: str) -> Table:
    """A table without columns yet; the title is plain text."""
    # Not markup: a bracket in a part's name stays a bracket.
    return Table(
        title=Text(title, style='bold'),
        title_justify='left',
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        collapse_padding=True,
    )


def _empty_table(title: str, confidence: float) -> Table:
    table = plain_table(title)
    table.add_column('aspect', justify='right', no_wrap=True)
    table.add_column('down in part', no_wrap=True)
    table.add_column('probability', justify='right', no_wrap=True)
    table.add_column(f'{100 * confidence:g} % interval', justify='right', no_wrap=True)
    table.add_column('count', justify='right', no_wrap=True)
    table.add_column('height of\ncentre of\nmass (mm)', justify='right', no_wrap=True)
    return table


def shares(interval: Interval, count: int, drops: int) -> tuple[str, str, str]:
    """Probability, interval and count, of so many drops, as three cells of a row."""
    if drops == 0:
        return NOTHING, interval_text(interval), str(count)
    return probability_text(interval), interval_text(interval), str(count)
