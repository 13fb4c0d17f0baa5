"""The heat map of a transition matrix, with pictures of the part on both axes."""

import dataclasses
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.aspect_groups import (
    Group,
    aspect_groups,
    group_images,
    membership,
)
from resting_aspects_ros.report.colours import rgb
from resting_aspects_ros.report.figure_style import FAINT, TEXT
from resting_aspects_ros.report.pixel_axes import MARGIN, Header, draw_image, pixel_axes
from resting_aspects_ros.report.posed_part import Image
from resting_aspects_ros.report.rounding import decimals_of
from resting_aspects_ros.report.transition_table import OUTCOME_HEADINGS
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Sizes in pixels. GAP separates the outcomes from the aspects, BESIDE a name from what it names.
CELL, CELL_OF_MANY, MANY = 116, 96, 6
GAP, BESIDE = 14, 10
NAMES, ACTIONS, LINE = 110, 130, 24
MIN_WIDTH = 700
# Colours of the probabilities 0 and 1, and of texts in cells. They are not those of figure_style,
# which change on a dark page.
PALE, DEEP = '#F3F6FA', '#0A4A7C'
PALE_OUTCOME, DEEP_OUTCOME = '#F4F4F4', '#4A4A4A'
DARK_TEXT, LIGHT_TEXT = '#1A1A1E', '#FAFAFA'
# Texts in cells of a higher probability are light.
LIGHT_FROM = 0.65
# Decimals of a percentage, so that its interval fits into a cell.
MAX_DECIMALS = 2


def transition_figure(matrix: TransitionMatrix, part: Part | None, title: str) -> 'Figure':
    """Plot the probability and its interval from each aspect (row) to each aspect (column).

    If there are more than 12 aspects, rows and columns are symmetry classes. If there are also
    more than 12 classes, those to which most actions lead are shown, and the others share a row
    and a column. Outcomes in no aspect have columns if they occurred.

    Parameters
    ----------
    matrix : TransitionMatrix
        By aspect.
    part : Part or None
        Without the part, the figure has no pictures.
    title : str
        Without a title, the figure has no explanation either; see transition_note.
    """
    groups = _groups(matrix)
    grouped = _grouped(matrix, groups)
    outcomes = [j for j in range(len(OUTCOMES)) if grouped.counts[:, len(groups) + j].any()]
    columns = len(groups) + len(outcomes)
    side = CELL if columns <= MANY else CELL_OF_MANY
    left = MARGIN + NAMES + (side if part else 0) + BESIDE
    width = left + side * columns + GAP * bool(outcomes) + ACTIONS + MARGIN
    width = max(width, MIN_WIDTH)
    header = Header(title, transition_note(matrix) if title else '', width)
    lines = max((_name(group.name).count('\n') + 1 for group in groups), default=1)
    above = (side if part else 0) + LINE * max(lines, 2) + 2 * BESIDE
    figure, axes = pixel_axes(width, header.height + above + side * len(groups) + MARGIN)
    header.draw(axes)
    x = left + side * np.arange(0.5, columns, dtype=np.float64)
    x[len(groups) :] += GAP
    y = MARGIN + side * np.arange(0.5, len(groups), dtype=np.float64)[::-1]
    _draw_axes(axes, groups, group_images(part, groups, side), (x, y), side)
    top = MARGIN + side * len(groups) + BESIDE
    for j, place in zip(outcomes, x[len(groups) :], strict=True):
        _write(axes, OUTCOME_HEADINGS[OUTCOMES[j]], place, top, ha='center', va='bottom')
    shown = [*range(len(groups)), *(len(groups) + j for j in outcomes)]
    _draw_cells(axes, grouped, shown, (x, y), side)
    for n, place in zip(grouped.actions.tolist(), y, strict=True):
        text = f'{n:,} actions'.replace(',', ' ')
        axes.text(x[-1] + side / 2 + BESIDE, place, text, size=7, color=FAINT, va='center')
    return figure


def _grouped(matrix: TransitionMatrix, groups: Sequence[Group]) -> TransitionMatrix:
    """Return the matrix over the groups: rows and columns are summed, as by_class does."""
    k = len(matrix.aspects)
    member = membership(groups, k).astype(np.int64)
    counts = member @ matrix.counts
    inside = counts[:, :k] @ member.T
    return dataclasses.replace(matrix, counts=np.hstack([inside, counts[:, k:]]))


