"""A distribution as a picture: a bar for each aspect, and the part lying that way beside it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.core.aspect_set import Aspect
from resting_aspects_ros.core.distribution import Distribution, Interval
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.portrait import Image, portraits
from resting_aspects_ros.report.rounding import (
    interval_of,
    interval_text,
    millimetre_texts,
    outside_aspects,
    probability_text,
)

if TYPE_CHECKING:  # matplotlib takes half a second: imported when a picture is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The first seven are Okabe and Ito's (2008). Any two, and the grey, differ by more than 10 in
# CIELAB also to people who see no red or no green.
COLOURS = (
    '#0072B2',
    '#E69F00',
    '#009E73',
    '#D55E00',
    '#56B4E9',
    '#CC79A7',
    '#F0E442',
    '#882255',
    '#B9D98B',
    '#4A3FD0',
)
GREY = '#B8B8B8'  # what is in no aspect
TEXT, FAINT, GRID = '#222226', '#6A6A70', '#E4E4E8'

MOST_SHOWN = 12  # aspects with a bar of their own; the others share one

# Pixels. Beside the bars is room for what is written at the end of the longest.
WIDTH = 1240
TOP, BOTTOM, MARGIN = 110, 84, 28
ROW, ROW_OF_MANY, MANY = 164, 116, 6
ROW_WITHOUT_PICTURE, ROW_OF_OTHERS = 92, 64
BAR = 42
LABEL, BESIDE_BAR = 182, 190
PIXELS_PER_INCH = 144.0


@dataclass(frozen=True, eq=False)
class _Row:
    """One bar, with what stands beside it; without a picture it is grey, or has no part."""

    label: str
    note: str
    interval: Interval
    colour: str
    aspect: Aspect | None


def save_picture(
    distribution: Distribution, part: Part | None, path: Path, title: str, subtitle: str = ''
) -> Path:
    """Write a PNG with a bar for each aspect, its interval, and the part as it lies in it.

    Of more than 12 aspects the 12 most probable are shown, by id, and the others as one bar.
    What is in no aspect has a grey bar. Whiskers are the intervals.

    Parameters
    ----------
    distribution : Distribution
    part : Part or None
        Its shape; None if that is not known: the picture has bars only.
    path : Path
        Written over if it is there.
    title, subtitle : str
        Plain text; the subtitle is the place for the conditions.

    Returns
    -------
    Path
        ``path``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = _rows(distribution)
    side = ROW if sum(row.aspect is not None for row in rows) <= MANY else ROW_OF_MANY
    of_aspect = side if part else ROW_WITHOUT_PICTURE
    sides = [of_aspect if row.aspect else ROW_OF_OTHERS for row in rows]
    room = max(sum(sides), ROW_OF_OTHERS)
    height = TOP + room + BOTTOM
    figure = Figure(
        figsize=(WIDTH / PIXELS_PER_INCH, height / PIXELS_PER_INCH),
        dpi=PIXELS_PER_INCH,
        facecolor='white',
    )
    FigureCanvasAgg(figure)
    bottoms = [BOTTOM + room - end for end in np.cumsum(sides)]
    left = MARGIN + (side if part else 0)
    if part:
        for bottom, image in zip(bottoms, _images(part, rows, side), strict=False):
            figure.figimage(image, MARGIN, bottom, origin='upper')
    _write_header(figure, title, subtitle, height)
    middles = [bottom + side / 2 for bottom, side in zip(bottoms, sides, strict=True)]
    for row, middle in zip(rows, middles, strict=True):
        _write_label(figure, row, left, middle, height)
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
    figure.savefig(path, format='png', dpi=PIXELS_PER_INCH)
    return path


def aspect_colour(aspect_id: int) -> str:
    """The colour of an aspect in every picture, '#RRGGBB'; they repeat after ten."""
    return COLOURS[(aspect_id - 1) % len(COLOURS)]


