"""The style of all figures, their axes, and PNG and SVG files."""

import io
import re
import textwrap
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.report.picture import Image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


TEXT, FAINT, GRID, PAPER = '#222226', '#6A6A70', '#E4E4E8', '#FFFFFF'
# CSS variables that replace the colours in a page, which is dark or light; see page.css.
_IN_PAGE = {TEXT: '--ink', FAINT: '--faint', GRID: '--line', PAPER: '--paper'}
PIXELS_PER_INCH = 144.0


def new_figure(width: float, height: float) -> 'Figure':
    """Return an empty figure that needs no display; width and height in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=PIXELS_PER_INCH, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def plain_axes(axes: 'Axes', grid: Literal['x', 'y']) -> None:
    """Style axes with light grid lines for one axis, 'x' or 'y', and without a frame."""
    axes.set_axisbelow(True)
    axes.grid(axis=grid, color=GRID, linewidth=0.8)
    axes.tick_params(length=0, labelsize=8, labelcolor=FAINT)
    axes.spines[['top', 'right', 'bottom', 'left']].set_visible(False)


def percent_axis(axes: 'Axes', name: str, top: float) -> None:
    """Set ticks in percent on an axis, 'x' or 'y', from 0 to the share ``top``."""
    from matplotlib.ticker import MaxNLocator

    axis = getattr(axes, f'{name}axis')
    low, high = getattr(axes, f'get_{name}lim')()
    pixels = axes.bbox.size['xy'.index(name)] * top / (high - low)
    bins = min(max(int(pixels / PIXELS_PER_INCH / 0.6), 1), 5)
    ticks = MaxNLocator(bins, steps=[1, 2, 5, 10]).tick_values(0, top)
    axis.set_ticks([tick for tick in ticks if 0 <= tick <= top * 1.001])
    axis.set_major_formatter(lambda share, _: f'{100 * share:.6g} %')


def png_bytes(figure: 'Figure') -> bytes:
    """Return the figure as a PNG file."""
    file = io.BytesIO()
    figure.savefig(file, format='png', dpi=PIXELS_PER_INCH)
    return file.getvalue()


def svg_text(figure: 'Figure') -> str:
    """Return the figure as an SVG file with text as text; equal figures give equal files."""
    import matplotlib as mpl

    file = io.StringIO()
    with mpl.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'resting_aspects_ros'}):
        figure.savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    return file.getvalue()


def inline_svg(svg: str, name: str, label: str) -> str:
    """Return an SVG file as an element of a page, in the colours of the page.

    ``name`` is the prefix of the ids, unique for each figure of the page: letters and '-'.
    ``label`` is the alternative text for screen readers, without XML special characters.
    """
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(|href=")#', rf'\1#{name}-', svg)
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    for colour, variable in _IN_PAGE.items():
        svg = re.sub(f'{colour}\\b', f'var({variable})', svg, flags=re.IGNORECASE)
    # Without width and height it fills its container and keeps its aspect ratio.
    svg = re.sub(r'(<svg [^>]*?) width="[^"]*"', r'\1', svg, count=1)
    svg = re.sub(r'(<svg [^>]*?) height="[^"]*"', r'\1', svg, count=1)
    return svg.replace('<svg ', f'<svg role="img" aria-label="{label}" ', 1)


WIDE, NARROW = 7.2, 4.1  # widths of a figure, inches; NARROW is for a mobile phone


def labels_apart(values: Array, gap: float, low: float = 0.0, high: float = np.inf) -> Array:
    """Return ascending values, moved by little to distances of at least ``gap``.

    They are from ``low`` to ``high``, between which there is room for all of them.
    """
    # With the gaps subtracted, values that are too close decrease, and their mean is their place.
    steps = gap * np.arange(len(values))
    blocks: list[list[float]] = []
    for value in values - steps:
        blocks.append([value])
        while len(blocks) > 1 and np.mean(blocks[-2]) > np.mean(blocks[-1]):
            last = blocks.pop()
            blocks[-1] += last
    fitted = np.array([float(np.mean(block)) for block in blocks for _ in block])
    return np.clip(fitted, low, high - steps.max(initial=0.0)) + steps


MARGIN = 28
# Widths of the mean characters of a title and a note, and heights of their lines, pixels.
_TITLE_CHARACTER, _NOTE_CHARACTER = 15.5, 8.4
_TITLE_LINE, _NOTE_LINE = 32, 22


def pixel_axes(width: int, height: int) -> 'tuple[Figure, Axes]':
    """Return a figure and its invisible axes, from (0, 0) at the lower left to (width, height)."""
    figure = new_figure(width / PIXELS_PER_INCH, height / PIXELS_PER_INCH)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    axes.set_axis_off()
    return figure, axes


def draw_image(axes: 'Axes', image: Image, x: float, y: float) -> None:
    """Draw the image without scaling; (x, y) is its centre."""
    high, wide = image.shape[:2]
    left, bottom = round(x - wide / 2), round(y - high / 2)
    limits = axes.get_xlim(), axes.get_ylim()
    extent = (left, left + wide, bottom, bottom + high)
    axes.imshow(image, extent=extent, interpolation='nearest', aspect='auto', zorder=3)
    axes.set(xlim=limits[0], ylim=limits[1])  # imshow changes them


class Header:
    """The title of a figure and below it a note, wrapped to the width of the figure."""

    def __init__(self, title: str, note: str, width: int) -> None:
        room = width - 2 * MARGIN
        self._title = _wrapped(title, int(room / _TITLE_CHARACTER))
        self._note = _wrapped(note, int(room / _NOTE_CHARACTER))
        self._below = MARGIN + _TITLE_LINE * len(self._title.splitlines())
        self.height = self._below + _NOTE_LINE * len(self._note.splitlines())

    def draw(self, axes: 'Axes') -> None:
        """Write both into the upper left corner."""
        top = axes.get_ylim()[1]
        style: dict[str, Any] = {'va': 'top', 'parse_math': False}
        axes.text(MARGIN, top - MARGIN, self._title, size=12, weight='bold', color=TEXT, **style)
        axes.text(MARGIN, top - self._below, self._note, size=8, color=FAINT, **style)


def _wrapped(text: str, columns: int) -> str:
    return '\n'.join(textwrap.fill(line, columns) for line in text.splitlines())
