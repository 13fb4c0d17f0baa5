"""The files of a report on a result."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.condition_text import condition_facts, surface_text, when_text
from resting_aspects_ros.api.contact_pages import contact_page_rows
from resting_aspects_ros.api.counted_run import CountedRun
from resting_aspects_ros.api.inputs.counts import CountedDrops, counted_by_class
from resting_aspects_ros.api.output_files import check_output, make_folder, whole_file
from resting_aspects_ros.api.simulated_shapes import simulated_shapes
from resting_aspects_ros.api.surroundings import has_level_floor
from resting_aspects_ros.api.surroundings_facts import surroundings_facts
from resting_aspects_ros.api.surroundings_hints import outcome_hints
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import analysis
from resting_aspects_ros.core.estimators.estimate import METHODS, RestingShape, estimate_each
from resting_aspects_ros.core.input_file import printable
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.comparison import DropCounts, compare
from resting_aspects_ros.core.statistics.intervals import Array
from resting_aspects_ros.report.comparison_text import ReferenceCounts
from resting_aspects_ros.report.page import FILES, PAGE, ContactRow, Report, report_files
from resting_aspects_ros.report.rounding import size_text
from resting_aspects_ros.report.table import symmetry_text
from resting_aspects_ros.simulation.run_description import RunDescription

# Seed of the Monte Carlo p values, so that equal inputs give equal reports.
SEED = 1


def default_folder(part: str) -> Path:
    """Return the default folder of the report on a part."""
    return Path('out') / part


def check_report(flag: str, folder: Path) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    check_files(flag, folder, FILES)


def check_files(flag: str, folder: Path, names: Sequence[str]) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    make_folder(flag, folder)
    for name in names:
        check_output(flag, folder / name)


def write_report(result: CountedRun, folder: Path, against: CountedDrops | None = None) -> Path:
    """Write the report and return the path of the page. Raises OutputError."""
    write_files(folder, report_files(_report(result, against)), FILES)
    return folder / PAGE


def write_files(folder: Path, files: Iterable[tuple[str, bytes]], names: Sequence[str]) -> None:
    """Write the files, and remove those of ``names`` that an earlier report had in addition."""
    written = set()
    for name, data in files:
        with whole_file(folder / name) as file:
            file.write_bytes(data)
        written.add(name)
    for name in names:
        if name not in written:
            (folder / name).unlink(missing_ok=True)


def _report(result: CountedRun, against: CountedDrops | None) -> Report:
    distribution, part = result.distribution, result.part
    estimates: dict[str, Array] = {}
    reasons: dict[str, str] = {}
    contacts: list[ContactRow] = []
    measured: ReferenceCounts | None = None
    notes = list(_notes(result))
    # The methods assume a level plane.
    level = not result.run.conditions.surroundings
    if part is not None and len(distribution.aspects) and level:
        with analysis('the analytic estimates', notes):
            shape = RestingShape(part, distribution.aspects)
            found, reasons = estimate_each(shape, METHODS)
            estimates = {name: each.probabilities for name, each in found.items()}
    with analysis('the table of contacts', notes):
        contacts += contact_page_rows(result)
    if against is not None:
        with analysis('the comparison with the measured counts', notes):
            measured = _measured(result, against)
    return Report(
        title=result.run.part,
        subtitle=result.subtitle,
        distribution=distribution,
        part=part,
        notes=tuple(notes),
        facts=_facts(result),
        history=result.history,
        estimates=estimates,
        not_defined=reasons,
        measured=measured,
        contacts=tuple(contacts),
        level_floor=has_level_floor(result.run.conditions),
    )


def _measured(result: CountedRun, against: CountedDrops) -> ReferenceCounts:
    tally = counted_by_class(against, result.distribution.aspects).tally
    own = result.distribution.by_class()
    counted = DropCounts(
        own.counts, own.unclassified, own.unsettled + own.lost + own.sliding, own.failed
    )
    found = compare(counted, tally, np.random.default_rng(SEED), own.confidence)
    return ReferenceCounts(printable(Path(against.source).name), counted, tally, found)


def _notes(result: CountedRun) -> Iterator[str]:
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


def _facts(result: CountedRun) -> dict[str, list[tuple[str, str]]]:
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


def _surroundings_facts(result: CountedRun) -> dict[str, list[tuple[str, str]]]:
    """Return the surroundings in words, below their heading; empty for the level plane."""
    conditions = result.run.conditions
    if not conditions.surroundings:
        return {}
    shapes = simulated_shapes(result.part, conditions)
    simulated = [] if shapes is None else [('as simulated', text) for text in shapes.sentences()]
    return {'Surroundings': [*surroundings_facts(conditions), *simulated]}


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
