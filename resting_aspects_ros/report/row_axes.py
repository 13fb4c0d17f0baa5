"""Axes of a figure with a place for each row of a report."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from resting_aspects_ros.report.figure_style import TEXT, new_figure, plain_axes
from resting_aspects_ros.report.rows import Row

WIDE, NARROW = 7.2, 4.1  # of a figure, inches; the second is for a telephone
# Right of the places of rows, inches.
_RIGHT = 0.25
# A line of words above a place, inches.
_LINE = 0.24


class RowAxes:
    """A figure with a place for each row, from top to bottom, and its name.

    The names stand left of the places, or where there is no room for that in a line above each.

    Parameters
    ----------
    inches : float
        Height of a place.
    below : float
        Height of what stands below all, inches.

    places : (rows,) float
        Where each is, of the vertical axis.
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
        """A height in units of the vertical axis."""
        return inches / self._pitch

    def write(self, words: Sequence[str], ends: Sequence[float]) -> float:
        """Words for each row, right of where it ends; returns how much room they take, inches."""
        if self._narrow:
            for text, y in zip(words, self.places, strict=True):
                self._in_line(text, 1, y, size=8, weight='bold', ha='right')
            return 0.1
        for text, x, y in zip(words, ends, self.places, strict=True):
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
        return 0.2 + 0.083 * max(map(len, words), default=0)

    def _in_line(self, text: str, x: float, y: float, **style: Any) -> None:
        """Above a place; x from 0 to 1."""
        self.axes.annotate(
            text,
            (x, y),
            (0, 36 * self._inches + 2),
            xycoords=('axes fraction', 'data'),
            textcoords='offset points',
            color=TEXT,
            **style,
        )
