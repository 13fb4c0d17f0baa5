"""The files of a report on a result."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.conditions import (
    condition_facts,
    contact_planes,
    has_level_floor,
    outcome_hints,
    scene_of,
    simulated_shapes,
    surface_text,
    when_text,
)
from resting_aspects_ros.api.counts import CountedDrops, counted_by_class
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
    ids_text,
    rgb,
    size_text,
)
from resting_aspects_ros.report.page import Page, picture_uri
from resting_aspects_ros.report.picture import picture_part
from resting_aspects_ros.report.scene_picture import contact_image
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.simulation.conditions import DropConditions, quantities_of
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import (
    BODY_VALUES,
    RELEASE_VALUES,
    Surroundings,
    value_text,
)
from resting_aspects_ros.statistics.comparison import Comparison, DropCounts, compare

if TYPE_CHECKING:
    from resting_aspects_ros.api.drop_result import DropResult

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
        level_floor=has_level_floor(result.run.conditions),
        **more,
    )


def _measured(result: 'DropResult', against: CountedDrops) -> tuple[Comparison, ComparedResults]:
    """Return the comparison by class with other counts."""
    tally = counted_by_class(against, result.distribution.aspects).tally
    own = result.distribution.by_class()
    counted = DropCounts(
        own.counts, own.unclassified, own.unsettled + own.lost + own.sliding, own.failed
    )
    found = compare(counted, tally, np.random.default_rng(SEED), own.confidence)
    classes = result.distribution.aspects.classes()
    sides = ComparedResults(
        tuple(members[0].symmetry_class for members in classes),
        None,
        counted,
        tally,
        'class',
        tuple(map(ids_text, classes)),
        ('simulated', printable(Path(against.source).name)),
        (own.model, against.model),
    )
    return found, sides


def _notes(result: 'DropResult') -> Iterator[str]:
    run, drops = result.run, result.distribution.drops
    if not result.complete:
        goal = f'a precision of ±{run.precision:g}' if run.precision else f'{run.drops} drops'
        yield f'The run is not complete: it has {drops} drops, and {goal} was requested.'
    radius = result.part.hull_radius if result.part is not None else None
    yield from outcome_hints(result.distribution, run.conditions, radius)
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
        'Conditions': [
            ('surface', surface_text(run.conditions)),
            *condition_facts(run.conditions),
        ],
        **_surroundings_facts(result),
        'Run': [
            *run_facts(run, distribution.drops, 'drops'),
            (
                'maximum energy gain in a drop',
                energy_text(distribution.energy_growth, result.part),
            ),
        ],
    }


def _surroundings_facts(result: 'DropResult') -> dict[str, list[tuple[str, str]]]:
    """Return the surroundings in words, below their heading; empty for the level plane."""
    conditions = result.run.conditions
    if conditions.surroundings is None:
        return {}
    shapes = simulated_shapes(result.part, conditions)
    simulated = [] if shapes is None else [('as simulated', text) for text in shapes.sentences()]
    return {'Surroundings': [*surroundings_facts(conditions.surroundings, conditions), *simulated]}


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
    part: Part | None, run: RunDescription, aspects: AspectSet
) -> list[tuple[str, str]]:
    """Return label and value of each property of a part, which may not be available."""
    hashes = [('part sha256', run.part_sha256)]
    if part is None:
        return [('name', run.part), *hashes]
    symmetry = aspects.symmetry
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
    drawn = picture_part(part, distribution.aspects)
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


def surroundings_facts(
    surroundings: Surroundings, conditions: DropConditions
) -> Iterator[tuple[str, str]]:
    """Yield label and value: the kind, its dimensions, each body, and the release.

    The friction and the other values of a body are those of the conditions unless it has its own.
    """
    shape = surroundings.shape
    yield 'kind', shape.kind.replace('_', ' ')
    for name, quantity in quantities_of(shape).items():
        yield quantity.label, value_text(getattr(shape, name), quantity.unit)
    for name, text in getattr(shape, 'texts', {}).items():
        yield name.replace('_', ' '), text
    for body in shape.body_names:
        own = surroundings.bodies.get(body, {})
        values = {
            key: own.get(key, 0.0 if key == 'speed' else getattr(conditions, key))
            for key in BODY_VALUES
        }
        if not values['speed']:
            del values['speed']
        yield (
            body.replace('_', ' '),
            ', '.join(
                f'{BODY_VALUES[key].label} {value_text(value, BODY_VALUES[key].unit)}'
                for key, value in values.items()
            ),
        )
    for name, value in surroundings.release.items():
        yield RELEASE_VALUES[name].text, value_text(value, 'm')
    if surroundings.orientation is not None:
        x, y, z, w = surroundings.orientation
        yield 'orientation at release', f'x {x:.4g}, y {y:.4g}, z {z:.4g}, w {w:.4g}'
