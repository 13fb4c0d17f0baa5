"""Shares as a pie, with a picture beside each slice."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.report.colours import rgb
from resting_aspects_ros.report.figure_style import FAINT, PAPER, new_figure
from resting_aspects_ros.report.portrait import Image
from resting_aspects_ros.report.rows import Row, short_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, HIGH = 5.0, 4.4  # of a pie
# Radii that a pie's figure is wide to each side, with pictures around it and without.
REACH, BARE_REACH = 1.84, 1.32
# Slices of less have no words, and of less than twice this no picture: they would lie on each
# other.
LEAST_SLICE = 0.03
# Pictures around a pie of more slices would be too small.
MOST_PICTURES = 8


def pie_figure(rows: Sequence[Row], images: Sequence[Image | None]) -> 'Figure':
    """Shares of all drops as slices, clockwise from the top, with a picture beside each.

    Parameters
    ----------
    rows : sequence of Row
    images : sequence of (p, p, 4) float or None
        What lies beside each slice; none are shown beside many.
    """
    figure = new_figure(WIDE, HIGH)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    shown = [(row, image) for row, image in zip(rows, images, strict=True) if row.count]
    if not shown:
        axes.set_axis_off()
        axes.text(0.5, 0.5, 'no drops', ha='center', va='center', color=FAINT)
        return figure
    shares = np.array([row.interval.probability for row, _ in shown])
    axes.pie(
        shares,
        colors=[row.colour for row, _ in shown],
        startangle=90,
        counterclock=False,
        wedgeprops={'edgecolor': PAPER, 'linewidth': 1.2 if len(shown) > 1 else 0},
        radius=1.0,
        frame=True,
    )
    axes.set_axis_off()
    middles = np.pi / 2 - 2 * np.pi * (np.cumsum(shares) - shares / 2)
    large = shares >= LEAST_SLICE
    pictured = large.sum() <= MOST_PICTURES and any(image is not None for _, image in shown)
    reach = REACH if pictured else BARE_REACH
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach * HIGH / WIDE, reach * HIGH / WIDE)
    for (row, image), share, middle, big in zip(shown, shares, middles, large, strict=True):
        if not big:
            continue
        x, y = np.cos(middle), np.sin(middle)
        inside = share >= 2 * LEAST_SLICE
        if image is not None and pictured and inside:
            _place(axes, image, 1.46 * x, 1.32 * y, 0.70)
        out = 0.66 if inside else 1.12
        axes.text(
            out * x,
            out * y,
            f'{short_name(row)}\n{100 * share:.0f} %' if inside else short_name(row),
            ha='center',
            va='center',
            size=9,
            weight='bold',
            color=_ink_on(row.colour) if inside else FAINT,
            linespacing=1.25,
        )
    return figure


def _place(axes: 'Axes', image: Image, x: float, y: float, wide: float) -> None:
    axes.imshow(
        image,
        extent=(x - wide / 2, x + wide / 2, y - wide / 2, y + wide / 2),
        interpolation='antialiased',
        aspect='auto',
        zorder=3,
    )


def _ink_on(colour: str) -> str:
    """Dark or light, whichever is read better on a colour: by its luminance."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb(colour)]
    return '#111111' if np.dot([0.2126, 0.7152, 0.0722], linear) > 0.18 else '#FEFEFE'
