"""A pie chart of the shares, with a picture of the part beside each slice."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.report.colours import rgb
from resting_aspects_ros.report.figure_style import FAINT, PAPER, new_figure
from resting_aspects_ros.report.posed_part import Image
from resting_aspects_ros.report.rows import Row, short_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 5.0, 4.4  # of the figure, inches
# Half the width of the figure in pie radii, with pictures around the pie and without.
REACH, BARE_REACH = 2.0, 1.32
# Slices with a smaller share have their name beside them.
MIN_INSIDE = 0.06
# Maximum number of pictures, for the largest slices: more would overlap.
MAX_PICTURES = 8
# Side of a picture, and distance of its centre from the centre of the pie, in pie radii.
SIDE, DISTANCE = 0.6, 1.42


def pie_figure(rows: Sequence[Row], images: Sequence[Image | None]) -> 'Figure':
    """Draw the shares of all drops as slices, clockwise from the top, with pictures beside them.

    Parameters
    ----------
    rows : sequence of Row
    images : sequence of (p, p, 4) float or None
        The picture of each row. Only the MAX_PICTURES largest slices have their picture.
    """
    figure = new_figure(WIDTH, HEIGHT)
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
    axes.set_ylim(-reach * HEIGHT / WIDTH, reach * HEIGHT / WIDTH)
    places = middles.copy()
    places[pictured] = spread(middles[pictured], 2 * np.arcsin(SIDE / 2 / DISTANCE))
    for k, (row, image) in enumerate(shown):
        x, y = np.cos(middles[k]), np.sin(middles[k])
        inside = shares[k] >= MIN_INSIDE
        if image is not None and pictured[k]:
            at = DISTANCE * np.cos(places[k]), DISTANCE * np.sin(places[k])
            _draw_image(axes, image, *at, SIDE)
            if not inside:
                axes.plot([x, 0.8 * at[0]], [y, 0.8 * at[1]], color=FAINT, linewidth=0.7)
                _write(axes, short_name(row), at[0], at[1] - 0.55 * SIDE, FAINT)
        if inside:
            text = f'{short_name(row)}\n{100 * shares[k]:.0f} %'
            _write(axes, text, 0.66 * x, 0.66 * y, _text_colour_on(row.colour))
    return figure


def spread(angles: Array, min_gap: float) -> Array:
    """Return angles on a circle, descending, moved apart to gaps of ``min_gap`` rad if possible.

    If there is not enough room, the gaps become equal.
    """
    moved = angles.copy()
    if len(moved) < 2:
        return moved
    min_gap = min(min_gap, 2 * np.pi / len(moved))
    for _ in range(200):
        gaps = moved - np.roll(moved, -1)
        gaps[-1] += 2 * np.pi
        lack = np.maximum(min_gap - gaps, 0.0) / 2
        if lack.max() < 1e-3:
            break
        moved += lack - np.roll(lack, 1)
    return moved


def _write(axes: 'Axes', text: str, x: float, y: float, colour: str) -> None:
    axes.text(
        x,
        y,
        text,
        ha='center',
        va='center',
        size=9,
        weight='bold',
        color=colour,
        linespacing=1.25,
    )


def _draw_image(axes: 'Axes', image: Image, x: float, y: float, side: float) -> None:
    axes.imshow(
        image,
        extent=(x - side / 2, x + side / 2, y - side / 2, y + side / 2),
        interpolation='antialiased',
        aspect='auto',
        zorder=3,
    )


def _text_colour_on(colour: str) -> str:
    """Return the text colour, dark or light, with more contrast on a background colour."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb(colour)]
    return '#111111' if np.dot([0.2126, 0.7152, 0.0722], linear) > 0.18 else '#FEFEFE'
