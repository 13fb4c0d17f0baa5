"""Tables for a terminal: a distribution, or the aspects of a part."""

import textwrap

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.aspects.symmetry import Symmetry
from resting_aspects_ros.part.part import Part
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
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

# The cell of a value that is not known.
NOTHING = '-'
# Width of a title.
TITLE_WIDTH = 80
RESTS_ON, DOWN = 'rests on', 'down in part'  # headings of columns with text
# Maximum width of the column RESTS_ON, beyond which its text is wrapped: in a table of classes,
# and in a table of single aspects, which also has the column DOWN.
_REST_WIDTH, _REST_WIDTH_OF_EACH = 26, 20


def distribution_table(
    distribution: Distribution, title: str, part: Part | None = None, *, each: bool = False
) -> Table:
    """Return a table with a row for each symmetry class, each other outcome, and the total.

    Classes in which no drop ended have a row, too. The table fits 80 columns, needs no colour,
    and its cells are ASCII. Probabilities are in percent, with as many digits as their interval
    justifies.

    Parameters
    ----------
    distribution : Distribution
    title : str
        Plain text, shown above the table.
    part : Part, optional
        Without the part, the column 'rests on' shows only the size of the support.
    each : bool
        Whether the table has a row for each aspect, with its direction, instead of for each class.
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
        *(['per\naspect'] if several else []),
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
    """Describe the aspects in which no drop ended; empty if there are none."""
    # The basins are those of a level floor.
    normal = distribution.aspects.floor_normal
    level = normal is None or float(normal[2]) > 1 - 1e-9
    texts = [
        f'{row.name} (at most {100 * row.interval.upper:.2g} %{_basin_text(row) if level else ""})'
        for row in (aspect_rows(distribution) if each else class_rows(distribution))
        if not row.count
    ]
    return f'Never seen: {", ".join(texts)}.' if texts and distribution.drops else ''


def merged_text(aspects: AspectSet) -> str:
    """Describe the barriers that were ignored to find the aspects; empty if there are none."""
    having = tuple(aspect for aspect in aspects.aspects if aspect.merged > 0)
    if not having:
        return ''
    highest = 1000 * max(aspect.merged for aspect in having)
    plural = 's' if len(having) > 1 else ''
    return (
        f'Ignored in aspect{plural} {ids_text(having)}: barriers of up to {highest:.2g} mm, which '
        'the mesh or noise explains.'
    )


def _basin_text(row: Row) -> str:
    share = 100 * sum(aspect.basin_share for aspect in row.aspects)
    them = 'them' if len(row.aspects) > 1 else 'it'
    return f'; the part rolls into {them} from {share:.2g} % of all directions'


def _each_text(row: Row, drops: int) -> str:
    """Return the mean probability of the aspects of a row."""
    if len(row.aspects) == 1 or not drops:
        return ''
    share = 100 * row.interval.probability / len(row.aspects)
    return f'{share:.{decimals_of(row.interval)}f} %'


def down_text(aspect: Aspect) -> str:
    """Return the down direction of an aspect, or the axis about which the part rolls in it."""
    if aspect.rolls and aspect.axis.any():
        return f'axis {direction_text(aspect.axis)}'
    return direction_text(aspect.down_in_part)


def _wrapped(title: str) -> str:
    """Return a title in lines of at most TITLE_WIDTH characters."""
    return '\n'.join(
        textwrap.fill(line, TITLE_WIDTH, break_long_words=False, break_on_hyphens=False)
        for line in title.split('\n')
    )


def plain_table(title: str, *headings: str, rest_width: int | None = None) -> Table:
    """Return a table without rows; ``rest_width`` is the maximum width of column RESTS_ON."""
    # Text is not parsed as markup: a square bracket in a part's name stays.
    table = Table(
        # Wider than the table, if necessary: a narrow table would cut a title into many lines.
        title=Text(_wrapped(title), style='bold', no_wrap=True, overflow='ignore'),
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
    """Return the probability, the interval and the count as three cells of a row."""
    if drops == 0:
        return NOTHING, interval_text(interval), str(count)
    return probability_text(interval), interval_text(interval), str(count)


def aspect_table(aspects: AspectSet, part: Part, title: str, *, each: bool = False) -> Table:
    """Return a table of a part's symmetry classes, or of each aspect, without counts of drops."""
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
    """Return the aspect behind the minimum barrier, or all aspects of its class."""
    if not aspect.neighbour:
        return '-'
    if classes is None:
        return str(aspect.neighbour)
    return ids_text(class_of(aspect.neighbour, classes))


def symmetry_text(symmetry: Symmetry) -> str:
    """Describe the rotations that map the part onto itself."""
    if symmetry.kind == 'spherical':
        return 'every rotation maps it onto itself'
    if symmetry.kind == 'axial':
        ends = ', and so does turning it end for end' if symmetry.order > 1 else ''
        return f'any rotation about one axis maps it onto itself{ends}'
    if symmetry.order == 1:
        return 'no rotation maps it onto itself'
    return f'{symmetry.order} rotations map it onto itself'
