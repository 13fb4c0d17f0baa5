"""Figures of a study: shares and entropy over each factor, and Sobol indices."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from resting_aspects_ros.report.colours import GREY, aspect_colour
from resting_aspects_ros.report.figure_style import (
    FAINT,
    TEXT,
    new_figure,
    percent_axis,
    plain_axes,
)
from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.effects import Array, Effects, entropy
from resting_aspects_ros.studies.sensitivity import Indices
from resting_aspects_ros.studies.study_cases import StudyCase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches.
PANEL_WIDTH, PANEL_HEIGHT, ENTROPY_HEIGHT, ROW_HEIGHT = 3.3, 2.5, 1.3, 0.34
MAX_COLUMNS = 4
# With more points than this, dots are smaller.
MANY_POINTS = 150


def case_colours(case: StudyCase) -> list[str]:
    """Return the colour of each column of a case."""
    colours = [aspect_colour(members[0]) for members in case.aspects.classes()]
    return colours + [GREY] * (len(case.columns) - len(colours))


def effects_figure(
    case: StudyCase, effects: Effects, factors: Sequence[Factor], points: Array
) -> 'Figure':
    """Return the shares and the entropy over each factor: curves, bands, and the points."""
    columns = min(len(factors), MAX_COLUMNS)
    blocks = -(-len(factors) // columns)
    heights = [PANEL_HEIGHT, ENTROPY_HEIGHT] * blocks
    figure = new_figure(PANEL_WIDTH * max(columns, 2), sum(heights) + 0.5 * blocks)
    grid = figure.add_gridspec(2 * blocks, columns, height_ratios=heights)
    some = case.drops > 0
    shares = case.table[some] / case.drops[some][:, None]
    top = min(1.0, 1.1 * max(shares.max(), *(c.upper.max() for c in effects.curves)))
    bits = entropy(shares)
    margin = 0.3 * np.ptp(bits) + 0.05
    bit_range = max(0.0, bits.min() - margin), bits.max() + margin
    for k, (factor, curve) in enumerate(zip(factors, effects.curves, strict=True)):
        block, column = divmod(k, columns)
        upper = figure.add_subplot(grid[2 * block, column])
        lower = figure.add_subplot(grid[2 * block + 1, column])
        x = factor.scale * factor.values(curve.shares)
        at = factor.scale * factor.values(points[some, k])
        size = 14 if len(at) <= MANY_POINTS else 5
        for j, colour in enumerate(case_colours(case)):
            upper.scatter(at, shares[:, j], s=size, color=colour, alpha=0.3, linewidths=0)
            upper.fill_between(
                x, curve.lower[:, j], curve.upper[:, j], color=colour, alpha=0.25, linewidth=0
            )
            upper.plot(x, curve.mean[:, j], color=colour, linewidth=1.8)
        lower.scatter(at, bits, s=size, color=FAINT, alpha=0.3, linewidths=0)
        lower.fill_between(
            x, curve.entropy_lower, curve.entropy_upper, color=FAINT, alpha=0.25, linewidth=0
        )
        lower.plot(x, curve.entropy, color=TEXT, linewidth=1.5)
        upper.set_ylim(0, top)
        lower.set_ylim(*bit_range)
        for axes in (upper, lower):
            plain_axes(axes, 'y')
            factor_axis(axes, factor)
        percent_axis(upper, 'y', top)
        upper.tick_params(labelbottom=False)
        upper.set_xlabel('')
        if column == 0:
            upper.set_ylabel('probability', size=8.5, color=TEXT)
            lower.set_ylabel('entropy (bit)', size=8.5, color=TEXT)
            figure.align_ylabels([upper, lower])
    figure.tight_layout(pad=0.6)
    return figure


def indices_figure(
    case: StudyCase, found: Indices, shares: Sequence[str], factors: Sequence[Factor]
) -> 'Figure':
    """Return the first and total Sobol indices of each column, with their errors."""
    names = [*shares, 'all shares']
    colours = [*case_colours(case), FAINT]
    columns = min(len(factors), MAX_COLUMNS)
    blocks = -(-len(factors) // columns)
    height = ROW_HEIGHT * len(names) + 0.75
    figure = new_figure(PANEL_WIDTH * max(columns, 2), height * blocks)
    rows = np.arange(len(names))[::-1]
    for k, factor in enumerate(factors):
        axes = figure.add_subplot(blocks, columns, k + 1)
        plain_axes(axes, 'x')
        first, total = np.clip(found.first[:, k], 0, 1), np.clip(found.total[:, k], 0, 1)
        axes.barh(rows, total, height=0.62, color=colours, alpha=0.35)
        axes.barh(rows, first, height=0.62, color=colours)
        for values, errors, shift in (
            (first, found.first_error[:, k], 0.12),
            (total, found.total_error[:, k], -0.12),
        ):
            axes.errorbar(
                values, rows + shift, xerr=errors, fmt='none', ecolor=TEXT, elinewidth=1.1
            )
        axes.set_xlim(0, 1.05)
        axes.set_xticks([0, 0.25, 0.5, 0.75, 1])
        axes.set_xticklabels(['0', '', '0.5', '', '1'])
        axes.set_ylim(-0.6, len(names) - 0.4)
        shown = k % columns == 0
        axes.set_yticks(rows, names if shown else [''] * len(names))
        axes.tick_params(axis='y', labelcolor=TEXT, labelsize=8)
        axes.set_title(factor.label or factor.name, size=9, color=TEXT, loc='left')
    figure.tight_layout(pad=0.6)
    return figure


def factor_axis(axes: 'Axes', factor: Factor, name: Literal['x', 'y'] = 'x') -> None:
    """Set the label, the scale, the limits and the ticks of an axis, 'x' or 'y', of a factor.

    The values are in the unit in which the factor is shown, such as mm.
    """
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    axis = getattr(axes, f'{name}axis')
    if factor.logarithmic:
        getattr(axes, f'set_{name}scale')('log')
        # Over less than three octaves, decades have too few ticks.
        steps = (1.0, 2.0, 5.0) if factor.high / factor.low >= 8 else (1.0, 2.0, 3.0, 5.0, 7.0)
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_minor_formatter(NullFormatter())
        axis.set_tick_params(which='minor', length=0)
    else:
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    axis.set_major_formatter(lambda value, _: f'{value:g}')
    getattr(axes, f'set_{name}lim')(factor.scale * factor.low, factor.scale * factor.high)
    getattr(axes, f'set_{name}label')(factor.title, size=8.5, color=TEXT, labelpad=4)
