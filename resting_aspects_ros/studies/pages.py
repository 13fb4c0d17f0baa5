"""The pages of studies, optima and batches, and their figures."""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Literal

import numpy as np

from resting_aspects_ros.api.conditions import conditions_text
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drop_page import PAGE
from resting_aspects_ros.report.drops import MODEL_RANGE, model_text, shares
from resting_aspects_ros.report.figure import (
    FAINT,
    TEXT,
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
    interval_text,
    model_range,
    rgb,
    short_name,
    shown_difference,
)
from resting_aspects_ros.report.page import (
    Chart,
    Findings,
    Gallery,
    Item,
    Page,
    Section,
    Text,
    Tile,
    picture_uri,
    reading,
)
from resting_aspects_ros.report.picture import draw_parts, picture_part, pose_parts
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.effects import (
    NOT_WORTH,
    WORTH,
    Effects,
    SobolIndices,
    points_text,
)
from resting_aspects_ros.studies.points import Case

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resting_aspects_ros.api.drop import DropResult
    from resting_aspects_ros.studies.batch import BatchEntry, BatchResult, DesignComparison
    from resting_aspects_ros.studies.optimum import OptimiseResult
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


def class_pictures(part: Part, aspects: AspectSet) -> list[str]:
    """Return a picture of each symmetry class as a data URI; empty if they cannot be made."""
    members = [alike[0] for alike in aspects.classes()]
    found = [''] * len(members)
    with analysis(f'the pictures of {part.name}'):
        drawn = picture_part(part)
        colours = [rgb(aspect_colour(aspect)) for aspect in members]
        images = draw_parts(pose_parts(drawn, members), colours, PIXELS)
        found[:] = [picture_uri(image) for image in images]
    return found


def study_page(result: 'StudyResult', file: str) -> Page:
    """Return the page of a study."""
    spec = result.spec
    drops = sum(int(case.drops.sum()) for case in result.cases)
    several = len(result.cases) > 1
    findings = [
        (
            {WORTH: 'yes', NOT_WORTH: 'no'}.get(finding.verdict, 'open'),
            f'{finding.case}: {finding.sentence}' if several else finding.sentence,
            finding.details,
        )
        for finding in result.findings
    ]
    cases = zip(result.cases, result.effects, strict=True)
    return Page(
        file=file,
        title=', '.join(part.name for part in spec.parts),
        topic='study',
        lead='What the probability of each aspect depends on',
        subtitle=f'{len(result.design.points)} points, {drops} drops, seed {spec.seed}',
        sections=[
            Section('Findings', 'findings', [Findings(findings)]),
            *(
                Section(
                    case.name,
                    f'case-{k}',
                    list(_case_items(result, k, case, effects)),
                )
                for k, (case, effects) in enumerate(cases, start=1)
            ),
        ],
        reading=reading('study', tolerance=points_text(spec.tolerance)),
        facts=_study_facts(result),
        notes=list(_study_notes(result)),
    )


def _case_items(
    result: 'StudyResult', k: int, case: Case, effects: Effects | None
) -> Iterator[Item]:
    """Yield the items of the section of a case."""
    made = case.drops > 0
    shares = case.table[made] / case.drops[made][:, None]
    texts = [[_percents(own.min(), own.max())] for own in shares.T if len(own)]
    if made.any() and (ranges := result.model_ranges(case)) is not None:
        low, high = ranges[made, :, 0].min(axis=0), ranges[made, :, 1].max(axis=0)
        for text, *ends in zip(texts, low, high, strict=False):
            text.append(f'model range {_percents(*ends)}')
    yield _gallery(
        case.columns, case_colours(case), [*class_pictures(case.part, case.aspects), ''], texts
    )
    yield result.spec.base.range_text
    if effects is None or not any(effects.factors):
        yield Text(
            'The shares do not vary, or there are too few points with drops: there are no curves '
            'and indices.',
            'note',
        )
        return
    factors, confidence = result.spec.factors, f'{100 * result.spec.confidence:g}'
    yield Text('Probability over each factor', 'part')
    yield Chart(
        f'curves-{k}',
        'Line charts of the probability of each aspect class over each factor',
        partial(curves_figure, case, effects, factors),
        f'Thick: average over the other factors, with its {confidence} % interval. Thin: the '
        'other factors have fixed values. Between the points, which are simulated, the lines are '
        'straight.',
    )
    if effects.indices is not None:
        yield Text('Sobol indices', 'part')
        yield Chart(
            f'indices-{k}',
            'Bar charts of the first and total Sobol indices',
            partial(indices_figure, case, effects.indices, factors),
            'Dark, and the upper number: first index. Light, and the lower number: total index. '
            f'Whiskers, and in parentheses: {confidence} % intervals. There is no bar where a '
            'probability is not shown to vary.',
        )


