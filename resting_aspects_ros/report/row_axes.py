"""Axes of a figure with one horizontal band for each row of a report."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from resting_aspects_ros.report.figure_style import TEXT, new_figure, plain_axes
from resting_aspects_ros.report.rows import Row

WIDE, NARROW = 7.2, 4.1  # widths of a figure, inches; NARROW is for a mobile phone
# Margin on the right, inches.
_RIGHT = 0.25
# Height of the line of text above a band in a narrow figure, inches.
_LINE = 0.24


class RowAxes:
    """A figure with a named horizontal band for each row, from top to bottom.

    The names are left of the bands, or in a narrow figure in a line above each band.

    Parameters
    ----------
    inches : float
        Height of a band.
    below : float
        Height of the space below all bands, inches.

    places : (rows,) float
        Centre of each band on the vertical axis.
    """

    def __init__(self, rows: Sequence[Row], inches: float, width: float, below: float) -> None:
        self._narrow = width <= NARROW
        self._inches = inches
        self._pitch = inches + (_LINE if self._narrow else 0.0)
        self.height = self._pitch * len(rows) + below + 0.1
        self.figure = new_figure(width, self.height)
        names = [row.name for row in rows]
        left = 0.2 + (0.0 if self._narrow else 0.08 * max(map(len, names), default=0))
        place = 1 - (left + _RIGHT) / width
        bottom, top = below / self.height, 0.1 / self.height
        self.axes = self.figure.add_axes((left / width, bottom, place, 1 - bottom - top))
        plain_axes(self.axes, 'x')
        self.places = np.arange(len(rows), dtype=np.float64)
        half = self.data(inches / 2)
        self.axes.set_ylim(len(rows) - 1 + half, half - 1)
        self.axes.set_yticks(self.places, [''] * len(rows) if self._narrow else names)
        self.axes.tick_params(axis='y', labelcolor=TEXT, labelsize=9)
        if self._narrow:
            for name, y in zip(names, self.places, strict=True):
                self._in_line(name, 0, y, size=9)

    def data(self, inches: float) -> float:
        """Convert a height from inches to units of the vertical axis."""
        return inches / self._pitch

    def write(self, texts: Sequence[str], ends: Sequence[float]) -> float:
        """Write a text right of the end of each row, and return the width that it needs, inches.

        In a narrow figure the text is in the line above the band.
        """
        if self._narrow:
            for text, y in zip(texts, self.places, strict=True):
                self._in_line(text, 1, y, size=8, weight='bold', ha='right')
            return 0.1
        for text, x, y in zip(texts, ends, self.places, strict=True):
            self.axes.annotate(
                text,
                (x, y),
                (8, 0),
                textcoords='offset points',
                size=9,
                weight='bold',
                va='center',
                color=TEXT,
            )
        return 0.2 + 0.083 * max(map(len, texts), default=0)

    def _in_line(self, text: str, x: float, y: float, **style: Any) -> None:
        """Write into the line above the band at ``y``; ``x`` is a fraction of the width."""
        self.axes.annotate(
            text,
            (x, y),
            (0, 36 * self._inches + 2),
            xycoords=('axes fraction', 'data'),
            textcoords='offset points',
            color=TEXT,
            **style,
        )
