"""Figures of a report: how shares converged, and beside other distributions.

Each is a matplotlib figure; figure_style writes them.
"""

import dataclasses
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.estimators.estimate import METHODS
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import Array, Counts, Interval
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LINES = 10  # more would hide each other
# Of the methods; one form each, so that they differ without colour.
MARKERS = 'osD^vPX'  # in the order of METHODS


def bands(distribution: Distribution, drops: Counts, counts: Counts) -> list[list[Interval]]:
    """After each number of drops of a history the interval of each class, as of the last."""
    return [
        dataclasses.replace(
            distribution, counts=row, unclassified=int(n - row.sum()), unsettled=0, failed=0
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
    """Share of each row after growing numbers of drops, with its interval as a band.

    Parameters
    ----------
    rows : sequence of Row
        Of many those with the most drops are shown.
    drops : (m,) int
        Ascending.
    bands : sequence of sequence of Interval
        After each number of drops, of each row.
    """
    figure = new_figure(width, 3.6)
    most = sorted(sorted(range(len(rows)), key=lambda k: -rows[k].count)[:MAX_LINES])
    names = {k: short_name(rows[k]) if width <= NARROW else rows[k].name for k in most}
    labels = {k: f'{names[k]}: {probability_text(rows[k].interval)}' for k in most}
    left, right = 0.5, 0.25 + 0.07 * max(map(len, labels.values()), default=0)  # inches
    axes = figure.add_axes((left / width, 0.14, 1 - (left + right) / width, 0.82))
    plain_axes(axes, 'y')
    top = 0.0
    ends = []
    for k in most:
        own = [after[k] for after in bands]
        lower, upper = ([getattr(each, side) for each in own] for side in ('lower', 'upper'))
        shares = [each.probability for each in own]
        axes.fill_between(drops, lower, upper, color=rows[k].colour, alpha=0.22, linewidth=0)
        axes.plot(drops, shares, color=rows[k].colour, linewidth=1.8)
        top = max(top, *upper[len(upper) // 3 :])
        ends.append((shares[-1], rows[k].colour, labels[k]))
    axes.set_xscale('log')
    axes.set_xlim(float(drops[0]), float(drops[-1]))
    axes.set_ylim(0, top * 1.02)
    axes.xaxis.set_major_formatter(lambda n, _: f'{n:,.0f}'.replace(',', ' '))
    axes.set_xticks(_drop_ticks(drops, width - left - right))
    axes.minorticks_off()
    percent_axis(axes, 'y', top)
    axes.set_xlabel('drops', size=8, color=FAINT)
    _label_ends(axes, ends, top)
    return figure


def estimates_figure(
    rows: Sequence[Row], estimates: Mapping[str, Array], width: float = WIDE
) -> 'Figure':
    """What each method predicts for each row, over the interval of the drops as a bar.

    Parameters
    ----------
    estimates : mapping
        By the method's name, (rows,) probabilities.
    """
    columns = int(width / 1.7)  # of the legend
    lines = -(-len(estimates) // columns)
    lying = RowAxes(rows, 0.5, width, 0.4 + 0.2 * lines)
    axes, tall = lying.axes, lying.data(0.25)
    for row, y in zip(rows, lying.places, strict=True):
        wide = row.interval.upper - row.interval.lower
        axes.barh(y, wide, tall, row.interval.lower, color=row.colour, alpha=0.55)
        ends = [y - tall / 2, y + tall / 2]
        axes.plot([row.interval.probability] * 2, ends, color=TEXT, linewidth=1.4)
    for name, shares in estimates.items():
        marker = MARKERS[list(METHODS).index(name)]
        axes.plot(
            shares,
            lying.places,
            marker,
            label=METHODS[name].label,
            markersize=5,
            markerfacecolor=PAPER,
            markeredgecolor=TEXT,
            markeredgewidth=1.0,
        )
    top = max([row.interval.upper for row in rows] + [float(max(x)) for x in estimates.values()])
    axes.set_xlim(0, top * 1.04)
    percent_axis(axes, 'x', top)
    lying.figure.legend(
        loc='lower left',
        ncols=columns,
        frameon=False,
        fontsize=8,
        labelcolor=TEXT,
        bbox_to_anchor=(0.02, 0.0),
        columnspacing=1.2,
    )
    return lying.figure


def comparison_figure(
    rows: Sequence[Row],
    sides: Sequence[tuple[str, Sequence[Interval]]],
    differences: Sequence[str],
    width: float = WIDE,
) -> 'Figure':
    """Two distributions side by side, with whiskers, and how far they are apart.

    Parameters
    ----------
    sides : sequence of (str, sequence of Interval)
        Name of each of the two, the first in full colour and the other one paler, and the interval
        of each row.
    differences : sequence of str
        Of each row, what is written beside it.
    """
    said = '\n'.join(
        textwrap.fill(f'{place}: {name}', int(width / 0.075))
        for (name, _), place in zip(sides, ('above', 'below'), strict=True)
    )
    lying = RowAxes(rows, 0.62, width, 0.5 + 0.16 * len(said.splitlines()))
    lying.figure.text(0.2 / width, 0.1 / lying.height, said, size=8, color=FAINT, parse_math=False)
    axes, tall = lying.axes, lying.data(0.25)
    both = [side for _, side in sides]
    top = max(each.upper for side in both for each in side)
    for side, shift, alpha in zip(both, (-tall / 2, tall / 2), (1.0, 0.45), strict=True):
        shares = np.array([each.probability for each in side])
        lower = shares - [each.lower for each in side]
        upper = [each.upper for each in side] - shares
        colours = [row.colour for row in rows]
        axes.barh(lying.places + shift, shares, 0.9 * tall, color=colours, alpha=alpha)
        axes.errorbar(
            shares,
            lying.places + shift,
            xerr=[np.maximum(lower, 0), np.maximum(upper, 0)],
            fmt='none',
            color=TEXT,
            elinewidth=1.0,
            capsize=3,
        )
    ends = [max(each.upper for each in of_row) for of_row in zip(*both, strict=True)]
    beside = lying.write(differences, ends)
    # As wide as the words beside the longest bar.
    place = axes.get_position().width * width
    axes.set_xlim(0, top * place / (place - beside))
    percent_axis(axes, 'x', top)
    return lying.figure


def _drop_ticks(drops: Counts, inches: float) -> list[float]:
    """Numbers of drops to be written below an axis of so many inches: powers of ten, and the last.

    Of those that would lie on each other the later ones.
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
    """Words right of the lines, moved apart where they would lie on each other."""
    apart = 0.062 * top
    y = -np.inf
    for share, colour, label in sorted(ends):
        y = max(share, y + apart)
        axes.plot(1.0, y, '>', color=colour, transform=axes.get_yaxis_transform(), clip_on=False)
        axes.annotate(
            label,
            (1.0, y),
            (8, 0),
            xycoords=('axes fraction', 'data'),
            textcoords='offset points',
            size=8,
            va='center',
            color=TEXT,
            annotation_clip=False,
        )
