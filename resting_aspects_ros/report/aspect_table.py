"""The aspects of a part as a table in a terminal, without a drop."""

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.resting_on import resting_on
from resting_aspects_ros.core.symmetry import Symmetry
from resting_aspects_ros.report.rounding import millimetre_texts
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import down_text, plain_table


def aspect_table(aspects: AspectSet, part: Part, title: str, *, each: bool = False) -> Table:
    """A row for each symmetry class; it fits 80 columns, and its cells are ASCII.

    Parameters
    ----------
    aspects : AspectSet
        Of the part.
    part : Part
    title : str
        Plain text, shown above.
    each : bool
        A row for each aspect, with its direction, in place of those for classes.
    """
    classes = aspects.classes()
    rows = [(aspect,) for aspect in aspects.aspects] if each else classes
    several = any(len(row) > 1 for row in rows)
    table = plain_table(title)
    table.add_column('aspects' if several else 'aspect', justify='right', no_wrap=True)
    table.add_column('class', justify='right', no_wrap=True)
    table.add_column('rests on', max_width=14 if each else 24)
    if each:
        table.add_column('down in part', no_wrap=True)
    for heading in ('height of\ncentre of\nmass (mm)', 'basin', 'barrier\n(mm)', 'to'):
        table.add_column(heading, justify='right', no_wrap=True)
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
            f'{1000 * aspect.least_barrier:.3g}' if aspect.neighbour else '-',
            _to_text(aspect, None if each else classes),
        )
    return table


def _to_text(aspect: Aspect, classes: list[tuple[Aspect, ...]] | None) -> str:
    """The aspect to which the least barrier leads, or all of its class."""
    if not aspect.neighbour:
        return '-'
    if classes is None:
        return str(aspect.neighbour)
    ids = ({aspect.id for aspect in members} for members in classes)
    (members,) = (
        members for members, of in zip(classes, ids, strict=True) if aspect.neighbour in of
    )
    return ids_text(members)


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
