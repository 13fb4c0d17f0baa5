"""The files of a report on transitions, or on retention curves."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.api.condition_text import condition_facts
from resting_aspects_ros.api.measured_trials import MeasuredComparison
from resting_aspects_ros.api.report_files import (
    check_files,
    energy_text,
    part_facts,
    run_facts,
    warning_notes,
    write_files,
)
from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.report.format import (
    ids_text,
    interval_text,
    points_text,
    probability_text,
)
from resting_aspects_ros.report.reorientation_page import reorientation_files
from resting_aspects_ros.report.reorientation_report import (
    PAGE,
    RETENTION_PAGE,
    ActionReport,
    ReorientationReport,
    Shares,
    Way,
    reorientation_file_names,
)
from resting_aspects_ros.report.table import NOTHING
from resting_aspects_ros.simulation.actions import TIME, NamedAction
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, quantities_of
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.markov import wanted_mask
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

if TYPE_CHECKING:
    from resting_aspects_ros.api.reorient_result import PlanResult, ReorientResult
    from resting_aspects_ros.api.retention import RetentionResult

Facts = list[tuple[str, str]]
# Conditions that matter only for drops.
_RELEASE = {
    QUANTITIES[name].label for name in ('height', 'speed_horizontal', 'speed_vertical', 'spin')
}


def check_reorientation_report(flag: str, folder: Path, actions: Sequence[str]) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written.

    ``actions`` are the names of the actions; without any, the report is on retention curves.
    """
    check_files(flag, folder, reorientation_file_names(actions))


def write_reorientation_report(
    results: Sequence['ReorientResult'],
    folder: Path,
    *,
    wanted: Sequence[int] = (),
    plan: 'PlanResult | None' = None,
    checks: Sequence[MeasuredComparison] = (),
    simulated: Sequence['ReorientResult'] = (),
) -> Path:
    """Write a report on one or several actions, and return the path of the page.

    Parameters
    ----------
    results : sequence of ReorientResult
        Results of different actions on the same part under the same conditions.
    wanted : sequence of int
        Ids of wanted aspects.
    plan : PlanResult or None
        The best plan, if it is to be shown.
    checks : sequence of MeasuredComparison
        Comparisons with measured trials of any of the actions.
    simulated : sequence of ReorientResult
        Where rows of ``results`` are measured: the results in which they are simulated.

    Raises OutputError if a file cannot be written.
    """
    first = results[0]
    names = [result.action.name for result in results]
    runs = [f'Run of {name}' for name in names] if len(names) > 1 else ['Run']
    report = ReorientationReport(
        title=first.run.part,
        subtitle=f'{", ".join(names)} on {conditions_text(first.run.conditions)}, '
        f'seed {first.run.seed}',
        part=first.part,
        aspects=first.matrix.aspects,
        confidence=first.matrix.confidence,
        actions=[
            _action_report(result, before, wanted, checks)
            for result, before in zip(results, simulated or results, strict=True)
        ],
        wanted=tuple(sorted(set(wanted))),
        plan=None if plan is None else (plan.plan, plan.names),
        notes=warning_notes(first.part),
        facts={
            'Part': part_facts(first.part, first.run, first.matrix.aspects),
            **_condition_facts(first.run.conditions),
            **dict(zip(runs, map(_run_facts, simulated or results), strict=True)),
        },
    )
    write_files(folder, reorientation_files(report), reorientation_file_names(names))
    return folder / PAGE


def write_retention_report(result: 'RetentionResult', folder: Path) -> Path:
    """Write a report on retention curves, and return the path of the page. Raises OutputError."""
    run, part = result.run, result.part
    done = sum(int(curve.parts.sum()) for curve in result.curves)
    each = max(int(curve.parts.max(initial=0)) for curve in result.curves)
    notes = [] if result.complete else [_incomplete(done, run.drops, 'disturbances')]
    report = ReorientationReport(
        title=run.part,
        subtitle=f'disturbed on {conditions_text(run.conditions)}, seed {run.seed}',
        part=part,
        aspects=result.aspects,
        confidence=result.curves[0].confidence,
        curves=result.curves,
        gravity=run.conditions.gravity,
        notes=[*notes, *warning_notes(part)],
        facts={
            'Part': part_facts(part, run, result.aspects),
            'Conditions': _condition_facts(run.conditions)['Conditions'],
            'Run': [
                *run_facts(run, done, 'disturbances'),
                ('disturbances from each aspect at each lift height', str(each)),
            ],
        },
    )
    write_files(folder, reorientation_files(report), reorientation_file_names(()))
    return folder / RETENTION_PAGE


