"""The pages of the results: of drops, of actions, and of retention curves."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.conditions import (
    condition_facts,
    conditions_text,
    contact_planes,
    outcome_hints,
    pieces_text,
    scene_of,
    simulated_pieces,
    when_text,
)
from resting_aspects_ros.api.counts import CountedDrops, counted_by_class, counts_of_run
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.estimate import METHODS, RestingShape, estimate_each
from resting_aspects_ros.aspects.support import NONE
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.input_files import printable
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.comparison import ComparedResults
from resting_aspects_ros.report.drop_page import drop_page
from resting_aspects_ros.report.drops import MAX_ROWS, contact_table, symmetry_text
from resting_aspects_ros.report.format import (
    GREY,
    aspect_colour,
    aspects_text,
    ids_text,
    rgb,
    size_text,
)
from resting_aspects_ros.report.page import (
    Chart,
    Item,
    Page,
    Section,
    Text,
    file_names,
    picture_uri,
    reading,
)
from resting_aspects_ros.report.picture import contact_image, picture_part
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.report.transitions import (
    Rows,
    actions_table,
    long_run_table,
    long_run_text,
    plan_table,
    retention_figure,
    retention_note,
    retention_table,
    suffix_of,
    table_rows,
    transition_figure,
    transition_note,
    transition_table,
    wanted_table,
)
from resting_aspects_ros.simulation.conditions import DropConditions, quantities_of
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import (
    BODY_VALUES,
    RELEASE_VALUES,
    Surroundings,
    value_text,
)
from resting_aspects_ros.statistics.comparison import compare
from resting_aspects_ros.statistics.transitions import OUTCOMES

if TYPE_CHECKING:
    from resting_aspects_ros.api.drop import DropResult
    from resting_aspects_ros.api.reorient import PlanResult, ReorientResult
    from resting_aspects_ros.api.retention import RetentionResult


# -- Page on drops --------------------------------------------------------------------------------


# Seed of the Monte Carlo p values, so that equal inputs give equal reports.
SEED = 1
# Side of a picture of a placement, pixels: twice its size on the page.
PIXELS = 400


def result_page(result: 'DropResult', against: CountedDrops | None = None) -> Page:
    """Return the page of a result, compared with other counts if there are any."""
    distribution, part = result.distribution, result.part
    more: dict[str, Any] = {}
    notes = list(_notes(result))
    # The methods assume a level plane.
    level = result.run.conditions.surroundings is None
    if part is not None and len(distribution.aspects) and level:
        with analysis('the analytic estimates', notes):
            shape = RestingShape(part, distribution.aspects)
            found, more['not_defined'] = estimate_each(shape, METHODS)
            more['estimates'] = {name: each.probabilities for name, each in found.items()}
    with analysis('the table of contacts', notes):
        more['contacts'] = contact_page_table(result)
    if against is not None:
        with analysis('the comparison with the measured counts', notes):
            more['measured'] = _measured(result, against)
    return drop_page(
        distribution,
        part,
        result.run.part,
        result.subtitle,
        notes=notes,
        facts=_facts(result),
        history=result.history,
        range_text=result.range_text,
        level_floor=level,
        **more,
    )


def _measured(result: 'DropResult', against: CountedDrops) -> ComparedResults:
    """Return the comparison with other counts, by the rows of the page."""
    distribution = result.distribution
    own = counted_by_class(counts_of_run('', distribution, result.run, complete=True))
    other = counted_by_class(against, distribution.aspects)
    found = compare(own.tally, other.tally, np.random.default_rng(SEED), distribution.confidence)
    labels = 'simulated', printable(Path(against.source).name)
    names = tuple(map(ids_text, distribution.aspects.classes()))
    tallies, models = (own.tally, other.tally), (own.model, other.model)
    return ComparedResults(own.ids, names, *tallies, found, 'aspect', labels, models)


def _notes(result: 'DropResult') -> Iterator[str]:
    run, drops = result.run, result.distribution.drops
    if not result.complete:
        yield _incomplete(drops, run, 'drops')
    yield from outcome_hints(result.distribution, run.conditions)
    if result.convergence is not None:
        yield result.convergence.text().replace('\n', ' ')
    if result.part is None:
        yield (
            'The mesh of the part is not available. Therefore this report has no pictures and '
            'no analytic estimates.'
        )
    else:
        yield from warning_notes(result.part)


def warning_notes(part: Part) -> list[str]:
    """Return the warnings of a part as sentences."""
    return [f'{warning[0].upper()}{warning[1:]}.' for warning in part.warnings]


def _facts(result: 'DropResult') -> dict[str, list[tuple[str, str]]]:
    run, distribution = result.run, result.distribution
    return {
        'Part': part_facts(result.part, run, distribution.aspects),
        'Conditions': surface_facts(run.conditions),
        **_surroundings_facts(result),
        'Run': [
            *run_facts(run, distribution.drops, 'drops'),
            (
                'maximum energy gain in a drop',
                energy_text(distribution.energy_growth, result.part),
            ),
        ],
    }


def surface_facts(conditions: DropConditions) -> list[tuple[str, str]]:
    """Return label and value of the surface and of each condition."""
    return [('surface', conditions_text(conditions)), *condition_facts(conditions)]


def _surroundings_facts(result: 'DropResult') -> dict[str, list[tuple[str, str]]]:
    """Return the surroundings in words, below their heading; empty for the level plane."""
    conditions = result.run.conditions
    if conditions.surroundings is None:
        return {}
    facts = list(_shape_facts(conditions.surroundings))
    if pieces := simulated_pieces(result.part, conditions):
        facts.append(('as simulated', pieces_text(pieces, 'The surroundings meet')))
    return {'Surroundings': facts}


def run_facts(run: RunDescription, done: int, what: str) -> list[tuple[str, str]]:
    """Return label and value of each property of a run; ``what`` was done ``done`` times."""
    requested = f'{run.drops}' if not run.precision else f'up to {run.drops}'
    facts = [(f'number of {what}', f'{done} of {requested}')]
    if run.precision:
        facts.append(('required precision', f'intervals of at most ±{run.precision:g}'))
    return [
        *facts,
        ('seed', str(run.seed)),
        *([('index of the first drop', str(run.first_drop))] if run.first_drop else []),
        ('engine', f'{run.engine} {run.engine_version}'),
        ('time step', f'{run.time_step:.3g} s'),
        ('resting_aspects_ros', run.suite_version),
        ('date', when_text(run.started)),
        ('run id', run.run_id),
    ]


def energy_text(growth: float, part: Part | None) -> str:
    """Return the energy that the engine added, m g R, as the rise of the part that it equals."""
    if part is None:
        return f'equal to a rise by {growth:.2g} of the part radius'
    return f'equal to a rise by {1000 * growth * part.hull_radius:.2g} mm'


def part_facts(
    part: Part | None, run: RunDescription, aspects: AspectSet | None
) -> list[tuple[str, str]]:
    """Return label and value of each property of a part, which may not be available."""
    hashes = [('part sha256', run.part_sha256)]
    if part is None:
        return [('name', run.part), *hashes]
    symmetry = None if aspects is None else aspects.symmetry
    return [
        ('name', part.name),
        ('size along the mesh axes', size_text(part)),
        ('mesh', f'{part.mesh_format} in {part.unit}, {len(part.faces)} triangles'),
        ('mass', f'{1000 * part.mass:.4g} g'),
        *([('symmetry', symmetry_text(symmetry))] if symmetry is not None else []),
        ('mesh sha256', part.mesh_sha256),
        *hashes,
    ]


def contact_page_table(result: 'DropResult') -> Table | None:
    """Return the table of contacts with a picture in each row; None without walls or part."""
    part, contacts, distribution = result.part, result.contacts, result.distribution
    if part is None or contacts is None:
        return None
    planes = contact_planes(scene_of(part, result.run.conditions))
    drawn = picture_part(part)
    table = contact_table(contacts, distribution)
    table.picture_width = PIXELS // 2
    rows = contacts.sorted_rows(distribution.interval, distribution.confidence)
    for k, (placement, _) in enumerate(rows[:MAX_ROWS]):
        colour = _colour(distribution.aspects, placement.contacts)
        image = contact_image(
            drawn, placement.orientation, placement.contacts, planes, colour, PIXELS
        )
        table.pictures[k, 0] = picture_uri(image)
    return table


def _colour(aspects: AspectSet, contacts: tuple[int, ...]) -> Array:
    """Return the colour of the first aspect on which the part lies, lighter than its contacts."""
    lies = next((code for code in contacts if code > NONE), None)
    colour = np.array(rgb(GREY if lies is None else aspect_colour(aspects[lies - 1])))
    return np.asarray(0.65 * colour + 0.35)


def _shape_facts(surroundings: Surroundings) -> Iterator[tuple[str, str]]:
    """Yield label and value: the kind, its dimensions, the release, and bodies with own values.

    All others have those of the conditions.
    """
    shape = surroundings.shape
    yield 'kind', shape.kind.replace('_', ' ')
    for name, quantity in quantities_of(shape).items():
        yield quantity.label, value_text(getattr(shape, name), quantity.unit)
    for name, text in getattr(shape, 'texts', {}).items():
        yield name.replace('_', ' '), text
    for body, own in surroundings.bodies.items():
        values = [
            f'{BODY_VALUES[key].label} {value_text(value, BODY_VALUES[key].unit)}'
            for key, value in own.items()
        ]
        yield body.replace('_', ' '), ', '.join(values)
    for name, value in surroundings.release.items():
        yield RELEASE_VALUES[name].text, value_text(value, 'm')
    if surroundings.orientation is not None:
        x, y, z, w = surroundings.orientation
        yield 'orientation at release', f'x {x:.4g}, y {y:.4g}, z {z:.4g}, w {w:.4g}'


# -- Pages on actions and on retention ------------------------------------------------------------


# The page on actions, and that on retention curves.
PAGE, RETENTION_PAGE = 'reorientation.html', 'retention.html'
HEAT_MAP, RETENTION = 'transitions', 'retention'


def reorientation_page(
    results: Sequence['ReorientResult'],
    *,
    wanted: Sequence[int] = (),
    plan: 'PlanResult | None' = None,
    each: bool = False,
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
    each : bool
        Whether tables have a row for each aspect, even for those that look the same.
    """
    first = results[0]
    names = [result.action.name for result in results]
    runs = [f'Run of {name}' for name in names] if len(names) > 1 else ['Run']
    sections = [
        Section(
            f'Action {result.action.name}',
            f'action-{number}',
            list(_action_items(result, wanted, suffix_of(result.action.name, names), each=each)),
        )
        for number, result in enumerate(results, start=1)
    ]
    by_class = not each and _whole_classes(first, wanted)
    views = [result.by_class() if by_class else result for result in results]
    shares = {v.action.name: v.long_run.shares for v in views if v.long_run is not None}
    if len(shares) > 1:
        rows = table_rows(first.matrix.aspects, by_class=by_class)
        drop = views[0].drop_shares
        mask = _wanted_rows(wanted, rows)
        table = actions_table(rows, drop / drop.sum(), shares, mask, '')
        sections.append(Section('Long run by action', 'actions', [table]))
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
            'Conditions': surface_facts(first.run.conditions),
            **dict(zip(runs, map(_action_run_facts, results), strict=True)),
        },
        notes=warning_notes(first.part),
        names=file_names(PAGE, [HEAT_MAP + suffix_of(name, names) for name in names]),
    )


