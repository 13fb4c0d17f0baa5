"""A printable A4 sheet for counting by hand in which class each dropped part lies."""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely import Polygon
from shapely.affinity import rotate, scale, translate

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.figure import FAINT, PIXELS_PER_INCH, TEXT, svg_text
from resting_aspects_ros.report.format import (
    GREY,
    aspect_colour,
    aspects_text,
    millimetre_texts,
    rgb,
    size_text,
)
from resting_aspects_ros.report.outlines import MM, look_alike_text, members
from resting_aspects_ros.report.picture import Image, draw_parts, picture_part, pose_parts
from resting_aspects_ros.rotations import composed
from resting_aspects_ros.vision.outline import LookAlike, Outline, rings

if TYPE_CHECKING:
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
    note: str
    colour: str
    drawing: Polygon
    image: Image


# Title, number of the page, and a note about the drawings.
Head = tuple[str, str, str]


def draw_page(axes: 'Axes', rows: Sequence[SheetRow], head: Head, *, last: bool) -> None:
    """Draw a page into axes that fill it; ``last`` adds the row of parts that lie in no class."""
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


def _draw_head(axes: 'Axes', head: Head) -> None:
    title, page, drawings = head
    _text(axes, MARGIN, 15, title, 14, weight='bold')
    _text(axes, WIDTH - MARGIN, 15, page, 8, FAINT, ha='right')
    names = (('date', 'counted by'), ('surface', 'height of release'), ('number of drops', ''))
    for (column, pair), line in product(enumerate(names), range(2)):
        if not pair[line]:
            continue
        left, y = MARGIN + 62 * column, 26 + 9 * line
        _text(axes, left, y, pair[line], 8.5, FAINT)
        axes.plot([left + 28, left + 58], [y + 0.8] * 2, color=FAINT, linewidth=0.5)
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
    _text(axes, BESIDE, top + 8.5, row.note, 7.5, FAINT, va='top', linespacing=1.5)
    _draw_boxes(axes, top + ROW - 2 * BOX - 3, row.colour)


def _draw_boxes(axes: 'Axes', top: float, colour: str) -> None:
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


PIXELS = 280  # side of a picture: 200 per inch
MM_PER_INCH = 25.4


def counting_sheet(
    part: Part,
    aspects: AspectSet,
    outlines: Sequence[Outline],
    look_alikes: Mapping[int, Sequence[LookAlike]],
    ending: str,
) -> bytes:
    """Return the sheet as a file in the format of an ending, '.pdf' or '.svg'.

    It has a row with tally boxes for each symmetry class, and one for parts that lie in none. A
    PDF has several pages if necessary, and an SVG file contains them one below the other.
    """
    drawn, text = _rows(part, aspects, outlines, look_alikes)
    pages = list(_pages(drawn))
    title = f'{part.name}, {size_text(part)}'
    heads = [
        (title, f'page {k} of {len(pages)}', f'Drawings {text}.') for k in range(1, len(pages) + 1)
    ]
    if ending == '.pdf':
        return _pdf(pages, heads)
    return _svg(pages, heads)


def _pages(rows: Sequence[SheetRow]) -> Iterator[list[SheetRow]]:
    """Yield the rows of each page; the last page has room for the row of other parts."""
    on_page = int((BOTTOM - TOP) / ROW)
    on_last = int((BOTTOM - TOP - ROW_OF_OTHERS) / ROW)
    first = 0
    while len(rows) - first > on_last:
        # A page without a class would look like a mistake.
        shown = min(on_page, len(rows) - first - 1)
        yield list(rows[first : first + shown])
        first += shown
    yield list(rows[first:])


