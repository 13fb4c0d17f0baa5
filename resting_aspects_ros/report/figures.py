"""Figures of a report: how shares converged, and beside other distributions.

Each is a matplotlib figure; figure_style writes them.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.estimators.estimate import METHODS
from resting_aspects_ros.core.history import Counts
from resting_aspects_ros.core.intervals import Array, Interval
from resting_aspects_ros.report.figure_style import (
    FAINT,
    PAPER,
    TEXT,
    new_figure,
    percent_axis,
    plain_axes,
)
from resting_aspects_ros.report.rounding import probability_text
from resting_aspects_ros.report.rows import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, NARROW = 7.2, 4.1  # inches; the second is for a telephone
MOST_LINES = 10  # more would hide each other
# Of the methods; one form each, so that they differ without colour.
MARKERS = 'osD^vPX'  # in the order of METHODS
# Right of the places of rows, inches.
_RIGHT = 0.25


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
    left, right = 0.5, 1.75  # inches; the names stand right
    axes = figure.add_axes((left / width, 0.14, 1 - (left + right) / width, 0.82))
    plain_axes(axes, 'y')
    most = sorted(range(len(rows)), key=lambda k: -rows[k].count)[:MOST_LINES]
    top = 0.0
    ends = []
    for k in sorted(most):
        own = [after[k] for after in bands]
        lower, upper = ([getattr(each, side) for each in own] for side in ('lower', 'upper'))
        shares = [each.probability for each in own]
        axes.fill_between(drops, lower, upper, color=rows[k].colour, alpha=0.22, linewidth=0)
        axes.plot(drops, shares, color=rows[k].colour, linewidth=1.8)
        top = max(top, *upper[len(upper) // 3 :])
        ends.append((shares[-1], rows[k]))
    axes.set_xscale('log')
    axes.set_xlim(float(drops[0]), float(drops[-1]))
    axes.set_ylim(0, top * 1.02)
    axes.xaxis.set_major_formatter(lambda n, _: f'{n:,.0f}'.replace(',', ' '))
    decades = 10.0 ** np.arange(1, 8)
    # The last one is shown, and no other so near to it that both could not be read.
    axes.set_xticks([*decades[(decades >= drops[0]) & (decades < 0.4 * drops[-1])], drops[-1]])
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
    figure, axes, places = _lying(rows, 0.5, width, 0.35 + 0.2 * lines)
    for row, y in zip(rows, places, strict=True):
        wide = row.interval.upper - row.interval.lower
        axes.barh(y, wide, 0.5, row.interval.lower, color=row.colour, alpha=0.55)
        axes.plot([row.interval.probability] * 2, [y - 0.25, y + 0.25], color=TEXT, linewidth=1.4)
    for name, shares in estimates.items():
        marker = MARKERS[list(METHODS).index(name)]
        axes.plot(
            shares,
            places,
            marker,
            label=name,
            markersize=5,
            markerfacecolor=PAPER,
            markeredgecolor=TEXT,
            markeredgewidth=1.0,
        )
    top = max([row.interval.upper for row in rows] + [float(max(x)) for x in estimates.values()])
    axes.set_xlim(0, top * 1.04)
    percent_axis(axes, 'x', top)
    figure.legend(
        loc='lower left',
        ncols=columns,
        frameon=False,
        fontsize=8,
        labelcolor=TEXT,
        bbox_to_anchor=(0.02, 0.0),
        columnspacing=1.2,
    )
    return figure


def comparison_figure(
    rows: Sequence[Row],
    sides: Mapping[str, Sequence[Interval]],
    differences: Sequence[str],
    width: float = WIDE,
) -> 'Figure':
    """Two distributions side by side, with whiskers, and how far they are apart.

    Parameters
    ----------
    sides : mapping
        By the side's name, the first in full colour and the other one paler: the interval of each
        row.
    differences : sequence of str
        Of each row, what is written beside it.
    """
    figure, axes, places = _lying(rows, 0.62, width, 0.75)
    top = max(each.upper for side in sides.values() for each in side)
    for (name, side), shift, alpha in zip(sides.items(), (-0.2, 0.2), (1.0, 0.45), strict=True):
        shares = np.array([each.probability for each in side])
        lower = shares - [each.lower for each in side]
        upper = [each.upper for each in side] - shares
        axes.barh(places + shift, shares, 0.36, color=[row.colour for row in rows], alpha=alpha)
        axes.errorbar(
            shares,
            places + shift,
            xerr=[np.maximum(lower, 0), np.maximum(upper, 0)],
            fmt='none',
            color=TEXT,
            elinewidth=1.0,
            capsize=3,
        )
        axes.annotate(
            f'{"above" if shift < 0 else "below"}: {name}',
            (0, 0),
            (8, 20 if shift < 0 else 8),
            xycoords='figure fraction',
            textcoords='offset points',
            size=8,
            color=FAINT,
            parse_math=False,
        )
    for k, y in enumerate(places):
        end = max(side[k].upper for side in sides.values())
        axes.annotate(
            differences[k],
            (end, y),
            (8, 0),
            textcoords='offset points',
            size=9,
            weight='bold',
            va='center',
            color=TEXT,
        )
    # As wide as the words beside the longest bar.
    words = 0.1 + 0.083 * max(map(len, differences), default=0)
    place = axes.get_position().width * width
    axes.set_xlim(0, top * place / (place - words))
    percent_axis(axes, 'x', top)
    return figure


def _lying(
    rows: Sequence[Row], inches: float, width: float, below: float
) -> tuple['Figure', 'Axes', Array]:
    """Axes with a place of so many inches for each row, from top to bottom, and its name."""
    height = inches * len(rows) + below + 0.1
    figure = new_figure(width, height)
    left = 0.2 + 0.08 * max((len(row.name) for row in rows), default=0)
    place = 1 - (left + _RIGHT) / width
    axes = figure.add_axes((left / width, below / height, place, 1 - (below + 0.1) / height))
    plain_axes(axes, 'x')
    places = np.arange(len(rows), dtype=np.float64)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(places, [row.name for row in rows])
    axes.tick_params(axis='y', labelcolor=TEXT, labelsize=9)
    return figure, axes, places


def _label_ends(axes: 'Axes', ends: Sequence[tuple[float, Row]], top: float) -> None:
    """Names right of the lines, moved apart where they would lie on each other."""
    apart = 0.062 * top
    y = -np.inf
    for share, row in sorted(ends, key=lambda end: end[0]):
        y = max(share, y + apart)
        axes.plot(
            1.0, y, '>', color=row.colour, transform=axes.get_yaxis_transform(), clip_on=False
        )
        axes.annotate(
            f'{row.name}  {probability_text(row.interval)}',
            (1.0, y),
            (8, 0),
            xycoords=('axes fraction', 'data'),
            textcoords='offset points',
            size=8,
            va='center',
            color=TEXT,
            annotation_clip=False,
        )