def _action_items(
    result: 'ReorientResult', wanted: Sequence[int], suffix: str, *, each: bool
) -> Iterator[Item]:
    """Yield what the page shows of one action."""
    action, matrix = result.action, result.matrix
    low, high = matrix.actions.min(), matrix.actions.max()
    number = f'{low}' if low == high else f'{low} to {high}'
    yield f'{action.text}: {matrix.actions.sum()} actions, {number} from each aspect.'
    if not result.complete:
        yield Text(_incomplete(int(matrix.actions.sum()), result.run, 'actions'), 'note')
    if not action.action.has_effect:
        yield Text('The action has no effect: every part stays where it is.', 'note')
    if action.source:
        yield f'Source of these values: {action.source}'
    yield Text('Transitions', 'part')
    yield Chart(
        HEAT_MAP + suffix,
        f'Heat map of the transition probabilities of {action.name}',
        partial(transition_figure, matrix, result.part, ''),
        transition_note(matrix),
        result.figure,
    )
    yield transition_table(matrix, by_class=not each)
    if matrix.sliding:
        yield Text(f'Of the unsettled parts, {matrix.sliding} slide or roll for ever.', 'plain')
    if result.pieces is not None:
        yield Text(pieces_text(result.pieces, 'The edge meets'), 'plain')
    if result.convergence is not None:
        classes = map(aspects_text, matrix.aspects.classes())
        yield Text(result.convergence.text([*classes, *OUTCOMES]).replace('\n', ' '), 'plain')
    yield Text('Long run', 'part')
    yield from _long_run_items(result, each=each)
    if wanted and (matrix.actions > 0).all():
        yield Text(f'The way to {_wanted_text(result, wanted)}', 'part')
        yield from _way_items(result, wanted, each=each)


