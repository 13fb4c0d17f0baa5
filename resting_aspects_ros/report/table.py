"""A distribution, or the aspects of a part, as a table in a terminal."""

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.aspects.support import resting_on
from resting_aspects_ros.core.aspects.symmetry import Symmetry
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.report.rounding import (
    decimals_of,
    direction_text,
    interval_text,
    millimetre_texts,
    probability_text,
)
from resting_aspects_ros.report.rows import (
    Row,
    aspect_rows,
    class_of,
    class_rows,
    ids_text,
    outside_rows,
    short_name,
)

# What a probability is called that nobody has measured.
NOTHING = '-'
RESTS_ON, DOWN = 'rests on', 'down in part'  # headings of columns of words
# Longer words on what a part rests on are continued in another line: of classes, and of each
# aspect, beside its direction.
_REST_WIDTH, _REST_WIDTH_OF_EACH = 26, 20


def distribution_table(
    distribution: Distribution, title: str, part: Part | None = None, *, each: bool = False
) -> Table:
    """A row for each symmetry class, seen or not, then what is in no aspect, then the drops.

    It fits 80 columns, says all without colour, and its cells are ASCII. Probabilities are in
    percent with the digits that their interval allows.

    Parameters
    ----------
    distribution : Distribution
    title : str
        Plain text, shown above.
    part : Part, optional
        Of the aspects; with it the table says on what the part rests.
    each : bool
        A row for each aspect, with its direction, in place of those for classes.
    """
    rows = aspect_rows(distribution) if each else class_rows(distribution)
    several = any(len(row.aspects) > 1 for row in rows)
    table = plain_table(
        title,
        'aspects' if several else 'aspect',
        RESTS_ON,
        *([DOWN] if each else []),
        'proba-\nbility',
        f'{100 * distribution.confidence:g} % interval',
        'count',
        *(['of each\nof them'] if several else []),
        rest_width=_REST_WIDTH_OF_EACH if each else _REST_WIDTH,
    )
    for row in rows:
        cells = [short_name(row), resting_on(part, row.aspects[0])]
        if each:
            cells.append(down_text(row.aspects[0]))
        cells += shares(row.interval, row.count, distribution.drops)
        if several:
            cells.append(_each_text(row, distribution.drops))
        table.add_row(*cells)
    table.add_section()
    for row in outside_rows(distribution):
        cells = ['', row.name, *([''] if each else [])]
        table.add_row(*cells, *shares(row.interval, row.count, distribution.drops))
    cells = ['', 'drops in total', *([''] if each else []), '', '', str(distribution.drops)]
    table.add_row(*cells, style='bold')
    return table


def never_seen_text(distribution: Distribution, *, each: bool = False) -> str:
    """What is known of aspects in which no drop ended; empty if there are none."""
    texts = [
        f'{row.name} (at most {100 * row.interval.upper:.2g} %; the part rolls into '
        f'{"them" if len(row.aspects) > 1 else "it"} from '
        f'{100 * sum(aspect.basin_share for aspect in row.aspects):.2g} % of all directions)'
        for row in (aspect_rows(distribution) if each else class_rows(distribution))
        if not row.count
    ]
    return f'Never seen: {", ".join(texts)}.' if texts and distribution.drops else ''


def _each_text(row: Row, drops: int) -> str:
    """The mean probability of the aspects of a row."""
    if len(row.aspects) == 1 or not drops:
        return ''
    share = 100 * row.interval.probability / len(row.aspects)
    return f'{share:.{decimals_of(row.interval)}f} %'


def down_text(aspect: Aspect) -> str:
    """Its down direction, or the axis about which it rolls."""
    if aspect.rolls and aspect.axis.any():
        return f'axis {direction_text(aspect.axis)}'
    return direction_text(aspect.down_in_part)


def plain_table(title: str, *headings: str, rest_width: int | None = None) -> Table:
    """A table without rows yet; the title is plain text, and RESTS_ON at most so wide."""
    # Not markup: a bracket in a part's name stays a bracket.
    table = Table(
        title=Text(title, style='bold'),
        title_justify='left',
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        collapse_padding=True,
    )
    for heading in headings:
        if heading == RESTS_ON:
            table.add_column(heading, max_width=rest_width)
        else:
            table.add_column(heading, justify='left' if heading == DOWN else 'right', no_wrap=True)
    return table


def shares(interval: Interval, count: int, drops: int) -> tuple[str, str, str]:
    """Probability, interval and count, of so many drops, as three cells of a row."""
    if drops == 0:
        return NOTHING, interval_text(interval), str(count)
    return probability_text(interval), interval_text(interval), str(count)


def aspect_table(aspects: AspectSet, part: Part, title: str, *, each: bool = False) -> Table:
    """A row for each symmetry class, or each aspect, without a drop; as distribution_table."""
    classes = aspects.classes()
    rows = [(aspect,) for aspect in aspects.aspects] if each else classes
    several = any(len(row) > 1 for row in rows)
    table = plain_table(
        title,
        'aspects' if several else 'aspect',
        'class',
        RESTS_ON,
        *([DOWN] if each else []),
        'height of\ncentre of\nmass (mm)',
        'basin',
        'barrier\n(mm)',
        'to',
        rest_width=14 if each else 24,
    )
    heights = millimetre_texts(np.array([row[0].com_height for row in rows]))
    for row, height in zip(rows, heights, strict=True):
        aspect = row[0]
        basin = f'{100 * sum(aspect.basin_share for aspect in row):.1f} %'
        table.add_row(
            ids_text(row),
            str(aspect.symmetry_class),
            resting_on(part, aspect),
            *([down_text(aspect)] if each else []),
            height,
            basin,
            f'{1000 * aspect.min_barrier:.3g}' if aspect.neighbour else '-',
            _to_text(aspect, None if each else classes),
        )
    return table


def _to_text(aspect: Aspect, classes: list[tuple[Aspect, ...]] | None) -> str:
    """The aspect to which the minimum barrier leads, or all of its class."""
    if not aspect.neighbour:
        return '-'
    if classes is None:
        return str(aspect.neighbour)
    return ids_text(class_of(aspect.neighbour, classes))


def symmetry_text(symmetry: Symmetry) -> str:
    """What rotations map the part onto itself, in words."""
    if symmetry.kind == 'spherical':
        return 'every rotation maps it onto itself'
    if symmetry.kind == 'axial':
        ends = ', and end for end' if symmetry.order > 1 else ''
        return f'any turn about an axis maps it onto itself{ends}'
    if symmetry.order == 1:
        return 'no rotation maps it onto itself'
    return f'{symmetry.order} rotations map it onto itself'
