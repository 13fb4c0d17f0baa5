"""The aspects of a part as a table in a terminal, without a drop."""

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.aspect_set import AspectSet, Sweep
from resting_aspects_ros.core.symmetry import Symmetry
from resting_aspects_ros.report.rounding import millimetre_texts
from resting_aspects_ros.report.table import down_text, plain_table

_WORDS = {
    Sweep.POINT: 'flat',
    Sweep.ARC: 'curved',
    Sweep.RING: 'ring',
    Sweep.DOME: 'dome',
    Sweep.SPHERE: 'sphere',
}


def aspect_table(aspects: AspectSet, title: str) -> Table:
    """A row for each aspect; it fits 80 columns, and its cells are ASCII.

    Parameters
    ----------
    title : str
        Plain text, shown above.
    """
    table = plain_table(title)
    table.add_column('aspect', justify='right', no_wrap=True)
    table.add_column('class', justify='right', no_wrap=True)
    table.add_column('down in part', no_wrap=True)
    table.add_column('side', no_wrap=True)
    table.add_column('height of\ncentre of\nmass (mm)', justify='right', no_wrap=True)
    table.add_column('basin', justify='right', no_wrap=True)
    table.add_column('barrier\n(mm)', justify='right', no_wrap=True)
    table.add_column('to', justify='right', no_wrap=True)
    rows = aspects.aspects
    heights = millimetre_texts(np.array([a.com_height for a in rows]))
    for aspect, height in zip(rows, heights, strict=True):
        table.add_row(
            str(aspect.id),
            str(aspect.symmetry_class),
            down_text(aspect),
            _WORDS[aspect.sweep],
            height,
            f'{100 * aspect.basin_share:.1f} %',
            f'{1000 * aspect.least_barrier:.3g}' if aspect.neighbour else '-',
            str(aspect.neighbour or '-'),
        )
    return table


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