def _long_run_items(result: 'ReorientResult', *, each: bool) -> Iterator[Item]:
    view = result if each else result.by_class()
    if view.long_run is None:
        yield (
            'The shares in the long run are not known: actions from each aspect, and drops that '
            'come to rest in an aspect, are needed for them.'
        )
        return
    rows = table_rows(result.matrix.aspects, by_class=not each)
    confidence = result.matrix.confidence
    table = long_run_table(
        rows, view.long_run, *view.long_run_bounds, view.drop_shares, '', confidence
    )
    table.caption = long_run_text(rows, view.long_run)
    yield table
    drop = result.drop
    yield (
        f'The shares to which repeated actions lead, with {100 * confidence:g} % intervals, '
        f'beside the shares of a drop. {int(drop.counts.sum())} of {drop.drops} drops came to '
        'rest in an aspect. The intervals contain the uncertainty of the transitions; the shares '
        'of the drop are taken as known.'
    )


def _way_items(result: 'ReorientResult', wanted: Sequence[int], *, each: bool) -> Iterator[Item]:
    with analysis('the way to the wanted aspects'):
        by_class = not each and _whole_classes(result, wanted)
        view = result.by_class() if by_class else result
        rows = table_rows(result.matrix.aspects, by_class=by_class)
        mask = _wanted_rows(wanted, rows)
        yield wanted_table(rows, mask, *view.reach((np.flatnonzero(mask) + 1).tolist()), '')
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


