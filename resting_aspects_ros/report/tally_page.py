"""A page of the counting sheet, drawn in mm: a row with tally boxes for each class."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely import Polygon

from resting_aspects_ros.report.colours import GREY, rgb
from resting_aspects_ros.report.figure_style import FAINT, TEXT
from resting_aspects_ros.report.posed_part import Image
from resting_aspects_ros.vision.outline import rings

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a sheet is made
    from matplotlib.axes import Axes

# Sizes in mm, y downwards from the upper edge of a page.
WIDTH, HEIGHT, MARGIN = 210.0, 297.0, 14.0
TOP, BOTTOM = 46.0, 274.0  # of the rows
ROW, ROW_OF_OTHERS = 40.0, 24.0
PICTURE, DRAWING = 36.0, 38.0  # room for the picture and the drawing of a class
BESIDE = MARGIN + PICTURE + DRAWING + 8.0  # left edge of text and boxes
BOX, BOXES, GROUP = 7.6, 10, 5  # side, number in a line, strokes in a box
NOTE = (
    'Make one stroke for each part, and five in each box. The small number is the total when the '
    'box is full.\n'
    'Enter the totals into a CSV file with the first line "class,count", a line for each class, '
    'and one for "unclassified".\n'
    'Classes that you counted together have one line, such as "3+4,57". "resting_aspects compare" '
    'and "drift" read the file.'
)


@dataclass(frozen=True, eq=False)
class SheetRow:
    """What the sheet shows of a class: its drawing (mm, centred at 0), texts and picture."""

    title: str
    notes: tuple[str, ...]
    colour: str
    drawing: Polygon
    image: Image


def draw_page(
    axes: 'Axes', rows: Sequence[SheetRow], head: tuple[str, str, str], *, last: bool
) -> None:
    """Draw a page into axes that fill it; ``last`` adds the row of parts that lie in no class.

    ``head`` contains the title, the number of the page, and a note about the drawings.
    """
    axes.set(xlim=(0, WIDTH), ylim=(HEIGHT, 0))
    axes.set_axis_off()
    _draw_head(axes, head)
    top = TOP
    for row in rows:
        _draw_row(axes, row, top)
        top += ROW
    if last:
        _line(axes, top)
        _text(axes, MARGIN, top + 6, 'Unclassified', 11, weight='bold')
        _text(
            axes, MARGIN, top + 10.5, 'none of these: leans, or lies on another part', 7.5, FAINT
        )
        _draw_boxes(axes, top + 3, GREY)
        top += ROW_OF_OTHERS
    _line(axes, top)
    _text(axes, MARGIN, BOTTOM + 5, NOTE, 7.5, FAINT, va='top')


def _draw_head(axes: 'Axes', head: tuple[str, str, str]) -> None:
    title, page, drawings = head
    _text(axes, MARGIN, 15, title, 14, weight='bold')
    _text(axes, WIDTH - MARGIN, 15, page, 8, FAINT, ha='right')
    names = (('date', 'counted by'), ('surface', 'height of release'), ('number of drops', ''))
    for (column, pair), line in product(enumerate(names), range(2)):
        if not pair[line]:
            continue
        left, y = MARGIN + 62 * column, 26 + 9 * line
        _text(axes, left, y, pair[line], 8.5, FAINT)
        start = left + _width(pair[line], 8.5) + 2
        axes.plot([start, left + 58], [y + 0.8] * 2, color=FAINT, linewidth=0.5)
    _text(axes, MARGIN, 42, drawings, 7.5, FAINT)


def _draw_row(axes: 'Axes', row: SheetRow, top: float) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    _line(axes, top)
    inner, middle = PICTURE - 2, top + ROW / 2
    extent = (MARGIN, MARGIN + inner, middle + inner / 2, middle - inner / 2)
    axes.imshow(row.image, extent=extent, interpolation='antialiased', zorder=2)
    axes.set(xlim=(0, WIDTH), ylim=(HEIGHT, 0), aspect='auto')  # imshow changes them
    centre = [MARGIN + PICTURE + DRAWING / 2 + 2, middle]
    # The first corner closes each ring of the path again.
    corners = [np.concatenate([ring, ring[:1]]) * [1, -1] + centre for ring in rings(row.drawing)]
    path = Path.make_compound_path(*(Path(ring, closed=True) for ring in corners))
    axes.add_patch(
        PathPatch(path, facecolor=(*rgb(row.colour), 0.25), edgecolor=TEXT, linewidth=0.6)
    )
    _text(axes, BESIDE, top + 6, row.title, 11, weight='bold')
    for k, note in enumerate(row.notes):
        _text(axes, BESIDE, top + 10.5 + 4 * k, note, 7.5, FAINT)
    _draw_boxes(axes, top + ROW - 2 * BOX - 3, row.colour)


def _draw_boxes(axes: 'Axes', top: float, colour: str) -> None:
    """Draw two lines of tally boxes and, to their right, one for the total."""
    from matplotlib.patches import Rectangle

    corners = product(range(2), range(BOXES))
    for number, (line, column) in zip(count(GROUP, GROUP), corners, strict=False):
        left, y = BESIDE + column * BOX, top + line * BOX
        axes.add_patch(Rectangle((left, y), BOX, BOX, fill=False, edgecolor=FAINT, linewidth=0.5))
        _text(axes, left + BOX - 1, y + BOX - 1, str(number), 4.5, FAINT, ha='right')
    left = BESIDE + BOXES * BOX + 3
    total = Rectangle(
        (left, top), WIDTH - MARGIN - left, 2 * BOX, fill=False, edgecolor=colour, linewidth=1.4
    )
    axes.add_patch(total)
    _text(axes, left + 1, top + 3, 'total', 6, FAINT)


def _line(axes: 'Axes', y: float) -> None:
    axes.plot([MARGIN, WIDTH - MARGIN], [y, y], color=GREY, linewidth=0.6)


def _text(
    axes: 'Axes', x: float, y: float, text: str, size: float, colour: str = TEXT, **style: Any
) -> None:
    axes.text(x, y, text, size=size, color=colour, parse_math=False, **style)


def _width(text: str, size: float) -> float:
    """Return the width of a text, mm."""
    from matplotlib.textpath import TextPath

    points: float = TextPath((0, 0), text, size).get_extents().x1
    return points * 25.4 / 72
