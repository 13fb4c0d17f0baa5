"""The bar chart of a distribution, with a picture of the part beside each bar."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.colours import GREY, rgb
from resting_aspects_ros.report.figure_style import (
    FAINT,
    PAPER,
    PIXELS_PER_INCH,
    TEXT,
    new_figure,
    percent_axis,
    plain_axes,
)
from resting_aspects_ros.report.posed_part import Image, draw_parts, pose_parts
from resting_aspects_ros.report.rounding import (
    interval_of,
    interval_text,
    millimetre_texts,
    probability_text,
)
from resting_aspects_ros.report.rows import Row, class_rows, outside_rows
from resting_aspects_ros.statistics.distribution import Distribution

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a picture is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_SHOWN = 12  # symmetry classes with a bar of their own; the others share one bar

# Sizes in pixels. BESIDE_BAR is the room for the text at the end of the longest bar.
WIDTH = 1240
TOP, BOTTOM, MARGIN = 110, 84, 28
ROW, ROW_OF_MANY, MANY = 164, 116, 6
ROW_WITHOUT_PICTURE, ROW_OF_OTHERS = 92, 64
BAR = 42
MAX_TITLE = 80  # characters
LABEL, BESIDE_BAR = 200, 190


def distribution_figure(
    distribution: Distribution, part: Part | None, title: str, subtitle: str = ''
) -> 'Figure':
    """Plot a bar for each symmetry class, with a picture of the part in it if the part is known.

    If there are more than 12 classes, the 12 most probable are shown, in the order of their
    numbers, and the others share one bar. Outcomes in no aspect have grey bars. Whiskers are the
    intervals. The subtitle can state the conditions.
    """
    # A long title, such as one with surroundings, continues below.
    title, *more = textwrap.wrap(title, MAX_TITLE) or ['']
    subtitle = ' '.join([*more, subtitle]).strip()
    rows = _rows(distribution)
    side = ROW if sum(bool(row.aspects) for row in rows) <= MANY else ROW_OF_MANY
    of_aspect = side if part else ROW_WITHOUT_PICTURE
    sides = [of_aspect if row.aspects else ROW_OF_OTHERS for row in rows]
    room = max(sum(sides), ROW_OF_OTHERS)
    height = TOP + room + BOTTOM
    figure = new_figure(WIDTH / PIXELS_PER_INCH, height / PIXELS_PER_INCH)
    bottoms = [BOTTOM + room - end for end in np.cumsum(sides)]
    left = MARGIN + (side if part else 0)
    if part:
        for bottom, image in zip(bottoms, _images(part, rows, side), strict=False):
            _write_image(figure, image, MARGIN, bottom, height)
    _write_header(figure, title, subtitle, height)
    middles = [bottom + side / 2 for bottom, side in zip(bottoms, sides, strict=True)]
    for row, note, middle in zip(rows, _notes(rows), middles, strict=True):
        _write_label(figure, row.name, note, left, middle, height)
    axes = figure.add_axes(
        (
            (left + LABEL) / WIDTH,
            BOTTOM / height,
            (WIDTH - MARGIN - left - LABEL) / WIDTH,
            room / height,
        )
    )
    _draw_bars(axes, rows, [m - BOTTOM for m in middles], distribution)
    axes.set_ylim(0, room)
    return figure


def _rows(distribution: Distribution) -> list[Row]:
    """Return the rows from top to bottom: classes, the other classes together, other outcomes."""
    rows = class_rows(distribution)
    counts = np.array([row.count for row in rows])
    shown = np.sort(np.argsort(-counts, kind='stable')[:MAX_SHOWN])
    kept = [rows[k] for k in shown]
    if others := sum(len(row.aspects) for row in rows) - sum(len(row.aspects) for row in kept):
        count = int(counts.sum() - counts[shown].sum())
        kept.append(Row(f'{others} other aspects', count, interval_of(distribution, count), GREY))
    return [*kept, *outside_rows(distribution)]


def _notes(rows: Sequence[Row]) -> list[str]:
    """Return the note below the name of each row."""
    heights = millimetre_texts(
        np.array([row.aspects[0].com_height if row.aspects else 0.0 for row in rows])
    )
    return [
        f'{"that look the same" + chr(10) if len(row.aspects) > 1 else ""}'
        f'centre of mass\n{height} mm high'
        if row.aspects
        else ''
        for row, height in zip(rows, heights, strict=True)
    ]


def _images(part: Part, rows: Sequence[Row], side: int) -> list[Image]:
    shown = [row for row in rows if row.aspects]
    posed_parts = pose_parts(part, [row.aspects[0] for row in shown])
    return draw_parts(posed_parts, [rgb(row.colour) for row in shown], side)


def _write_image(figure: 'Figure', image: Image, left: int, bottom: float, height: int) -> None:
    """Draw the image without scaling."""
    side = len(image)
    axes = figure.add_axes((left / WIDTH, bottom / height, side / WIDTH, side / height))
    axes.imshow(image, interpolation='nearest', aspect='auto')
    axes.set_axis_off()


def _write_header(figure: 'Figure', title: str, subtitle: str, height: int) -> None:
    x = MARGIN / WIDTH
    figure.text(
        x,
        1 - 36 / height,
        title,
        size=14,
        weight='bold',
        color=TEXT,
        va='center',
        parse_math=False,
    )
    figure.text(x, 1 - 72 / height, subtitle, size=9, color=FAINT, va='center', parse_math=False)


def _write_label(
    figure: 'Figure', name: str, note: str, left: int, middle: float, height: int
) -> None:
    """Write the name and below it the note, right of ``left`` and centred at ``middle``."""
    x, y = (left + LABEL - 18) / WIDTH, middle / height
    lines = note.count('\n') + 1 if note else 0
    y += 7 * max(lines - 1, 0) / height
    figure.text(
        x,
        y + (2 / height if note else 0),
        name,
        size=10,
        weight='bold',
        color=TEXT,
        ha='right',
        va='bottom' if note else 'center',
    )
    figure.text(
        x, y - 4 / height, note, size=7.5, color=FAINT, ha='right', va='top', linespacing=1.35
    )


def _draw_bars(
    axes: 'Axes', rows: Sequence[Row], middles: Sequence[float], distribution: Distribution
) -> None:
    """Draw bars at the heights ``middles``, pixels, with whiskers and texts, and the axis."""
    for row, middle in zip(rows, middles, strict=True):
        _draw_bar(axes, row, middle, distribution.drops)
    longest = max((row.interval.upper for row in rows), default=1.0)
    room = axes.get_position().width * WIDTH
    axes.set_xlim(0, longest * room / (room - BESIDE_BAR))
    plain_axes(axes, 'x')
    percent_axis(axes, 'x', longest)
    axes.set_yticks([])
    axes.spines['left'].set_visible(True)
    axes.spines['left'].set_color(FAINT)
    axes.set_xlabel(
        f'probability from {distribution.drops} drops, with '
        f'{100 * distribution.confidence:g} % interval ({distribution.interval.capitalize()})',
        size=8,
        color=FAINT,
        loc='left',
        labelpad=8,
    )


def _draw_bar(axes: 'Axes', row: Row, middle: float, drops: int) -> None:
    interval = row.interval
    axes.barh(middle, interval.probability, height=BAR, color=row.colour)
    axes.errorbar(
        interval.probability,
        middle,
        capsize=4,
        color=TEXT,
        elinewidth=1.2,
        capthick=1.2,
        xerr=[[interval.probability - interval.lower], [interval.upper - interval.probability]],
    )
    unseen = 'never seen' if drops else 'no drops'
    text = probability_text(interval) if interval.probability else unseen
    _write_beside(
        axes, interval.upper, middle, 1, text, size=10.5, weight='bold', color=TEXT, va='bottom'
    )
    bounds = interval_text(interval)
    _write_beside(axes, interval.upper, middle, -1.5, bounds, size=7.5, color=FAINT, va='top')


def _write_beside(axes: 'Axes', x: float, y: float, rise: float, text: str, **style: Any) -> None:
    """Write right of a point, ``rise`` points above it, on a background that hides the grid."""
    axes.annotate(
        text,
        (x, y),
        (8, rise),
        textcoords='offset points',
        annotation_clip=False,
        bbox={'facecolor': PAPER, 'edgecolor': 'none', 'pad': 0.8},
        **style,
    )