def _whole_classes(result: 'ReorientResult', wanted: Sequence[int]) -> bool:
    """Return whether whole classes are wanted; if not, the aspects of a class differ."""
    classes = [{aspect.id for aspect in row} for row in result.matrix.aspects.classes()]
    return all(ids.isdisjoint(wanted) or ids <= {*wanted} for ids in classes)


def _wanted_rows(wanted: Sequence[int], rows: Rows) -> npt.NDArray[np.bool_]:
    """Return which rows have wanted aspects only, (rows,) bool."""
    return np.array([all(aspect.id in wanted for aspect in row) for row in rows])


def _wanted_text(result: 'ReorientResult', wanted: Sequence[int]) -> str:
    return aspects_text(tuple(result.matrix.aspects[k - 1] for k in sorted(set(wanted))))


def retention_page(result: 'RetentionResult') -> Page:
    """Return a page on retention curves."""
    run, part, curves = result.run, result.part, result.curves
    done = sum(int(curve.parts.sum()) for curve in curves)
    each = max(int(curve.parts.max(initial=0)) for curve in curves)
    notes = [] if result.complete else [_incomplete(done, run, 'disturbances')]
    items: list[Item] = [
        Chart(
            RETENTION,
            'Line chart of the probability to leave each aspect against the lift height',
            partial(retention_figure, curves, result.aspects, part, ''),
            retention_note(curves, result.aspects),
            result.figure,
        ),
        retention_table(curves, '', run.conditions.gravity),
        (
            'The lift heights at which 1, 10 and 50 % of the parts have left the aspect, with '
            f'{100 * curves[0].confidence:g} % intervals.'
        ),
    ]
    return Page(
        file=RETENTION_PAGE,
        title=run.part,
        topic='retention',
        lead='How firmly the part rests in each aspect',
        subtitle=result.subtitle,
        sections=[Section('Retention', 'retention', items)],
        reading=reading('retention'),
        facts={
            'Part': part_facts(part, run, result.aspects),
            'Conditions': surface_facts(run.conditions),
            'Run': [
                *run_facts(run, done, 'disturbances'),
                ('disturbances from each aspect at each lift height', str(each)),
            ],
        },
        notes=[*notes, *warning_notes(part)],
        names=file_names(RETENTION_PAGE, [RETENTION]),
    )


def _incomplete(done: int, run: RunDescription, what: str) -> str:
    goal = f'a precision of ±{run.precision:g}' if run.precision else f'{run.drops} {what}'
    return f'The run is not complete: it has {done} {what}; requested: {goal}.'


def _action_run_facts(result: 'ReorientResult') -> list[tuple[str, str]]:
    growth = energy_text(result.matrix.energy_growth, result.part)
    return [
        *run_facts(result.run, int(result.matrix.actions.sum()), 'actions'),
        ('number of drops', str(result.drop.drops)),
        ('time of an action', f'{result.action.time:g} s'),
        ('maximum energy gain in an action', growth),
    ]
