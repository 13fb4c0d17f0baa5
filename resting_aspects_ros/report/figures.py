"""Figures of a report: convergence, analytic estimates, and comparison with other counts.

Each is a matplotlib figure; figure_style writes them to files.
"""

import dataclasses
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.estimate import METHODS
from resting_aspects_ros.report.figure_style import (
    FAINT,
    PAPER,
    TEXT,
    new_figure,
    percent_axis,
    plain_axes,
)
from resting_aspects_ros.report.rounding import probability_text
from resting_aspects_ros.report.row_axes import NARROW, WIDE, RowAxes
from resting_aspects_ros.report.rows import Row, short_name
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LINES = 10  # more lines would hide each other
# A marker shape for each method.
MARKERS = dict(zip(METHODS, 'osD^vPX', strict=True))


def bands(distribution: Distribution, drops: Counts, counts: Counts) -> list[list[Interval]]:
    """Return the interval of each class after each number of drops of a history.

    Confidence and kind of the intervals are those of the distribution.
    """
    return [
        dataclasses.replace(
            distribution,
            counts=row,
            unclassified=int(n - row.sum()),
            unsettled=0,
            failed=0,
            lost=0,
            sliding=0,
        )
        .by_class()
        .intervals()
        for n, row in zip(drops, counts, strict=True)
    ]


def convergence_figure(
    rows: Sequence[Row],
    drops: Counts,
    bands: Sequence[Sequence[Interval]],
    width: float = WIDE,
) -> 'Figure':
    """Plot the share of each row against the number of drops, with its interval as a band.

    Parameters
    ----------
    rows : sequence of Row
        If there are more than MAX_LINES, those with the most drops are shown.
    drops : (m,) int
        Numbers of drops, ascending.
    bands : sequence of sequence of Interval
        The interval of each row, after each number of drops.
    """
    figure = new_figure(width, 3.6)
    shown = sorted(sorted(range(len(rows)), key=lambda k: -rows[k].count)[:MAX_LINES])
    names = {k: short_name(rows[k]) if width <= NARROW else rows[k].name for k in shown}
    labels = {k: f'{names[k]}: {probability_text(rows[k].interval)}' for k in shown}
    left, right = 0.5, 0.25 + 0.07 * max(map(len, labels.values()), default=0)  # inches
    axes = figure.add_axes((left / width, 0.14, 1 - (left + right) / width, 0.82))
    plain_axes(axes, 'y')
    top = 0.0
    ends = []
    for k in shown:
        history = [after[k] for after in bands]
        lower, upper = ([getattr(each, side) for each in history] for side in ('lower', 'upper'))
        shares = [each.probability for each in history]
        axes.fill_between(drops, lower, upper, color=rows[k].colour, alpha=0.22, linewidth=0)
        axes.plot(drops, shares, color=rows[k].colour, linewidth=1.8)
        top = max(top, *upper)
        ends.append((shares[-1], rows[k].colour, labels[k]))
    axes.set_xscale('log')
    axes.set_xlim(float(drops[0]), float(drops[-1]))
    axes.set_ylim(0, top * 1.02)
    axes.xaxis.set_major_formatter(lambda n, _: f'{n:,.0f}'.replace(',', ' '))
    axes.set_xticks(_drop_ticks(drops, width - left - right))
    axes.minorticks_off()
    percent_axis(axes, 'y', top)
    axes.set_xlabel('number of drops', size=8, color=FAINT)
    _label_ends(axes, ends, top)
    return figure