def transition_note(matrix: TransitionMatrix) -> str:
    """Return the text that explains the figure."""
    note = (
        'Probability in % that one action takes a part from the aspect of the row to the aspect '
        f'of the column, with {100 * matrix.confidence:g} % interval '
        f'({matrix.interval.capitalize()}).'
    )
    if others := [group for group in _groups(matrix) if not group.alike]:
        note += (
            f' The aspects to which most actions lead are shown; {len(others[0].aspects)} others '
            'share a row and a column.'
        )
    return note


def _groups(matrix: TransitionMatrix) -> list[Group]:
    arrivals = matrix.counts[:, : len(matrix.aspects)].sum(axis=0)
    return aspect_groups(matrix.aspects, arrivals.astype(float))


def _draw_axes(
    axes: 'Axes',
    groups: Sequence[Group],
    images: Sequence[Image | None],
    places: tuple[Array, Array],
    side: int,
) -> None:
    """Draw picture and name of each group left of its row and above its column."""
    x, y = places
    left, top = x[0] - side / 2 - BESIDE, y[0] + side / 2 + BESIDE
    pictures = side if any(image is not None for image in images) else 0
    for k, (group, image) in enumerate(zip(groups, images, strict=True)):
        if image is not None:
            draw_image(axes, image, left - side / 2, y[k])
            draw_image(axes, image, x[k], top + side / 2)
        beside = left - pictures - BESIDE / 2
        _write(axes, _name(group.name), beside, y[k], ha='right', va='center')
        _write(
            axes,
            _name(group.name),
            x[k],
            top + (side if image is not None else 0),
            ha='center',
            va='bottom',
        )
    _write(axes, 'from', MARGIN, top, ha='left', va='bottom', color=FAINT)
    _write(axes, 'to', left - BESIDE, top + pictures, ha='right', va='bottom', color=FAINT)


def _name(name: str) -> str:
    return textwrap.fill(name, 8)


def _write(axes: 'Axes', text: str, x: float, y: float, **style: Any) -> None:
    style = {'size': 8.5, 'weight': 'bold', 'color': TEXT, 'linespacing': 1.1, **style}
    axes.text(x, y, text, **style)


def _draw_cells(
    axes: 'Axes',
    matrix: TransitionMatrix,
    shown: Sequence[int],
    places: tuple[Array, Array],
    side: int,
) -> None:
    """Draw a cell for each row and each column in ``shown``; ``places`` are their centres."""
    from matplotlib.patches import Rectangle

    lower, upper = matrix.bounds()
    for row, y in enumerate(places[1]):
        for column, x in zip(shown, places[0], strict=True):
            p = float(matrix.probability[row, column])
            ends = (PALE, DEEP) if column < len(matrix.counts) else (PALE_OUTCOME, DEEP_OUTCOME)
            colour = _mixed(*ends, 0.0 if np.isnan(p) else p)
            corner = x - side / 2 + 1, y - side / 2 + 1
            axes.add_patch(Rectangle(corner, side - 2, side - 2, color=colour, linewidth=0))
            if np.isnan(p):
                axes.text(x, y, '-', size=9, color=DARK_TEXT, ha='center', va='center')
            else:
                interval = Interval(p, float(lower[row, column]), float(upper[row, column]))
                _write_cell(axes, interval, x, y)


def _write_cell(axes: 'Axes', interval: Interval, x: float, y: float) -> None:
    decimals = min(decimals_of(interval), MAX_DECIMALS)
    share, low, high = (
        f'{100 * value:.{decimals}f}' if value else '0'
        for value in (interval.probability, interval.lower, interval.upper)
    )
    # An outcome that was never seen is less conspicuous.
    size, weight = (10, 'bold') if interval.probability > 0 else (8, 'normal')
    colour = LIGHT_TEXT if interval.probability > LIGHT_FROM else DARK_TEXT
    style: dict[str, Any] = {'color': colour, 'ha': 'center'}
    axes.text(x, y + 2, share, size=size, weight=weight, va='bottom', **style)
    axes.text(x, y - 6, f'{low}–{high}', size=6.5, va='top', **style)


def _mixed(first: str, last: str, share: float) -> tuple[float, float, float]:
    """Return the colour at ``share`` of the way from the first to the last."""
    red, green, blue = (a + share * (b - a) for a, b in zip(rgb(first), rgb(last), strict=True))
    return red, green, blue
