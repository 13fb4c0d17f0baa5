"""Shares as a pie, with a picture beside each slice."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.report.colours import rgb
from resting_aspects_ros.report.figure_style import FAINT, PAPER, new_figure
from resting_aspects_ros.report.posed_part import Image
from resting_aspects_ros.report.rows import Row, short_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, HIGH = 5.0, 4.4  # of a pie
# Radii that a pie's figure is wide to each side, with pictures around it and without.
REACH, BARE_REACH = 2.0, 1.32
# Slices of less have their name beside them.
MIN_INSIDE = 0.06
# Pictures, of the largest slices: more would lie on each other.
MAX_PICTURES = 8
# Of a picture, and how far from the middle it is, radii.
SIDE, OUT = 0.6, 1.42


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
    pictured = np.zeros(len(shown), dtype=bool)
    pictured[np.argsort(-shares, kind='stable')[:MAX_PICTURES]] = True
    pictured &= [image is not None for _, image in shown]
    reach = REACH if pictured.any() else BARE_REACH
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach * HIGH / WIDE, reach * HIGH / WIDE)
    places = middles.copy()
    places[pictured] = spread(middles[pictured], 2 * np.arcsin(SIDE / 2 / OUT))
    for k, (row, image) in enumerate(shown):
        x, y = np.cos(middles[k]), np.sin(middles[k])
        inside = shares[k] >= MIN_INSIDE
        if image is not None and pictured[k]:
            at = OUT * np.cos(places[k]), OUT * np.sin(places[k])
            _place(axes, image, *at, SIDE)
            if not inside:
                axes.plot([x, 0.8 * at[0]], [y, 0.8 * at[1]], color=FAINT, linewidth=0.7)
                _name(axes, short_name(row), at[0], at[1] - 0.55 * SIDE, FAINT)
        if inside:
            words = f'{short_name(row)}\n{100 * shares[k]:.0f} %'
            _name(axes, words, 0.66 * x, 0.66 * y, _ink_on(row.colour))
    return figure


def spread(angles: Array, least: float) -> Array:
    """Angles on a circle, descending, moved apart to at least so many rad, if there is room."""
    found = angles.copy()
    if len(found) < 2:
        return found
    least = min(least, 2 * np.pi / len(found))
    for _ in range(200):
        gaps = found - np.roll(found, -1)
        gaps[-1] += 2 * np.pi
        lack = np.maximum(least - gaps, 0.0) / 2
        if lack.max() < 1e-3:
            break
        found += lack - np.roll(lack, 1)
    return found


def _name(axes: 'Axes', words: str, x: float, y: float, colour: str) -> None:
    axes.text(
        x,
        y,
        words,
        ha='center',
        va='center',
        size=9,
        weight='bold',
        color=colour,
        linespacing=1.25,
    )


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