def estimates_figure(
    rows: Sequence[Row], estimates: Mapping[str, Array], width: float = WIDE
) -> 'Figure':
    """Plot the prediction of each method for each row, over the interval of the drops as a bar.

    Parameters
    ----------
    estimates : mapping
        (rows,) probabilities, by the method's name.
    """
    columns = int(width / 1.7)  # of the legend
    lines = -(-len(estimates) // columns)
    row_axes = RowAxes(rows, 0.5, width, 0.4 + 0.2 * lines)
    axes, tall = row_axes.axes, row_axes.data(0.25)
    for row, y in zip(rows, row_axes.places, strict=True):
        wide = row.interval.upper - row.interval.lower
        axes.barh(y, wide, tall, row.interval.lower, color=row.colour, alpha=0.55)
        ends = [y - tall / 2, y + tall / 2]
        axes.plot([row.interval.probability] * 2, ends, color=TEXT, linewidth=1.4)
    for name, shares in estimates.items():
        axes.plot(
            shares,
            row_axes.places,
            MARKERS[name],
            label=METHODS[name].label,
            markersize=5,
            markerfacecolor=PAPER,
            markeredgecolor=TEXT,
            markeredgewidth=1.0,
        )
    top = max([row.interval.upper for row in rows] + [float(max(x)) for x in estimates.values()])
    axes.set_xlim(0, top * 1.04)
    percent_axis(axes, 'x', top)
    row_axes.figure.legend(
        loc='lower left',
        ncols=columns,
        frameon=False,
        fontsize=8,
        labelcolor=TEXT,
        bbox_to_anchor=(0.02, 0.0),
        columnspacing=1.2,
    )
    return row_axes.figure


def comparison_figure(
    rows: Sequence[Row],
    sides: Sequence[tuple[str, Sequence[Interval]]],
    differences: Sequence[str],
    width: float = WIDE,
) -> 'Figure':
    """Plot two distributions as bars with whiskers, and write the differences beside them.

    Parameters
    ----------
    sides : sequence of (str, sequence of Interval)
        Label of each of the two, and the interval of each row. The bars of the second are paler.
    differences : sequence of str
        The text beside each row.
    """
    legend = '\n'.join(
        textwrap.fill(f'{place} bar: {name}', int(width / 0.075))
        for (name, _), place in zip(sides, ('upper', 'lower'), strict=True)
    )
    row_axes = RowAxes(rows, 0.62, width, 0.5 + 0.16 * len(legend.splitlines()))
    row_axes.figure.text(
        0.2 / width, 0.1 / row_axes.height, legend, size=8, color=FAINT, parse_math=False
    )
    axes, tall = row_axes.axes, row_axes.data(0.25)
    both = [side for _, side in sides]
    top = max(each.upper for side in both for each in side)
    for side, shift, alpha in zip(both, (-tall / 2, tall / 2), (1.0, 0.45), strict=True):
        shares = np.array([each.probability for each in side])
        lower = shares - [each.lower for each in side]
        upper = [each.upper for each in side] - shares
        colours = [row.colour for row in rows]
        axes.barh(row_axes.places + shift, shares, 0.9 * tall, color=colours, alpha=alpha)
        axes.errorbar(
            shares,
            row_axes.places + shift,
            xerr=[np.maximum(lower, 0), np.maximum(upper, 0)],
            fmt='none',
            color=TEXT,
            elinewidth=1.0,
            capsize=3,
        )
    ends = [max(each.upper for each in of_row) for of_row in zip(*both, strict=True)]
    text_width = row_axes.write(differences, ends)
    # The axis leaves room for the text beside the longest bar.
    axes_width = axes.get_position().width * width
    axes.set_xlim(0, top * axes_width / (axes_width - text_width))
    percent_axis(axes, 'x', top)
    return row_axes.figure


def _drop_ticks(drops: Counts, inches: float) -> list[float]:
    """Return the ticks of an axis of drops, ``inches`` long: powers of ten, and the last number.

    A tick is omitted if its label would overlap the label of a larger one.
    """
    decades = 10.0 ** np.arange(1, 8)
    inside = decades[(decades >= drops[0]) & (decades < drops[-1])]
    length = math.log10(drops[-1] / drops[0])
    shown = [float(drops[-1])]
    for tick in inside[::-1]:
        room = inches * math.log10(shown[0] / tick) / length
        if room > 0.065 * (len(str(int(tick))) + len(str(int(shown[0])))) / 2 + 0.1:
            shown.insert(0, float(tick))
    return shown


def _label_ends(axes: 'Axes', ends: Sequence[tuple[float, str, str]], top: float) -> None:
    """Write labels right of the lines, moved apart where they would overlap.

    A label that is moved is connected with the end of its line.
    """
    ordered = sorted(ends)
    places = labels_apart(np.array([share for share, _, _ in ordered]), 0.062 * top)
    inches = axes.bbox.width / axes.figure.dpi
    across = axes.get_yaxis_transform()
    for (share, colour, label), place in zip(ordered, places, strict=True):
        line = [1.0, 1.0 + 0.16 / inches], [share, place]
        axes.plot(*line, color=colour, linewidth=1.5, transform=across, clip_on=False)
        axes.text(
            1.0 + 0.2 / inches, place, label, size=8, va='center', color=TEXT, transform=across
        )


def labels_apart(values: Array, gap: float) -> Array:
    """Return ascending values, moved by little to distances of at least ``gap``, none below 0."""
    # With the gaps subtracted, values that are too close decrease, and their mean is their place.
    steps = gap * np.arange(len(values))
    blocks: list[list[float]] = []
    for value in values - steps:
        blocks.append([value])
        while len(blocks) > 1 and np.mean(blocks[-2]) > np.mean(blocks[-1]):
            last = blocks.pop()
            blocks[-1] += last
    fitted = [max(float(np.mean(block)), 0.0) for block in blocks for _ in block]
    return np.array(fitted) + steps
