"""The pages of studies, optima, propagated surfaces and batches, and their figures."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from resting_aspects_ros.api.condition_text import condition_facts
from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.report.figure import (
    FAINT,
    TEXT,
    WIDE,
    RowAxes,
    new_figure,
    percent_axis,
    plain_axes,
)
from resting_aspects_ros.report.format import (
    COLOURS,
    GREY,
    Row,
    aspect_colour,
    class_rows,
    rgb,
    shown_difference,
)
from resting_aspects_ros.report.page import PAGE
from resting_aspects_ros.report.page_table import PageTable, page_table, text_table
from resting_aspects_ros.report.page_template import chart, picture_uri, render_page
from resting_aspects_ros.report.picture import draw_parts, picture_part, pose_parts
from resting_aspects_ros.simulation.conditions import QUANTITIES
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.effects import (
    NOT_WORTH,
    WORTH,
    Effects,
    SobolIndices,
    entropy,
    points_text,
)
from resting_aspects_ros.studies.points import Case

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resting_aspects_ros.studies.batch import BatchEntry, BatchResult, CaseComparison
    from resting_aspects_ros.studies.optimum import OptimiseResult
    from resting_aspects_ros.studies.propagate import PropagatedResult
    from resting_aspects_ros.studies.study import StudyResult

# Inches.
PANEL_WIDTH, PANEL_HEIGHT, ROW_HEIGHT = 3.3, 2.7, 0.34
MAX_COLUMNS = 4
PIXELS = 176
# Number of classes of a part that the index of a batch shows.
TOP = 3


def case_colours(case: Case) -> list[str]:
    """Return the colour of each column of a case."""
    colours = [aspect_colour(members[0]) for members in case.aspects.classes()]
    return colours + [GREY] * (len(case.columns) - len(colours))


def case_pictures(case: Case) -> list[str]:
    """Return a picture of each symmetry class as a data URI; empty if they cannot be made."""
    members = [alike[0] for alike in case.aspects.classes()]
    found = [''] * len(members)
    with analysis(f'the pictures of {case.part.name}'):
        part = picture_part(case.part, case.aspects.aspects)
        colours = [rgb(colour) for colour in case_colours(case)[: len(members)]]
        images = draw_parts(pose_parts(part, members), colours, PIXELS)
        found[:] = [picture_uri(image) for image in images]
    return found


def study_page(result: 'StudyResult') -> str:
    """Return the page of a study as HTML."""
    spec = result.spec
    pictures = {id(case): case_pictures(case) for case in result.cases}
    drops = sum(int(case.drops.sum()) for case in result.cases)
    notes = list(_study_notes(result))
    cases = [
        _study_case(result, k, case, effects, pictures[id(case)], notes)
        for k, (case, effects) in enumerate(zip(result.cases, result.effects, strict=True))
    ]
    return render_page(
        'study.html',
        report={
            'title': ', '.join(part.name for part in spec.parts),
            'subtitle': f'{len(result.design.points)} points, {drops} drops, seed {spec.seed}',
            'notes': notes,
            'facts': _study_facts(result),
        },
        findings=[
            {
                'case': finding.case if len(result.cases) > 1 else '',
                'sentence': finding.sentence,
                'details': finding.details,
                'mark': {WORTH: 'yes', NOT_WORTH: 'no'}.get(finding.verdict, 'open'),
            }
            for finding in result.findings
        ],
        cases=cases,
        comparisons=[comparison_texts(each, pictures) for each in result.comparisons],
        confidence=f'{100 * spec.confidence:g}',
        tolerance=points_text(spec.tolerance),
    )


def _study_case(
    result: 'StudyResult',
    k: int,
    case: Case,
    effects: Effects | None,
    pictures: list[str],
    notes: list[str],
) -> dict[str, Any]:
    """Return the section of a case."""
    made = case.drops > 0
    shares = case.table[made] / case.drops[made][:, None]
    classes = [
        {
            'name': name,
            'colour': colour,
            'picture': picture,
            'range': f'{100 * own.min():.1f} to {100 * own.max():.1f} %' if len(own) else '',
        }
        for name, colour, picture, own in zip(
            case.columns, case_colours(case), [*pictures, ''], shares.T, strict=False
        )
    ]
    found: dict[str, Any] = {'name': case.name, 'classes': classes, 'figures': [], 'numbers': None}
    if effects is None or not any(effects.factors):
        return found
    factors = result.spec.factors
    curves = partial(curves_figure, case, effects, factors)
    label = 'Line charts of the probability of each aspect class over each factor'
    found['figures'].append(chart(curves, f'curves-{k}', label, notes=notes))
    if effects.indices is not None:
        bars = partial(indices_figure, case, effects.indices, factors)
        label = 'Bar charts of the first and total Sobol indices'
        found['figures'].append(chart(bars, f'indices-{k}', label, notes=notes))
        found['numbers'] = _indices_table(case, effects.indices, factors)
    return found


def _indices_table(case: Case, found: SobolIndices, factors: Sequence[Factor]) -> PageTable:
    """Return the table of the indices; empty cells for shares that do not vary."""
    headings = ['share of']
    for factor in factors:
        headings += [f'{factor.label or factor.name}: {kind}' for kind in ('first', 'total')]
    rows = []
    for j, name in enumerate([*case.columns, 'all shares']):
        cells = [
            _with_interval(values[j, k], *bounds[:, j, k])
            for k in range(len(factors))
            for values, bounds in (
                (found.first, found.first_bounds),
                (found.total, found.total_bounds),
            )
        ]
        rows.append([name, *cells])
    return text_table(headings, rows)


def _with_interval(value: float, lower: float, upper: float) -> str:
    """Return an index with its interval, within 0 and 1; empty for NaN."""
    if np.isnan(value):
        return ''
    value, lower, upper = np.clip([value, lower, upper], 0, 1)
    return f'{value:.2f}\n{lower:.2f} to {upper:.2f}'


def _study_notes(result: 'StudyResult') -> Iterator[str]:
    if not result.complete:
        yield 'The study is not complete: the same command continues it.'
    for case in result.cases:
        if case.skipped:
            k, reason = min(case.skipped.items())
            yield (
                f'{case.name}: {len(case.skipped)} of {len(result.design.points)} points are '
                f'impossible and were skipped. Point {k}: {reason}.'
            )


def _study_facts(result: 'StudyResult') -> dict[str, list[tuple[str, str]]]:
    spec = result.spec
    facts = {
        'Factors': [(factor.label or factor.name, _range(factor)) for factor in spec.factors],
        'Conditions': [('all others', conditions_text(spec.base.drop_conditions))],
        'Study': [
            ('design', spec.design),
            *([('base points', str(spec.points))] if spec.design == 'curves' else []),
            ('drops at each point', str(spec.drops)),
            ('seed', str(spec.seed)),
            ('tolerance', f'{points_text(spec.tolerance)} points'),
        ],
    }
    if spec.base.action is not None:
        facts['Action'] = [(spec.base.action.name, spec.base.action.text)]
    return facts


def _range(factor: Factor) -> str:
    levels = f', {factor.levels} levels' if factor.levels else ''
    scale = ', logarithmic' if factor.logarithmic else ''
    return f'{factor.text(factor.low)} to {factor.text(factor.high)}{levels}{scale}'


def curves_figure(case: Case, effects: Effects, factors: Sequence[Factor]) -> 'Figure':
    """Return the shares over each factor: the mean with its band, and each line."""
    figure, panels = _panels(len(factors), PANEL_HEIGHT)
    curves = [None if each is None else each.curve for each in effects.factors]
    known = [curve for curve in curves if curve is not None]
    top = min(1.0, 1.1 * max(max(curve.each.max(), curve.upper.max()) for curve in known))
    for k, (axes, factor, curve) in enumerate(zip(panels, factors, curves, strict=True)):
        plain_axes(axes, 'y')
        axes.set_ylim(0, top)
        percent_axis(axes, 'y', top)
        factor_axis(axes, factor)
        if k % MAX_COLUMNS == 0:
            axes.set_ylabel('probability', size=8.5, color=TEXT)
        if curve is None:
            continue
        x = factor.scale * factor.values(curve.levels)
        for j, colour in enumerate(case_colours(case)):
            if len(curve.each) > 1:
                axes.plot(x, curve.each[:, :, j].T, color=colour, linewidth=0.6, alpha=0.25)
            axes.fill_between(
                x, curve.lower[:, j], curve.upper[:, j], color=colour, alpha=0.25, linewidth=0
            )
            axes.plot(x, curve.mean[:, j], '.-', color=colour, linewidth=1.8, markersize=5)
    figure.tight_layout(pad=0.6)
    return figure


def indices_figure(case: Case, found: SobolIndices, factors: Sequence[Factor]) -> 'Figure':
    """Return the first and total Sobol indices of each column, with their intervals."""
    names, colours = [*case.columns, 'all shares'], [*case_colours(case), FAINT]
    figure, panels = _panels(len(factors), ROW_HEIGHT * len(names) + 0.75)
    rows = np.arange(len(names))[::-1]
    for k, (axes, factor) in enumerate(zip(panels, factors, strict=True)):
        plain_axes(axes, 'x')
        for values, bounds, shift, alpha in (
            (found.total[:, k], found.total_bounds[:, :, k], -0.12, 0.35),
            (found.first[:, k], found.first_bounds[:, :, k], 0.12, 1.0),
        ):
            width, (lower, upper) = np.clip(values, 0, 1), np.clip(bounds, 0, 1)
            axes.barh(rows, np.nan_to_num(width), height=0.62, color=colours, alpha=alpha)
            axes.hlines(rows + shift, lower, upper, color=TEXT, linewidth=1.1)
        axes.set_xlim(0, 1.05)
        axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ['0', '', '0.5', '', '1'])
        axes.set_ylim(-0.6, len(names) - 0.4)
        shown = k % MAX_COLUMNS == 0
        axes.set_yticks(rows, names if shown else [''] * len(names))
        axes.tick_params(axis='y', labelcolor=TEXT, labelsize=8)
        axes.set_title(factor.label or factor.name, size=9, color=TEXT, loc='left')
    figure.tight_layout(pad=0.6)
    return figure


def _panels(count: int, height: float) -> 'tuple[Figure, list[Axes]]':
    """Return a figure with panels of a height, inches, in rows of at most MAX_COLUMNS."""
    columns = min(count, MAX_COLUMNS)
    blocks = -(-count // columns)
    figure = new_figure(PANEL_WIDTH * max(columns, 2), height * blocks)
    return figure, [figure.add_subplot(blocks, columns, k + 1) for k in range(count)]


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


def optimise_page(result: 'OptimiseResult') -> str:
    """Return the page of a search for the best conditions as HTML."""
    notes: list[str] = []
    label = 'Charts of the objective over each factor'
    figures = [chart(partial(facts_figure, result), 'curves', label, notes=notes)]
    pictures: list[dict[str, str]] = []
    with analysis('the pictures of the wanted aspects', notes):
        wanted = [a for a in result.aspects.aspects if a.id in result.objective.wanted]
        colours = [aspect_colour(aspect) for aspect in wanted]
        if wanted:
            part = picture_part(result.part, result.aspects.aspects)
            images = draw_parts(pose_parts(part, wanted), [rgb(c) for c in colours], PIXELS)
            pictures = [
                {'name': f'aspect {a.id}', 'colour': colour, 'picture': picture_uri(image)}
                for a, colour, image in zip(wanted, colours, images, strict=True)
            ]
    return render_page(
        'optimise.html',
        report={
            'title': result.part.name,
            'subtitle': f'{result.drops} drops at {len(result.points)} points, seed {result.seed}',
            'notes': notes,
            'facts': {
                'Factors': [(f.label or f.name, _range(f)) for f in result.factors],
                'Conditions': [('best', conditions_text(result.best.setting.drop_conditions))],
                'Search': [('maximum number of drops', str(result.budget))],
            },
        },
        aim=result.aim,
        notes=result.notes,
        pictures=pictures,
        candidates=page_table(result.candidate_table()),
        factors=page_table(result.factor_table()),
        figures=figures if result.facts else [],
        confidence=f'{100 * result.confidence:g}',
    )


def facts_figure(result: 'OptimiseResult') -> 'Figure':
    """Return the objective over each factor, with its intervals, and the best value."""
    figure, panels = _panels(len(result.factors), PANEL_HEIGHT)
    low = min(float(facts.lower.min()) for facts in result.facts)
    top = max(float(facts.upper.max()) for facts in result.facts)
    margin, entropy_wanted = 0.05 * (top - low), result.objective.is_entropy
    for k, (axes, factor, facts) in enumerate(
        zip(panels, result.factors, result.facts, strict=True)
    ):
        x = factor.scale * factor.values(facts.at)
        flat = factor.scale * factor.values(np.array(facts.flat))
        axes.axvspan(*flat, color=COLOURS[0], alpha=0.1, linewidth=0)
        axes.vlines(x, facts.lower, facts.upper, color=COLOURS[0], lw=1.4, clip_on=False)
        axes.plot(x, facts.values, '.-', color=COLOURS[0], lw=0.8, ms=6, clip_on=False)
        assert result.best.point is not None
        best = float(factor.values(result.best.point[k]))
        axes.axvline(factor.scale * best, color=TEXT, linewidth=1, linestyle='--')
        plain_axes(axes, 'y')
        factor_axis(axes, factor)
        axes.set_ylim(max(0.0, low - margin), top + margin)
        if not entropy_wanted:
            axes.yaxis.set_major_formatter(lambda share, _: f'{100 * share:.6g} %')
        if k % MAX_COLUMNS == 0:
            text = 'entropy (nat)' if entropy_wanted else 'share'
            axes.set_ylabel(text, size=8.5, color=TEXT)
    figure.tight_layout(pad=0.6)
    return figure


def propagated_page(result: 'PropagatedResult') -> str:
    """Return the page of a distribution on a surface that is not known exactly as HTML."""
    found, names = result.by_class, result.case.class_names
    notes = [] if result.complete else ['The run was interrupted: some samples are missing.']
    ends = {name: count for name, count in result.other_ends().items() if count}
    if ends:
        text = ', '.join(f'{count} {name}' for name, count in ends.items())
        notes.append(f'{sum(ends.values())} of {result.drops} drops ended in no aspect: {text}.')
    label = 'Bars of the probability of each aspect class with two intervals'
    legend = (
        'bar: mean probability; black: sampling interval; grey, wide: interval with the unknown '
        'surface; dots: samples of the surface'
    )
    headings = ['class', 'probability', 'by sampling alone', 'with the surface']
    rows = zip(names, found.sampling, found.total, found.part_of_surface.tolist(), strict=True)
    numbers = [
        [
            name,
            f'{100 * one.probability:.2f} %',
            f'{_percent(one)} %',
            f'{_percent(both)} %',
            f'{100 * part:.0f} %',
        ]
        for name, one, both, part in rows
    ]
    return render_page(
        'propagated.html',
        report={
            'title': result.part.name,
            'subtitle': f'{result.drops} drops, {result.drops_per_sample} at each of '
            f'{len(result.counts)} samples of the surface, seed {result.seed}',
            'notes': notes,
            'facts': {'Conditions': _surface_facts(result)},
        },
        sentence=result.sentence(),
        classes=[
            {'name': name, 'colour': colour, 'picture': picture, 'share': f'{100 * p:.1f} %'}
            for name, colour, picture, p in zip(
                names,
                case_colours(result.case),
                case_pictures(result.case),
                found.means.tolist(),
                strict=False,
            )
        ],
        chart=chart(partial(propagated_figure, result), 'shares', label, legend, notes),
        numbers=text_table([*headings, 'part of the surface in the variance'], numbers),
        confidence=f'{100 * result.confidence:g}',
    )


def propagated_figure(result: 'PropagatedResult') -> 'Figure':
    """Return bars of the probabilities, with both intervals and the shares of the samples."""
    found = result.by_class
    rows = [
        Row(name, int(count), interval, colour)
        for name, count, interval, colour in zip(
            result.case.class_names,
            result.case.classes.sum(axis=0),
            found.sampling,
            case_colours(result.case),
            strict=False,
        )
    ]
    bands, top = RowAxes(rows, 0.5, WIDE, 0.4), 0.0
    axes, shares = bands.axes, (result.case.classes / result.drops_per_sample).T
    for row, total, y, own in zip(rows, found.total, bands.places.tolist(), shares, strict=True):
        sampling = row.interval
        axes.barh(y, sampling.probability, bands.data(0.3), color=row.colour, alpha=0.55)
        axes.plot(own, [y - bands.data(0.17)] * len(own), '.', color=row.colour, alpha=0.5, ms=3)
        axes.plot([total.lower, total.upper], [y, y], color=FAINT, linewidth=5, alpha=0.6)
        axes.plot([sampling.lower, sampling.upper], [y, y], color=TEXT, linewidth=1.6)
        top = max(top, total.upper, float(own.max()))
    axes.set_xlim(0, min(1.0, 1.05 * top))
    percent_axis(axes, 'x', min(1.0, 1.05 * top))
    return bands.figure


def _surface_facts(result: 'PropagatedResult') -> list[tuple[str, str]]:
    """Return the surface, the range of each condition that was sampled, and the known ones."""
    ranges = {}
    for name in result.samples[0] if result.samples else ():
        values, quantity = [sample[name] for sample in result.samples], QUANTITIES[name]
        text = f'samples from {min(values):.3g} to {max(values):.3g} {quantity.unit}'
        ranges[quantity.label] = text
    return [
        ('surface', result.conditions.surface or 'changed conditions of the calibrated surface'),
        *((label, ranges.get(label, text)) for label, text in condition_facts(result.conditions)),
    ]


def comparison_texts(found: 'CaseComparison', pictures: dict[int, list[str]]) -> dict[str, Any]:
    """Return the texts of two designs side by side; pictures by id(case)."""
    first, second = found.first, found.second
    alone = [
        f'{case.name}: {", ".join(names)}'
        for case, shared in (
            (first, {each.first for each in found.shared}),
            (second, {each.second for each in found.shared}),
        )
        if (names := [n for k, n in enumerate(case.class_names, 1) if k not in shared])
    ]
    return {
        'first': first.name,
        'second': second.name,
        'apart': f'{found.apart:.2g}',
        'rows': [
            {
                'names': (first.class_names[e.first - 1], second.class_names[e.second - 1]),
                'pictures': (
                    pictures[id(first)][e.first - 1],
                    pictures[id(second)][e.second - 1],
                ),
                'shares': (f'{100 * e.first_share:.1f} %', f'{100 * e.second_share:.1f} %'),
                'difference': (
                    f'{100 * shown_difference(e.second_share, e.first_share, 1):+.1f} points'
                ),
                'interval': f'{100 * e.lower:+.1f} to {100 * e.upper:+.1f}',
            }
            for e in found.shared
        ],
        'alone': alone,
    }


def batch_page(batch: 'BatchResult', *, compare: bool) -> str:
    """Return the index page of a batch; without comparisons while the batch is running."""
    done = [entry for entry in batch.entries if entry.result is not None]
    pictures = {id(entry.case): entry.pictures for entry in done}
    failed = [entry for entry in batch.entries if entry.error]
    notes = [f'{len(failed)} of {len(batch.entries)} parts failed; see below.'] if failed else []
    facts: dict[str, list[tuple[str, str]]] = {}
    if done and done[0].result is not None:
        run = done[0].result.run
        facts['Conditions'] = [('all parts', conditions_text(run.conditions))]
        facts['Run'] = [
            ('seed of the batch', str(batch.seed)),
            ('engine', f'{run.engine} {run.engine_version}'),
        ]
    drops = sum(e.result.distribution.drops for e in done if e.result is not None)
    return render_page(
        'batch.html',
        report={
            'title': f'{len(done)} parts',
            'subtitle': f'{drops} drops',
            'notes': notes,
            'facts': facts,
        },
        rows=[_batch_row(entry) for entry in done],
        failed=[(entry.source, entry.error) for entry in failed],
        comparisons=[
            comparison_texts(each, pictures) for each in (batch.comparisons if compare else [])
        ],
        confidence=f'{100 * batch.confidence:g}',
    )


def _batch_row(entry: 'BatchEntry') -> dict[str, Any]:
    assert entry.result is not None
    found = entry.result.distribution
    rows = class_rows(found)
    order = np.argsort([-row.count for row in rows], kind='stable')[:TOP].tolist()
    shares = np.array([row.count for row in rows]) / max(found.drops, 1)
    return {
        'name': entry.case.part.name,
        'source': entry.source,
        'link': f'{entry.folder}/{PAGE}',
        'drops': found.drops,
        'aspects': len(found.aspects),
        'entropy': f'{float(entropy(shares)):.2f}',
        'top': [
            {
                'name': rows[k].name,
                'picture': entry.pictures[k],
                'colour': rows[k].colour,
                'share': f'{100 * rows[k].interval.probability:.1f} %',
                'interval': _percent(rows[k].interval),
            }
            for k in order
        ],
    }


def _percent(found: Interval) -> str:
    return f'{100 * found.lower:.1f} to {100 * found.upper:.1f}'