def _gallery(
    names: Iterable[str],
    colours: Iterable[str],
    pictures: Iterable[str],
    texts: Iterable[Sequence[str]],
) -> Gallery:
    """Return a gallery of classes, each with texts."""
    zipped = zip_longest(names, colours, pictures, texts, fillvalue='')
    return Gallery([Tile(*each) for each in zipped if each[0]])


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
            for row, *each in zip(rows + 1.5 * shift, width, lower, upper, strict=True):
                if not np.isnan(each[0]):
                    text = '{:.2f} ({:.2f} to {:.2f})'.format(*each)
                    axes.text(1.06, row, text, size=6.5, color=TEXT, va='center')
        axes.set_xlim(0, 1.8)
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


def optimise_page(result: 'OptimiseResult', file: str) -> Page:
    """Return the page of a search for the best conditions."""
    first, *others = result.notes
    answer: list[Item] = [result.candidate_table()]
    answer.append(Findings([('open', first, ''), *(('open', '', note) for note in others)]))
    notes: list[str] = []
    with analysis('the pictures of the wanted aspects', notes):
        if wanted := [a for a in result.aspects if a.id in result.objective.wanted]:
            colours = [aspect_colour(aspect) for aspect in wanted]
            part = picture_part(result.part)
            images = draw_parts(pose_parts(part, wanted), [rgb(c) for c in colours], PIXELS)
            names = [f'aspect {aspect.id}' for aspect in wanted]
            pictures = map(picture_uri, images)
            answer.insert(0, _gallery(names, colours, pictures, [('wanted',)] * len(names)))
    chart = Chart(
        'points',
        'Charts of the objective over each factor',
        partial(points_figure, result),
        'A dot for each point of the search; the larger, the more drops. Dashed: the best value.',
    )
    return Page(
        file=file,
        title=result.part.name,
        topic='best conditions',
        lead=f'Conditions with the {result.aim}',
        subtitle=f'{result.drops} drops at {len(result.points)} points, seed {result.seed}',
        sections=[Section('Answer', 'answer', answer), Section('Search', 'search', [chart])],
        reading=reading('optimise', chance=f'{100 - 100 * result.confidence:g}'),
        facts={
            'Factors': [(f.label or f.name, _range(f)) for f in result.factors],
            'Conditions': [('best', conditions_text(result.best.setting.drop_conditions))],
            'Search': [('maximum number of drops', str(result.budget))],
        },
        notes=notes,
    )


def points_figure(result: 'OptimiseResult') -> 'Figure':
    """Return the objective over each factor at the points of the search, and the best value."""
    figure, panels = _panels(len(result.factors), PANEL_HEIGHT)
    counts = np.array([each for _, each in result.points])
    drops = counts.sum(axis=1)
    values = result.objective.values(counts / drops[:, None])
    for k, (axes, factor) in enumerate(zip(panels, result.factors, strict=True)):
        x = factor.scale * np.array([point[factor.name] for point, _ in result.points])
        axes.scatter(x, values, 40 * drops / drops.max(), COLOURS[0], alpha=0.6, clip_on=False)
        best = result.best.values[factor.name]
        if best is not None:
            axes.axvline(factor.scale * best, color=TEXT, linewidth=1, linestyle='--')
        plain_axes(axes, 'y')
        factor_axis(axes, factor)
        axes.set_ylim(bottom=0)
        if not result.objective.is_entropy:
            axes.yaxis.set_major_formatter(lambda share, _: f'{100 * share:.6g} %')
        if k % MAX_COLUMNS == 0:
            text = 'uncertainty\n(entropy, nat)' if result.objective.is_entropy else 'share'
            axes.set_ylabel(text, size=8.5, color=TEXT)
    figure.tight_layout(pad=0.6)
    return figure


def comparison_items(
    found: 'DesignComparison', pictures: dict[int, list[str]], confidence: float
) -> Iterator[Item]:
    """Yield what shows the aspects that two designs share; pictures by id(result)."""
    results = found.first, found.second
    first, second = (each.run.part for each in results)
    if not found.shared:
        yield Text(
            f'The parts share no aspects: their shapes differ by {found.apart:.2g} of the part '
            'radius on average.',
            'note',
        )
        return
    own, other = (class_rows(each.distribution) for each in results)
    headings = (first, f'{second} ', first, second, 'difference')
    table = Table('', headings, texts={headings[1]})
    for k, each in enumerate(found.shared):
        a, b = each.first - 1, each.second - 1
        one, two = own[a], other[b]
        shares = one.interval.probability, two.interval.probability
        difference = 100 * shown_difference(shares[1], shares[0], 1)
        table.pictures[k, 0] = pictures[id(found.first)][a]
        table.pictures[k, 1] = pictures[id(found.second)][b]
        table.add_row(
            one.name,
            two.name,
            _share(one),
            _share(two),
            f'{difference:+.1f} points\n{100 * each.lower:+.1f} to {100 * each.upper:+.1f}',
        )
    yield table
    ranges = 'Below the shares: model ranges. ' if own[0].model or other[0].model else ''
    yield (
        f'{ranges}The difference is {second} minus {first}, in percentage '
        f'points; small: {100 * confidence:g} % interval. The shapes are {found.apart:.2g} of the '
        'part radius apart on average.'
    )
    alone = []
    for name, rows, shared in (
        (first, own, {each.first for each in found.shared}),
        (second, other, {each.second for each in found.shared}),
    ):
        left = [row for k, row in enumerate(rows, start=1) if k not in shared]
        if left:
            texts = [f'{row.name} ({100 * row.interval.probability:.1f} %)' for row in left]
            alone.append(f'{name}: {", ".join(texts)}')
    if alone:
        yield f'Only in one of them: {"; ".join(alone)}.'