def _rows(distribution: Distribution) -> list[_Row]:
    """From top to bottom: aspects by id, other aspects together, what is in none."""
    counts = distribution.counts
    shown = np.sort(np.argsort(-counts, kind='stable')[:MOST_SHOWN])
    aspects = distribution.aspects.aspects
    heights = millimetre_texts(np.array([aspect.com_height for aspect in aspects]))
    intervals = distribution.intervals()
    rows = [
        _Row(
            f'aspect {aspects[i].id}',
            f'centre of mass\n{heights[i]} mm high',
            intervals[i],
            aspect_colour(aspects[i].id),
            aspects[i],
        )
        for i in shown
    ]
    others = len(aspects) - len(shown)
    if others:
        together = interval_of(distribution, int(counts.sum() - counts[shown].sum()))
        rows.append(_Row(f'{others} more aspects', 'together', together, GREY, None))
    for name, count in outside_aspects(distribution):
        rows.append(_Row(name, '', interval_of(distribution, count), GREY, None))
    return rows


def _images(part: Part, rows: Sequence[_Row], side: int) -> list[Image]:
    from matplotlib.colors import to_rgb

    aspects = [row.aspect for row in rows if row.aspect]
    colours = [to_rgb(row.colour) for row in rows if row.aspect]
    return portraits(part, aspects, colours, side)


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


def _write_label(figure: 'Figure', row: _Row, left: int, middle: float, height: int) -> None:
    x, y = (left + LABEL - 18) / WIDTH, middle / height
    figure.text(
        x,
        y + (2 / height if row.note else 0),
        row.label,
        size=10,
        weight='bold',
        color=TEXT,
        ha='right',
        va='bottom' if row.note else 'center',
    )
    figure.text(
        x, y - 4 / height, row.note, size=7.5, color=FAINT, ha='right', va='top', linespacing=1.35
    )


def _draw_bars(
    axes: 'Axes', rows: Sequence[_Row], middles: Sequence[float], distribution: Distribution
) -> None:
    """Bars at heights ``middles``, pixels, with whiskers and words; the axis is in percent."""
    from matplotlib.ticker import MaxNLocator

    for row, middle in zip(rows, middles, strict=True):
        _draw_bar(axes, row, middle, distribution.drops)
    longest = max((row.interval.upper for row in rows), default=1.0)
    room = axes.get_position().width * WIDTH
    axes.set_xlim(0, longest * room / (room - BESIDE_BAR))
    ticks = MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0, longest)
    axes.set_xticks([tick for tick in ticks if tick <= longest])
    axes.xaxis.set_major_formatter(lambda share, _: f'{100 * share:.6g} %')
    axes.set_yticks([])
    axes.set_axisbelow(True)
    axes.grid(axis='x', color=GRID, linewidth=0.8)
    axes.tick_params(axis='x', length=0, labelsize=8, labelcolor=FAINT)
    axes.spines[['top', 'right', 'bottom']].set_visible(False)
    axes.spines['left'].set_color(FAINT)
    axes.set_xlabel(
        f'probability in {distribution.drops} drops, with its '
        f'{100 * distribution.confidence:g} % interval ({distribution.interval.capitalize()})',
        size=8,
        color=FAINT,
        loc='left',
        labelpad=8,
    )


def _draw_bar(axes: 'Axes', row: _Row, middle: float, drops: int) -> None:
    found = row.interval
    axes.barh(middle, found.probability, height=BAR, color=row.colour)
    axes.errorbar(
        found.probability,
        middle,
        capsize=4,
        color=TEXT,
        elinewidth=1.2,
        capthick=1.2,
        xerr=[[found.probability - found.lower], [found.upper - found.probability]],
    )
    words = probability_text(found) if found.probability else 'not seen' if drops else 'no drops'
    _write_beside(
        axes, found.upper, middle, 1, words, size=10.5, weight='bold', color=TEXT, va='bottom'
    )
    _write_beside(
        axes, found.upper, middle, -1.5, interval_text(found), size=7.5, color=FAINT, va='top'
    )


def _write_beside(axes: 'Axes', x: float, y: float, rise: float, words: str, **style: Any) -> None:
    """Write to the right of a point, ``rise`` points above it, and over the lines of the grid."""
    axes.annotate(
        words,
        (x, y),
        (8, rise),
        textcoords='offset points',
        annotation_clip=False,
        bbox={'facecolor': 'white', 'edgecolor': 'none', 'pad': 0.8},
        **style,
    )
