"""A printable A4 sheet for counting by hand in which class each dropped part lies."""

import io
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from shapely import Polygon
from shapely.affinity import rotate, scale, translate

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.aspect_pose import picture_part
from resting_aspects_ros.report.colours import aspect_colour, rgb
from resting_aspects_ros.report.figure_style import PIXELS_PER_INCH
from resting_aspects_ros.report.outline_drawing import MM
from resting_aspects_ros.report.outline_table import members, short_look_alike_text
from resting_aspects_ros.report.posed_part import draw_parts, pose_parts
from resting_aspects_ros.report.rounding import millimetre_texts, size_text
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.tally_page import (
    BOTTOM,
    DRAWING,
    HEIGHT,
    ROW,
    ROW_OF_OTHERS,
    TOP,
    WIDTH,
    SheetRow,
    draw_page,
)
from resting_aspects_ros.rotations import composed
from resting_aspects_ros.vision.outline import LookAlike, Outline

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
    heads = [
        (f'{part.name}, {size_text(part)}', f'page {k + 1} of {len(pages)}', f'Drawings {text}.')
        for k in range(len(pages))
    ]
    return (_pdf if ending == '.pdf' else _svg)(list(zip(pages, heads, strict=True)))


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
    posed = pose_parts(picture_part(part, shown), shown)
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
            f'Class {each.symmetry_class}: {_aspects_text(group)}',
            tuple(_notes(part, each, group, height, look_alikes[each.symmetry_class])),
            colour,
            scale(drawing, factor, factor, origin=(0, 0)),
            image,
        )
        for each, group, height, colour, drawing, image in zip(
            outlines, groups, heights, colours, turned, images, strict=True
        )
    ]
    return rows, f'{_ratio(factor)}, seen from above'


def _notes(
    part: Part,
    outline: Outline,
    group: tuple[Aspect, ...],
    height: str,
    others: Sequence[LookAlike],
) -> Iterator[str]:
    yield f'rests on {resting_on(part, group[0])}; {height} mm high'
    if text := short_look_alike_text(outline, others):
        yield f'From above it looks like {text}.'


def _aspects_text(group: tuple[Aspect, ...]) -> str:
    return f'aspect{"s" * (len(group) > 1)} {ids_text(group)}'


def _yaw(one: Array, other: Array) -> float:
    """Return the turn about the vertical, rad, from an orientation ``other`` to ``one``."""
    ((_, _, z, w),) = composed(one[None], other * [-1, -1, -1, 1])
    return float(2 * np.arctan2(z, w))


def _centred(polygon: Polygon) -> Polygon:
    """Return the polygon in mm, with the middle of its bounding box at 0."""
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


_Pages = list[tuple[list[SheetRow], tuple[str, str, str]]]


def _pdf(pages: _Pages) -> bytes:
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    file = io.BytesIO()
    with PdfPages(file, metadata={'CreationDate': None}) as document:
        for k, (rows, head) in enumerate(pages):
            figure = Figure(figsize=(WIDTH / MM_PER_INCH, HEIGHT / MM_PER_INCH))
            draw_page(figure.add_axes((0, 0, 1, 1)), rows, head, last=k == len(pages) - 1)
            document.savefig(figure, dpi=PIXELS_PER_INCH)
    return file.getvalue()


def _svg(pages: _Pages) -> bytes:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.figure_style import svg_text

    number = len(pages)
    figure = Figure(figsize=(WIDTH / MM_PER_INCH, number * HEIGHT / MM_PER_INCH))
    for k, (rows, head) in enumerate(pages):
        axes = figure.add_axes((0, 1 - (k + 1) / number, 1, 1 / number))
        draw_page(axes, rows, head, last=k == number - 1)
    return svg_text(figure).encode()