def _action_report(
    result: 'ReorientResult',
    simulated: 'ReorientResult',
    wanted: Sequence[int],
    checks: Sequence[MeasuredComparison],
) -> ActionReport:
    action, matrix, drop = result.action, result.matrix, result.drop
    way = None
    notes = list(_notes(result, simulated))
    if wanted and (matrix.actions > 0).all():
        with analysis('the way to the wanted aspects', notes):
            way = Way(wanted_mask(wanted, len(matrix.counts)), *result.reach(wanted))
    convergence = ''
    if result.convergence is not None:
        classes = map(_named, matrix.aspects.classes())
        convergence = result.convergence.text([*classes, *OUTCOMES])
    by_class, by_aspect = _shares(result.by_class()), _shares(result)
    return ActionReport(
        name=action.name,
        text=f'{action.action.kind}: {_count_text(simulated.matrix)}',
        source=action.source,
        title=result.title,
        values=list(_action_facts(action)),
        drop=f'{int(drop.counts.sum())} of {drop.drops} drops came to rest in an aspect.',
        matrix=matrix,
        shares=(by_class, by_aspect) if by_class and by_aspect else None,
        way=way,
        measured=[_check_cells(each) for each in checks if each.pair.action == action.name],
        convergence=convergence.replace('\n', ' '),
        notes=tuple(notes),
    )


def _count_text(matrix: TransitionMatrix) -> str:
    low, high = matrix.actions.min(), matrix.actions.max()
    number = f'{low}' if low == high else f'{low} to {high}'
    return f'{matrix.actions.sum()} actions, {number} from each aspect'


def _named(aspects: tuple[Aspect, ...]) -> str:
    return f'aspect{"s" * (len(aspects) > 1)} {ids_text(aspects)}'


def _shares(result: 'ReorientResult') -> Shares | None:
    if result.long_run is None:
        return None
    return Shares(result.long_run, *result.long_run_bounds, result.drop_shares)


def _notes(result: 'ReorientResult', simulated: 'ReorientResult') -> Iterator[str]:
    matrix = result.matrix
    if not result.complete:
        done = int(simulated.matrix.actions.sum())
        yield _incomplete(done, result.run.drops, 'actions')
    if not result.action.action.has_effect:
        yield 'The action has no effect: every part stays where it is.'
    replaced = (matrix.counts != simulated.matrix.counts).any(axis=1)
    if replaced.any():
        aspects = tuple(matrix.aspects.aspects[k] for k in np.flatnonzero(replaced))
        measured = 'are measured trials instead of simulated actions'
        yield f'The transitions from {_named(aspects)} {measured}.'


def _incomplete(done: int, requested: int, what: str) -> str:
    return f'The run is not complete: it has {done} of {requested} {what}.'


def _action_facts(action: NamedAction) -> Iterator[tuple[str, str]]:
    for name, quantity in quantities_of(action.action).items():
        value = getattr(action.action, name)
        yield quantity.label, f'{value:g} {quantity.unit}'.rstrip()
    yield TIME.text, f'{action.time:g} {TIME.unit}'


def _condition_facts(conditions: DropConditions) -> dict[str, Facts]:
    """Return the conditions of the contact, and those that matter only for the drops."""
    facts = list(condition_facts(conditions))
    release = [fact for fact in facts if fact[0].partition(' (')[0] in _RELEASE]
    contact = [fact for fact in facts if fact not in release]
    return {
        'Conditions': [('surface', conditions_text(conditions)), *contact],
        'Release of the drops': release,
    }


def _run_facts(result: 'ReorientResult') -> Facts:
    growth = energy_text(result.matrix.energy_growth, result.part)
    return [
        *run_facts(result.run, int(result.matrix.actions.sum()), 'actions'),
        ('number of drops', str(result.drop.drops)),
        ('maximum energy gain in an action', growth),
    ]


def _check_cells(check: MeasuredComparison) -> tuple[str, ...]:
    pair = check.pair
    simulated = difference = NOTHING
    if check.actions:
        simulated = _share_cell(check.simulated)
        difference = points_text(check.difference, check.lower, check.upper)
    return (
        str(pair.from_aspect),
        str(pair.to_aspect),
        f'{pair.successes} of {pair.trials}, {_share_cell(check.measured)}',
        simulated,
        difference,
        check.verdict,
    )


def _share_cell(share: Interval) -> str:
    return f'{probability_text(share)}\n{interval_text(share)}'