def _rows(
    part: Part,
    aspects: AspectSet,
    outlines: Sequence[Outline],
    look_alikes: Mapping[int, Sequence[LookAlike]],
) -> tuple[list[SheetRow], str]:
    """Return the row of each outline, and the scale of their drawings in words."""
    groups = [members(each, aspects) for each in outlines]
    shown = [group[0] for group in groups]
    posed = pose_parts(picture_part(part), shown)
    colours = [aspect_colour(aspect) for aspect in shown]
    images = draw_parts(posed, [rgb(colour) for colour in colours], PIXELS)
    # Turned as in the picture, so that a person recognizes the part.
    turned = [
        _centred(rotate(each.polygon, _yaw(solid.orientation, each.orientation), use_radians=True))
        for each, solid in zip(outlines, posed, strict=True)
    ]
    sides = [np.subtract(each.bounds[2:], each.bounds[:2]).max() for each in turned]
    factor = drawing_scale(max(sides, default=1.0))
    heights = millimetre_texts(np.array([each.height for each in outlines]))
    rows = [
        SheetRow(
            f'Class {each.symmetry_class}: {aspects_text(group)}',
            _note(part, each, group, height, look_alikes[each.symmetry_class]),
            colour,
            scale(drawing, factor, factor, origin=(0, 0)),
            image,
        )
        for each, group, height, colour, drawing, image in zip(
            outlines, groups, heights, colours, turned, images, strict=True
        )
    ]
    return rows, f'{_ratio(factor)}, seen from above'


def _note(
    part: Part,
    outline: Outline,
    group: tuple[Aspect, ...],
    height: str,
    others: Sequence[LookAlike],
) -> str:
    alike = look_alike_text(outline, others)
    below = f'\nFrom above it looks like class {alike}.' if alike else ''
    return f'rests on {resting_on(part, group[0])}; {height} mm high{below}'


def _yaw(one: Array, other: Array) -> float:
    """Return the turn about the vertical, rad, from an orientation ``other`` to ``one``."""
    ((_, _, z, w),) = composed(one[None], other * [-1, -1, -1, 1])
    return float(2 * np.arctan2(z, w))


def _centred(polygon: Polygon) -> Polygon:
    left, low, right, high = polygon.bounds
    middle = translate(polygon, -(left + right) / 2, -(low + high) / 2)
    return scale(middle, MM, MM, origin=(0, 0))


def drawing_scale(side: float) -> float:
    """Return the scale of drawings of which the largest has this side, mm.

    1 if that fills at least a quarter of the room, else the largest of 1, 2 and 5 times a power of
    10, or its inverse, with which it fits.
    """
    room = DRAWING - 2
    if room / 4 <= side <= room:
        return 1.0
    tens = 10.0 ** np.arange(-6, 7)
    scales = np.sort(np.concatenate([tens, tens / 2, tens / 5]))
    return float(max(scales[scales * side <= room], default=scales[0]))


def _ratio(factor: float) -> str:
    if factor == 1:
        return 'at true size (1:1)'
    return f'{factor:g}:1' if factor > 1 else f'1:{1 / factor:g}'


def _pdf(pages: Sequence[Sequence[SheetRow]], heads: Sequence[Head]) -> bytes:
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    file = io.BytesIO()
    with PdfPages(file, metadata={'CreationDate': None}) as document:
        for rows, head in zip(pages, heads, strict=True):
            figure = Figure(figsize=(WIDTH / MM_PER_INCH, HEIGHT / MM_PER_INCH))
            draw_page(figure.add_axes((0, 0, 1, 1)), rows, head, last=head is heads[-1])
            document.savefig(figure, dpi=PIXELS_PER_INCH)
    return file.getvalue()


def _svg(pages: Sequence[Sequence[SheetRow]], heads: Sequence[Head]) -> bytes:
    from matplotlib.figure import Figure

    number = len(pages)
    figure = Figure(figsize=(WIDTH / MM_PER_INCH, number * HEIGHT / MM_PER_INCH))
    for k, (rows, head) in enumerate(zip(pages, heads, strict=True), start=1):
        axes = figure.add_axes((0, 1 - k / number, 1, 1 / number))
        draw_page(axes, rows, head, last=k == number)
    return svg_text(figure).encode()
