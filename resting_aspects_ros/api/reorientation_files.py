"""The pages on transitions and on retention curves, and their files."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from resting_aspects_ros.api.conditions import condition_facts, conditions_text
from resting_aspects_ros.api.report_files import (
    energy_text,
    part_facts,
    run_facts,
    warning_notes,
)
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.report.format import aspects_text
from resting_aspects_ros.report.page import (
    Chart,
    Facts,
    Fold,
    Item,
    Page,
    Section,
    Text,
    file_names,
    reading,
)
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.report.transition_figures import (
    retention_figure,
    retention_note,
    transition_figure,
    transition_note,
)
from resting_aspects_ros.report.transitions import (
    interval_table,
    long_run_table,
    long_run_text,
    plan_table,
    retention_counts_table,
    retention_table,
    suffix_of,
    table_rows,
    wanted_table,
)
from resting_aspects_ros.simulation.actions import TIME, NamedAction
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, quantities_of
from resting_aspects_ros.statistics.markov import wanted_mask
from resting_aspects_ros.statistics.transitions import OUTCOMES

if TYPE_CHECKING:
    from resting_aspects_ros.api.reorient import PlanResult, ReorientResult
    from resting_aspects_ros.api.retention import RetentionResult

# The page on actions, and that on retention curves.
PAGE, RETENTION_PAGE = 'reorientation.html', 'retention.html'
HEAT_MAP, RETENTION = 'transitions', 'retention'
# Conditions that matter only for drops.
_RELEASE = {
    QUANTITIES[name].label for name in ('height', 'speed_horizontal', 'speed_vertical', 'spin')
}


def reorientation_file_names(actions: Sequence[str]) -> list[str]:
    """Return the names of all files of a page on these actions; without any, on retention."""
    figures = [HEAT_MAP + suffix_of(name, actions) for name in actions]
    return file_names(PAGE, figures) if actions else file_names(RETENTION_PAGE, [RETENTION])


def reorientation_page(
    results: Sequence['ReorientResult'],
    *,
    wanted: Sequence[int] = (),
    plan: 'PlanResult | None' = None,
) -> Page:
    """Return a page on one or several actions.

    Parameters
    ----------
    results : sequence of ReorientResult
        Results of different actions on the same part under the same conditions.
    wanted : sequence of int
        Ids of wanted aspects.
    plan : PlanResult or None
        The best plan, if it is to be shown.
    """
    first = results[0]
    names = [result.action.name for result in results]
    runs = [f'Run of {name}' for name in names] if len(names) > 1 else ['Run']
    sections = [
        Section(
            f'Action {result.action.name}',
            f'action-{number}',
            list(_action_items(result, wanted, suffix_of(result.action.name, names))),
        )
        for number, result in enumerate(results, start=1)
    ]
    if plan is not None:
        sections.append(_plan_section(first, plan, wanted))
    return Page(
        file=PAGE,
        title=first.run.part,
        topic='reorientation',
        lead='How the part gets from aspect to aspect',
        subtitle=f'{", ".join(names)} on {conditions_text(first.run.conditions)}, '
        f'seed {first.run.seed}',
        sections=sections,
        reading=reading('reorientation'),
        facts={
            'Part': part_facts(first.part, first.run, first.matrix.aspects),
            **_condition_facts(first.run.conditions),
            **dict(zip(runs, map(_run_facts, results), strict=True)),
        },
        notes=warning_notes(first.part),
        contents=len(results) > 1,
        names=reorientation_file_names(names),
    )


def _action_items(result: 'ReorientResult', wanted: Sequence[int], suffix: str) -> Iterator[Item]:
    """Yield what the page shows of one action."""
    action, matrix = result.action, result.matrix
    low, high = matrix.actions.min(), matrix.actions.max()
    each = f'{low}' if low == high else f'{low} to {high}'
    yield f'{action.action.kind}: {matrix.actions.sum()} actions, {each} from each aspect.'
    for note in _notes(result):
        yield Text(note, 'note')
    yield Facts(list(_action_facts(action)))
    if action.source:
        yield f'Source of these values: {action.source}'
    yield Text('Transitions', 'part')
    draw = partial(transition_figure, matrix, result.part)
    yield Chart(
        HEAT_MAP + suffix,
        f'Heat map of the transition probabilities of {action.name}',
        partial(draw, ''),
        transition_note(matrix),
        partial(draw, result.title),
    )
    yield from _by_class_and_aspect(
        result, [interval_table(matrix, by_class) for by_class in (True, False)]
    )
    if result.convergence is not None:
        classes = map(aspects_text, matrix.aspects.classes())
        yield Text(result.convergence.text([*classes, *OUTCOMES]).replace('\n', ' '), 'plain')
    yield Text('Long run', 'part')
    yield from _long_run_items(result)
    if wanted and (matrix.actions > 0).all():
        yield Text(f'The way to {_wanted_text(result, wanted)}', 'part')
        yield from _way_items(result, wanted)


def _by_class_and_aspect(result: 'ReorientResult', tables: Sequence[Table]) -> Iterator[Item]:
    """Yield the table by class, and folded that by aspect if it differs."""
    aspects = result.matrix.aspects
    yield tables[0]
    if len(aspects.classes()) < len(aspects):
        yield Fold('by aspect', [tables[1]])


def _long_run_items(result: 'ReorientResult') -> Iterator[Item]:
    views = [result.by_class(), result]
    if any(view.long_run is None for view in views):
        yield (
            'The shares in the long run are not known: actions from each aspect, and drops that '
            'come to rest in an aspect, are needed for them.'
        )
        return
    tables = []
    for view, by_class in zip(views, (True, False), strict=True):
        assert view.long_run is not None
        rows = table_rows(result.matrix.aspects, by_class=by_class)
        confidence = result.matrix.confidence
        table = long_run_table(
            rows, view.long_run, *view.long_run_bounds, view.drop_shares, '', confidence
        )
        table.caption = long_run_text(rows, view.long_run)
        tables.append(table)
    yield from _by_class_and_aspect(result, tables)
    drop = result.drop
    yield (
        'The shares to which repeated actions lead, with '
        f'{100 * result.matrix.confidence:g} % intervals, beside the shares of a drop. '
        f'{int(drop.counts.sum())} of {drop.drops} drops came to rest in an aspect. The intervals '
        'contain the uncertainty of the transitions; the shares of the drop are taken as known.'
    )


def _way_items(result: 'ReorientResult', wanted: Sequence[int]) -> Iterator[Item]:
    with analysis('the way to the wanted aspects'):
        rows = table_rows(result.matrix.aspects, by_class=False)
        mask = wanted_mask(wanted, len(rows))
        yield wanted_table(rows, mask, *result.reach(wanted), '')
        yield (
            'Probability that repeated actions lead to a wanted aspect before the part leaves the '
            'aspects, and the expected number of actions if it gets there.'
        )


def _plan_section(result: 'ReorientResult', plan: 'PlanResult', wanted: Sequence[int]) -> Section:
    rows = table_rows(result.matrix.aspects, by_class=False)
    text = (
        f'The action in each aspect with which the part is in {_wanted_text(result, wanted)} '
        'after the least expected time. A part that leaves the aspects is replaced by a dropped '
        'part, which takes no time.'
    )
    return Section('Best plan', 'plan', [text, plan_table(rows, plan.plan, plan.names, '')])


def _wanted_text(result: 'ReorientResult', wanted: Sequence[int]) -> str:
    return aspects_text(tuple(result.matrix.aspects[k - 1] for k in sorted(set(wanted))))


def retention_page(result: 'RetentionResult') -> Page:
    """Return a page on retention curves."""
    run, part, curves = result.run, result.part, result.curves
    done = sum(int(curve.parts.sum()) for curve in curves)
    each = max(int(curve.parts.max(initial=0)) for curve in curves)
    notes = [] if result.complete else [_incomplete(done, run.drops, 'disturbances')]
    subtitle = f'disturbed on {conditions_text(run.conditions)}, seed {run.seed}'
    draw = partial(retention_figure, curves, result.aspects, part)
    items: list[Item] = [
        Chart(
            RETENTION,
            'Line chart of the probability to leave each aspect against the lift height',
            partial(draw, ''),
            retention_note(curves, result.aspects),
            partial(draw, f'{run.part}, {subtitle}'),
        ),
        retention_table(curves, '', run.conditions.gravity),
        (
            'The lift heights at which 1, 10 and 50 % of the parts have left the aspect, with '
            f'{100 * curves[0].confidence:g} % intervals.'
        ),
        Fold('all lift heights', [retention_counts_table(curves, '')]),
    ]
    return Page(
        file=RETENTION_PAGE,
        title=run.part,
        topic='retention',
        lead='How firmly the part rests in each aspect',
        subtitle=subtitle,
        sections=[Section('Retention', 'retention', items)],
        reading=reading('retention'),
        facts={
            'Part': part_facts(part, run, result.aspects),
            'Conditions': _condition_facts(run.conditions)['Conditions'],
            'Run': [
                *run_facts(run, done, 'disturbances'),
                ('disturbances from each aspect at each lift height', str(each)),
            ],
        },
        notes=[*notes, *warning_notes(part)],
        names=reorientation_file_names(()),
    )


def _notes(result: 'ReorientResult') -> Iterator[str]:
    if not result.complete:
        yield _incomplete(int(result.matrix.actions.sum()), result.run.drops, 'actions')
    if not result.action.action.has_effect:
        yield 'The action has no effect: every part stays where it is.'


def _incomplete(done: int, requested: int, what: str) -> str:
    return f'The run is not complete: it has {done} of {requested} {what}.'


def _action_facts(action: NamedAction) -> Iterator[tuple[str, str]]:
    for name, quantity in quantities_of(action.action).items():
        value = getattr(action.action, name)
        yield quantity.label, f'{value:g} {quantity.unit}'.rstrip()
    yield TIME.text, f'{action.time:g} {TIME.unit}'


def _condition_facts(conditions: DropConditions) -> dict[str, list[tuple[str, str]]]:
    """Return the conditions of the contact, and those that matter only for the drops."""
    facts = list(condition_facts(conditions))
    release = [fact for fact in facts if fact[0].partition(' (')[0] in _RELEASE]
    contact = [fact for fact in facts if fact not in release]
    return {
        'Conditions': [('surface', conditions_text(conditions)), *contact],
        'Release of the drops': release,
    }


def _run_facts(result: 'ReorientResult') -> list[tuple[str, str]]:
    growth = energy_text(result.matrix.energy_growth, result.part)
    return [
        *run_facts(result.run, int(result.matrix.actions.sum()), 'actions'),
        ('number of drops', str(result.drop.drops)),
        ('maximum energy gain in an action', growth),
    ]
