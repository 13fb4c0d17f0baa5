"""The page of a search for the best conditions."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.core.errors import analysis
from resting_aspects_ros.report.aspect_pose import picture_part
from resting_aspects_ros.report.colours import COLOURS, aspect_colour, rgb
from resting_aspects_ros.report.figure_style import (
    FAINT,
    TEXT,
    new_figure,
    percent_axis,
    plain_axes,
)
from resting_aspects_ros.report.page_table import page_table
from resting_aspects_ros.report.page_template import chart, picture_uri, render_page
from resting_aspects_ros.report.posed_part import draw_parts, pose_parts
from resting_aspects_ros.studies.optimise_tables import candidate_table, factor_table
from resting_aspects_ros.studies.optimise_text import optimise_notes
from resting_aspects_ros.studies.optimum import Optimum
from resting_aspects_ros.studies.pages import (
    MAX_COLUMNS,
    PANEL_HEIGHT,
    PANEL_WIDTH,
    PIXELS,
    factor_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CURVES = 'Line charts of the objective over each factor'
_MAP = 'Map of the objective over two factors'


def optimise_page(result: Optimum) -> str:
    """Return the page as HTML."""
    notes: list[str] = []
    charts = []
    if result.profile.curves:
        charts.append(chart(partial(curves_figure, result), 'curves', _CURVES, notes=notes))
    if result.profile.map is not None:
        charts.append(chart(partial(map_figure, result), 'map', _MAP, notes=notes))
    pictures: list[dict[str, str]] = []
    with analysis('the pictures of the wanted aspects', notes):
        pictures = _pictures(result)
    amounts = result.amounts
    return render_page(
        'optimise.html',
        report={
            'title': result.part.name,
            'subtitle': f'{result.drops} drops at {len(result.points)} points, seed {result.seed}',
            'notes': notes,
            'facts': {
                'Conditions': [('best', conditions_text(result.best.setting.drop_conditions))],
                'Search': [
                    ('points of the design', str(amounts.points)),
                    ('drops at each point', str(amounts.drops)),
                    ('maximum number of drops', str(amounts.total)),
                    ('impossible points', str(len(result.skipped))),
                    ('surrogate', result.surrogate),
                    ('its error', f'{100 * result.surrogate_error:.1f} points'),
                ],
            },
        },
        aim=result.aim,
        notes=optimise_notes(result),
        pictures=pictures,
        candidates=page_table(candidate_table(result)),
        factors=page_table(factor_table(result)),
        charts=charts,
        confidence=f'{100 * result.confidence:g}',
    )


def _pictures(result: Optimum) -> list[dict[str, str]]:
    """Return a picture of each wanted aspect; none for an entropy or contacts."""
    wanted = [a for a in result.aspects.aspects if a.id in result.objective.wanted]
    if not wanted:
        return []
    part = picture_part(result.part, result.aspects.aspects)
    colours = [rgb(aspect_colour(aspect)) for aspect in wanted]
    images = draw_parts(pose_parts(part, wanted), colours, PIXELS)
    return [
        {'name': f'aspect {a.id}', 'colour': aspect_colour(a), 'picture': picture_uri(image)}
        for a, image in zip(wanted, images, strict=True)
    ]


def curves_figure(result: Optimum) -> 'Figure':
    """Return the objective over each factor, with the points and the best value."""
    count = len(result.factors)
    columns = min(count, MAX_COLUMNS)
    blocks = -(-count // columns)
    figure = new_figure(PANEL_WIDTH * max(columns, 2), (PANEL_HEIGHT + 0.5) * blocks)
    at = np.array([[f.scale * p.values[f.name] for f in result.factors] for p in result.points])
    counts = np.array([p.counts for p in result.points])
    seen = result.objective.values(counts / counts.sum(axis=1, keepdims=True))
    tops = [curve.upper.max() for curve in result.profile.curves]
    lows = [curve.lower.min() for curve in result.profile.curves]
    low, top = min(seen.min(), *lows), max(seen.max(), *tops)
    for k, (factor, curve) in enumerate(zip(result.factors, result.profile.curves, strict=True)):
        axes = figure.add_subplot(blocks, columns, k + 1)
        x = factor.scale * factor.values(curve.at)
        axes.scatter(at[:, k], seen, s=14, color=FAINT, alpha=0.6, linewidths=0)
        axes.fill_between(x, curve.lower, curve.upper, color=COLOURS[0], alpha=0.25, linewidth=0)
        axes.plot(x, curve.values, color=COLOURS[0], linewidth=1.8)
        best = factor.scale * float(factor.values(result.profile.best[k : k + 1])[0])
        axes.axvline(best, color=TEXT, linewidth=1, linestyle='--')
        plain_axes(axes, 'y')
        factor_axis(axes, factor)
        axes.set_ylim(max(0.0, low - 0.05 * (top - low)), top + 0.05 * (top - low))
        _objective_axis(axes, result, k % columns == 0)
    figure.tight_layout()
    return figure


def map_figure(result: Optimum) -> 'Figure':
    """Return a map of the objective over the two factors with the largest changes."""
    found = result.profile.map
    assert found is not None
    rows, columns = (result.factors[k] for k in found.factors)
    figure = new_figure(PANEL_WIDTH * 2, 1.6 * PANEL_HEIGHT)
    axes = figure.add_subplot()
    filled = axes.contourf(
        columns.scale * columns.values(found.at),
        rows.scale * rows.values(found.at),
        found.values,
        12,
        cmap='cividis',
    )
    row, column = (
        each.scale * float(each.values(result.profile.best[k : k + 1])[0])
        for each, k in zip((rows, columns), found.factors, strict=True)
    )
    axes.plot(column, row, 'o', color='white', markeredgecolor=TEXT, ms=9, clip_on=False)
    factor_axis(axes, columns, 'x')
    factor_axis(axes, rows, 'y')
    bar = figure.colorbar(filled)
    for each in (axes, bar.ax):
        each.tick_params(length=0, labelsize=8, labelcolor=FAINT)
        each.spines[:].set_visible(False)
    bar.outline.set_visible(False)
    if not result.objective.is_entropy:
        bar.ax.yaxis.set_major_formatter(lambda share, _: f'{100 * share:.3g} %')
    figure.tight_layout()
    return figure


def _objective_axis(axes: 'Axes', result: Optimum, labelled: bool) -> None:
    if not result.objective.is_entropy:
        percent_axis(axes, 'y', axes.get_ylim()[1])
    if labelled:
        text = 'entropy (nat)' if result.objective.is_entropy else 'share'
        axes.set_ylabel(text, size=8.5, color=TEXT)
