"""The picture of a calibration: which conditions fit, and how well the shares do."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from resting_aspects_ros.report.figure_style import FAINT, PAPER, TEXT, new_figure, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from resting_aspects_ros.studies.calibration.fitted_surface import FittedSurface

Array = npt.NDArray[np.float64]

REGIONS = (0.5, 0.9)
FILL = ('#C9DCF2', '#5B93D0')  # of the outer and the inner region
COUNTED, FITTED, LEFT_OUT = '#222226', '#2F6DB5', '#C2571A'
# Cells of an axis and their smoothing: for a grid of points, and for scattered points.
CELLS, SMOOTHING = (60, 30), (1.2, 1.6)
ROW = 0.26  # inches
MAX_ROWS = 60


def calibration_figure(result: 'FittedSurface') -> 'Figure':
    """Return the picture of a result: the regions of the conditions above the shares.

    A single region is beside the shares.
    """
    pairs = _pairs(len(result.estimates))
    rows = min(sum(_shown(part) for part in result.fit.given.parts), MAX_ROWS)
    beside = len(pairs) == 1
    columns = 2 if beside else min(3, len(pairs))
    bands = -(-len(pairs) // columns)
    width, top, panel = 9.0, 0.75, 2.9
    shares = 0.75 + ROW * rows
    height = top + (max(panel, shares) if beside else bands * panel + shares)
    figure = new_figure(width, height)
    figure.text(
        0.03,
        1 - 0.3 / height,
        f'{result.surface}: conditions that fit {result.fit.given.drops} counted drops',
        color=TEXT,
        fontsize=11,
        va='center',
    )
    figure.text(
        0.03,
        1 - 0.52 / height,
        'regions with 50 and 90 % of the probability; cross: most probable',
        color=FAINT,
        fontsize=8,
        va='center',
    )
    for number, (i, j) in enumerate(pairs):
        band, column = divmod(number, columns)
        left = (0.75 + column * (width - 0.3) / columns) / width
        bottom = (height - top - (band + 1) * panel + 0.55) / height
        size = ((width - 0.3) / columns - 0.75) / width, (panel - 0.65) / height
        axes = figure.add_axes((left, bottom, *size))
        _draw_region(axes, result, i, j)
    first, bottom, tall = 2.6, 0.45, shares - 0.85
    if beside:
        first, bottom, tall = 5.6, 0.55, height - top - 0.65
    axes = figure.add_axes(
        (first / width, bottom / height, 1 - (first + 0.4) / width, tall / height)
    )
    _draw_shares(axes, result, beside=beside)
    return figure


def _pairs(factors: int) -> list[tuple[int, int]]:
    if factors == 1:
        return [(0, 0)]
    return [(i, j) for i in range(factors) for j in range(i + 1, factors)][:6]


def _shown(part: object) -> int:
    groups = len(part.names)  # type: ignore[attr-defined]
    return groups if groups > 2 else 1


def _draw_region(axes: 'Axes', result: 'FittedSurface', i: int, j: int) -> None:
    """Draw the regions of two conditions, or the density of a single one."""
    posterior = result.fit.posterior
    weights = posterior.weights().sum(axis=0)
    one, other = result.estimates[i].factor, result.estimates[j].factor
    scattered = len(result.estimates) > 2
    cells = CELLS[scattered]
    centres = (np.arange(cells) + 0.5) / cells
    plain_axes(axes, 'y')
    axes.set_xlabel(one.title, fontsize=8, color=FAINT)
    if one.logarithmic:
        axes.set_xscale('log')
        _plain_ticks(axes.xaxis)
    axes.set_xlim(one.scale * one.low, one.scale * one.high)
    if i == j:
        density = np.histogram(posterior.points[:, i], cells, (0, 1), weights=weights)[0]
        axes.fill_between(
            one.scale * one.values(centres), gaussian_filter(density, 1.0), color=FILL[1]
        )
        axes.set_yticks([])
        return
    mass = np.histogram2d(
        posterior.points[:, i], posterior.points[:, j], cells, ((0, 1), (0, 1)), weights=weights
    )[0]
    mass = gaussian_filter(mass, SMOOTHING[scattered], mode='nearest')
    levels = sorted(_level(mass, region) for region in REGIONS)
    x, y = one.scale * one.values(centres), other.scale * other.values(centres)
    axes.contourf(x, y, mass.T, [*levels, max(mass.max(), levels[-1]) * 1.01], colors=FILL)
    best = one.scale * result.estimates[i].best, other.scale * result.estimates[j].best
    axes.plot(*best, '+', color=TEXT, markersize=9)
    if other.logarithmic:
        axes.set_yscale('log')
        _plain_ticks(axes.yaxis)
    axes.set_ylim(other.scale * other.low, other.scale * other.high)
    axes.set_ylabel(other.title, fontsize=8, color=FAINT, labelpad=2)


def _plain_ticks(axis: 'Axis') -> None:
    """Show 0.03, 0.1, 0.3 on a logarithmic axis."""
    from matplotlib.ticker import LogLocator, NullLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda value, _: f'{value:g}')


def _level(mass: Array, region: float) -> float:
    """Return the mass of a cell above which the cells have the probability ``region``."""
    ordered = np.sort(mass.ravel())[::-1]
    place = int(np.searchsorted(np.cumsum(ordered), region * ordered.sum()))
    return float(ordered[min(place, len(ordered) - 1)])


def _draw_shares(axes: 'Axes', result: 'FittedSurface', *, beside: bool) -> None:
    """Draw the counted shares over those of the simulation; beside a region it is narrow."""
    names = []
    y = 0
    for k, part in enumerate(result.fit.given.parts):
        fitted = result.predictions[k]
        left = result.left_out[k] if result.left_out else None
        for g in range(_shown(part)):
            if y >= MAX_ROWS:
                break
            interval = left or fitted
            axes.plot(
                [100 * interval.low[g], 100 * interval.high[g]],
                [y, y],
                color=FILL[0],
                linewidth=7,
                solid_capstyle='butt',
                label='90 % interval' if y == 0 else None,
            )
            if left is not None:
                label = 'predicted from the other parts' if y == 0 else None
                axes.plot(100 * left.model[g], y, 'D', color=LEFT_OUT, markersize=4, label=label)
            label = 'fitted' if y == 0 else None
            axes.plot(100 * fitted.model[g], y, 'o', color=FITTED, markersize=5, label=label)
            label = 'counted' if y == 0 else None
            axes.plot(100 * fitted.counted[g], y, '|', color=COUNTED, markersize=11, label=label)
            names.append(f'{part.name}: {part.names[g]}')
            y += 1
    plain_axes(axes, 'x')
    axes.set_yticks(range(len(names)), [name[: 20 if beside else 34] for name in names])
    axes.set_ylim(y - 0.4, -0.6)
    axes.set_xlim(left=0)
    axes.xaxis.set_major_formatter(lambda share, _: f'{share:g} %')
    axes.legend(
        fontsize=7,
        frameon=False,
        ncols=2 if beside else 4,
        loc='lower left',
        bbox_to_anchor=(0, 1),
        labelcolor=TEXT,
        facecolor=PAPER,
    )