def _share(row: Row) -> str:
    """Return the share of a symmetry class, and below it its model range if it is known."""
    text = f'{100 * row.interval.probability:.1f} %'
    return text if row.model is None else f'{text}\n{interval_text(row.model)}'


def batch_page(batch: 'BatchResult', file: str) -> Page:
    """Return the index page of a batch."""
    results, failed = batch.results, [entry for entry in batch.entries if entry.error]
    pictures = {
        id(each): class_pictures(each.part, each.distribution.aspects)
        for each in results
        if each.part is not None
    }
    facts: dict[str, list[tuple[str, str]]] = {}
    if results:
        run = results[0].run
        facts['Conditions'] = [('all parts', conditions_text(run.conditions))]
        facts['Run'] = [
            ('seed of the batch', str(batch.seed)),
            ('engine', f'{run.engine} {run.engine_version}'),
        ]
    items: list[Item] = [*batch_range_texts(batch)]
    items += [
        _batch_entry(entry, entry.result, pictures[id(entry.result)])
        for entry in batch.entries
        if entry.result is not None
    ]
    if failed:
        items.append(Text('Parts that failed', 'part'))
        items.append(Findings([('yes', f'{each.source}:', each.error) for each in failed]))
    sections = [Section('Parts', 'parts', items)]
    for number, found in enumerate(batch.comparisons, start=1):
        heading = f'{found.first.run.part} and {found.second.run.part} side by side'
        compared = list(comparison_items(found, pictures, batch.confidence))
        sections.append(Section(heading, f'comparison-{number}', compared))
    notes = [f'{len(failed)} of {len(batch.entries)} parts failed; see below.'] if failed else []
    return Page(
        file=file,
        title=f'{len(results)} parts',
        topic='batch',
        lead='Parts under the same conditions',
        subtitle=f'{sum(each.distribution.drops for each in results)} drops',
        sections=sections,
        reading=reading('batch', confidence=f'{100 * batch.confidence:g}'),
        facts=facts,
        notes=notes,
    )


def _batch_entry(entry: 'BatchEntry', result: 'DropResult', pictures: list[str]) -> Gallery:
    """Return the most probable classes of a part."""
    found, name = result.distribution, result.run.part
    rows, tiles = class_rows(found), []
    for k in _most_probable(rows):
        row = rows[k]
        texts = [
            f'{100 * row.interval.probability:.1f} %',
            _percents(row.interval.lower, row.interval.upper),
        ]
        if row.model is not None:
            texts.append(model_range(row.model))
        tiles.append(Tile(row.name, row.colour, pictures[k], texts))
    numbers = f'{found.drops} drops, {len(found.aspects)} aspects'
    texts = [numbers] if entry.source == name else [entry.source, numbers]
    return Gallery(tiles, heading=name, link=f'{entry.folder}/{PAGE}', texts=texts)


def batch_table(batch: 'BatchResult') -> Table:
    """Return a table of the most probable classes of each part."""
    interval = f'{100 * batch.confidence:g} % interval'
    headings = ('part', 'aspects', 'proba-\nbility', interval, MODEL_RANGE)
    table = Table('', headings, texts={'part'})
    for result in batch.results:
        rows = class_rows(result.distribution)
        for number, k in enumerate(_most_probable(rows)):
            name = '' if number else result.run.part
            drops = result.distribution.drops
            probability, sampling, _ = shares(rows[k].interval, rows[k].count, drops)
            table.add_row(name, short_name(rows[k]), probability, sampling, model_text(rows[k]))
    return table


def batch_range_texts(batch: 'BatchResult') -> list[str]:
    """Return what the model ranges of the parts cover, and why there are none; each text once."""
    texts = [each.range_text for each in batch.results]
    return list(dict.fromkeys(filter(None, texts)))


def _most_probable(rows: Sequence[Row]) -> list[int]:
    """Return the indices of the classes with the most drops."""
    return sorted(range(len(rows)), key=lambda k: -rows[k].count)[:TOP]


def _percents(low: float, high: float) -> str:
    return f'{100 * low:.1f} to {100 * high:.1f} %'
