"""The page of a study."""

from collections.abc import Iterator
from functools import partial
from typing import Any

from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.report.page_table import PageTable, text_table
from resting_aspects_ros.report.page_template import chart, render_page
from resting_aspects_ros.studies.effects import Effects
from resting_aspects_ros.studies.findings import NOT_WORTH, WORTH, points_text
from resting_aspects_ros.studies.page_parts import case_pictures, comparison_texts
from resting_aspects_ros.studies.sensitivity import Indices
from resting_aspects_ros.studies.study_cases import StudyCase
from resting_aspects_ros.studies.study_counts import StudyCounts
from resting_aspects_ros.studies.study_figures import (
    case_colours,
    effects_figure,
    indices_figure,
)

_CURVES = 'Line charts of the probability of each aspect class and of the entropy over each factor'
_INDICES = 'Bar charts of the first and total Sobol indices'


def study_page(result: StudyCounts) -> str:
    """Return the page of a study as HTML."""
    spec = result.spec
    names = ', '.join(part.name for part in spec.parts)
    pictures = {id(case): case_pictures(case) for case in result.cases}
    drops = sum(int(case.drops.sum()) for case in result.cases)
    notes = list(_notes(result))
    cases = [
        _case(result, k, case, effects, pictures[id(case)], notes)
        for k, (case, effects) in enumerate(zip(result.cases, result.effects, strict=True))
    ]
    return render_page(
        'study.html',
        report={
            'title': names,
            'subtitle': f'{len(result.points)} points, {drops} drops, seed {spec.seed}',
            'notes': notes,
            'facts': _facts(result),
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


def _case(
    result: StudyCounts,
    k: int,
    case: StudyCase,
    effects: Effects | None,
    pictures: list[str],
    notes: list[str],
) -> dict[str, Any]:
    colours = case_colours(case)
    some = case.drops > 0
    shares = case.table[some] / case.drops[some][:, None]
    classes = [
        {
            'name': name,
            'colour': colours[j],
            'picture': pictures[j] if j < len(pictures) else '',
            'mean': f'{100 * shares[:, j].mean():.1f} %' if some.any() else '',
            'range': f'{100 * shares[:, j].min():.1f} to {100 * shares[:, j].max():.1f} %'
            if some.any()
            else '',
        }
        for j, name in enumerate(case.columns)
    ]
    found: dict[str, Any] = {'name': case.name, 'classes': classes, 'figures': None}
    if effects is None:
        return found
    factors, place = result.spec.factors, f'{chr(97 + k % 26)}{k}'
    draw = partial(effects_figure, case, effects, factors, result.points)
    found['figures'] = [chart(draw, f'curves-{place}', _CURVES, notes=notes)]
    if effects.indices is not None:
        draw = partial(indices_figure, case, effects.indices, effects.columns, factors)
        found['figures'].append(chart(draw, f'indices-{place}', _INDICES, notes=notes))
    found['surrogate'] = (
        f'The curves and indices are those of a surrogate: {effects.form}. Its cross-validated '
        f'error is {points_text(effects.cross_validated_error)} points, and it explains '
        f'{100 * effects.explained:.0f} % of the variance between the points. The rest are '
        'irregular changes, which no smooth curve describes.'
    )
    found['reliable'] = effects.reliable(result.spec.tolerance)
    if effects.indices is not None:
        found['numbers'] = _indices_table(effects, effects.indices, result)
    return found


def _indices_table(effects: Effects, found: Indices, result: StudyCounts) -> PageTable:
    headings = ['share of']
    for factor in result.spec.factors:
        name = factor.label or factor.name
        headings += [f'{name}: first', f'{name}: total', f'{name}: change of the mean']
    rows = []
    for j, name in enumerate([*effects.columns, 'all shares']):
        row = [name]
        for k, curve in enumerate(effects.curves):
            row.append(f'{found.first[j, k]:.2f} ± {found.first_error[j, k]:.2f}')
            row.append(f'{found.total[j, k]:.2f} ± {found.total_error[j, k]:.2f}')
            if j < len(effects.columns):
                change = curve.mean[-1, j] - curve.mean[0, j]
                row.append(f'{100 * change:+.1f} points')
            else:
                row.append('')
        rows.append(row)
    return text_table(headings, rows)


def _notes(result: StudyCounts) -> Iterator[str]:
    if not result.complete:
        yield 'The study is not complete: the same command continues it.'
    for case in result.cases:
        if case.skipped:
            k, reason = min(case.skipped.items())
            yield (
                f'{case.name}: {len(case.skipped)} of {len(result.points)} points are impossible '
                f'and were skipped; the curves are extrapolated there. Point {k}: {reason}.'
            )


def _facts(result: StudyCounts) -> dict[str, list[tuple[str, str]]]:
    spec = result.spec
    base = spec.base
    other = [(factor.label or factor.name, _range(factor)) for factor in spec.factors]
    facts = {
        'Factors': other,
        'Conditions': [('all others', conditions_text(base.drop_conditions))],
        'Study': [
            ('design', spec.design),
            ('points', str(len(result.points))),
            ('drops at each point', str(spec.drops)),
            ('seed', str(spec.seed)),
            ('tolerance', f'{points_text(spec.tolerance)} points'),
        ],
    }
    if base.action is not None:
        facts['Action'] = [(base.action.name, base.action.text)]
    return facts


def _range(factor: Any) -> str:
    levels = f', {factor.levels} levels' if factor.levels else ''
    scale = ', logarithmic' if factor.logarithmic else ''
    return f'{factor.text(factor.low)} to {factor.text(factor.high)}{levels}{scale}'
