"""Axes that fill a figure and whose units are pixels, for figures that consist of pictures."""

import textwrap
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.report.figure_style import FAINT, PIXELS_PER_INCH, TEXT, new_figure
from resting_aspects_ros.report.posed_part import Image

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN = 28
# Sizes of the texts, points, and the widths of their mean characters, pixels.
TITLE_SIZE, NOTE_SIZE = 12.0, 8.0
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
        self.height = (
            MARGIN + _TITLE_LINE * self._lines(self._title) + _NOTE_LINE * self._lines(self._note)
        )

    def draw(self, axes: 'Axes') -> None:
        """Write both into the upper left corner."""
        top = axes.get_ylim()[1] - MARGIN
        style: dict[str, Any] = {'va': 'top', 'parse_math': False}
        axes.text(MARGIN, top, self._title, size=TITLE_SIZE, weight='bold', color=TEXT, **style)
        axes.text(
            MARGIN,
            top - _TITLE_LINE * self._lines(self._title),
            self._note,
            size=NOTE_SIZE,
            color=FAINT,
            **style,
        )

    @staticmethod
    def _lines(text: str) -> int:
        return text.count('\n') + 1 if text else 0


def _wrapped(text: str, columns: int) -> str:
    return '\n'.join(textwrap.fill(line, columns) for line in text.splitlines())
