"""The files of a report, from an answer."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.condition_text import condition_facts, surface_text, when_text
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.estimate import recommended_method
from resting_aspects_ros.api.inputs.counts import CountedDrops, counted_by_class_of
from resting_aspects_ros.api.output_files import check_output, make_folder, whole_file
from resting_aspects_ros.core.estimators.estimate import METHODS, estimate_each
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.input_file import printable
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.comparison import DropCounts, compare
from resting_aspects_ros.core.statistics.intervals import Array
from resting_aspects_ros.report.comparison_text import ReferenceCounts
from resting_aspects_ros.report.page import ENDINGS, FIGURES, PAGE, Report, report_files
from resting_aspects_ros.report.rounding import size_text
from resting_aspects_ros.report.table import symmetry_text

# Seed of the Monte Carlo p values, so that equal inputs give equal reports.
SEED = 1


def default_folder(part: str) -> Path:
    """Return the folder of the report of a part if none is given."""
    return Path('out') / part


def check_report(flag: str, folder: Path) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    make_folder(flag, folder)
    for name in (PAGE, *_figure_files()):
        check_output(flag, folder / name)


def _figure_files() -> list[str]:
    return [f'{figure}.{ending}' for figure in FIGURES for ending in ENDINGS]


def write_report(answer: DropResult, folder: Path, against: CountedDrops | None = None) -> Path:
    """Write the report and return the path of the page. Raises OutputError."""
    written = set()
    for name, data in report_files(_report(answer, against)):
        with whole_file(folder / name) as file:
            file.write_bytes(data)
        written.add(name)
    for name in _figure_files():
        if name not in written:  # a figure of an earlier report
            (folder / name).unlink(missing_ok=True)
    return folder / PAGE


def _report(answer: DropResult, against: CountedDrops | None) -> Report:
    distribution, part = answer.distribution, answer.part
    estimates: dict[str, Array] = {}
    reasons: dict[str, str] = {}
    recommended = ''
    if part is not None and len(distribution.aspects):
        shape = RestingShape(part, distribution.aspects)
        recommended = recommended_method(shape, answer.run.conditions).reason
        found, reasons = estimate_each(shape, METHODS)
        estimates = {name: each.probabilities for name, each in found.items()}
    return Report(
        title=answer.run.part,
        subtitle=answer.words,
        distribution=distribution,
        part=part,
        notes=tuple(_notes(answer)),
        facts=_facts(answer),
        history=answer.history,
        estimates=estimates,
        not_defined=reasons,
        recommended=recommended,
        measured=None if against is None else _measured(answer, against),
    )


def _measured(answer: DropResult, against: CountedDrops) -> ReferenceCounts:
    tally = counted_by_class_of(against, answer.distribution.aspects)
    own = answer.distribution.by_class()
    counted = DropCounts(own.counts, own.unclassified, own.unsettled, own.failed)
    found = compare(counted, tally, np.random.default_rng(SEED), own.confidence)
    return ReferenceCounts(printable(Path(against.source).name), counted, tally, found)


def _notes(answer: DropResult) -> Iterator[str]:
    run, drops = answer.run, answer.distribution.drops
    if not answer.complete:
        goal = f'a precision of ±{run.precision:g}' if run.precision else f'{run.drops} drops'
        yield f'The run is not complete: it has {drops} drops, and {goal} was requested.'
    if answer.convergence is not None:
        yield answer.convergence.text().replace('\n', ' ')
    if answer.part is None:
        yield (
            'The mesh of the part is not available. Therefore this report has no pictures and '
            'no analytic estimates.'
        )
    else:
        yield from (f'{warning[0].upper()}{warning[1:]}.' for warning in answer.part.warnings)


def _facts(answer: DropResult) -> dict[str, list[tuple[str, str]]]:
    run = answer.run
    requested = f'{run.drops}' if not run.precision else f'up to {run.drops}'
    drops = [('number of drops', f'{answer.distribution.drops} of {requested}')]
    if run.precision:
        drops.append(('required precision', f'intervals of at most ±{run.precision:g}'))
    drops += [
        ('seed', str(run.seed)),
        *([('index of the first drop', str(run.first_drop))] if run.first_drop else []),
        ('engine', f'{run.engine} {run.engine_version}'),
        ('time step', f'{run.time_step:.3g} s'),
        ('resting_aspects_ros', run.suite_version),
        ('date', when_text(run.started)),
        ('run id', run.run_id),
        ('maximum energy gain in a drop', _energy_text(answer)),
    ]
    return {
        'Part': _part_facts(answer.part, answer),
        'Conditions': [
            ('surface', surface_text(run.conditions)),
            *condition_facts(run.conditions),
        ],
        'Run': drops,
    }


def _energy_text(answer: DropResult) -> str:
    """Return the energy that the engine added in a drop, as the rise of the part it equals."""
    growth = answer.distribution.energy_growth  # as a height, hull radii
    if answer.part is None:
        return f'equal to a rise by {growth:.2g} of the part radius'
    return f'equal to a rise by {1000 * growth * answer.part.hull_radius:.2g} mm'


def _part_facts(part: Part | None, answer: DropResult) -> list[tuple[str, str]]:
    hashes = [('part sha256', answer.run.part_sha256)]
    if part is None:
        return [('name', answer.run.part), *hashes]
    symmetry = answer.distribution.aspects.symmetry
    return [
        ('name', part.name),
        ('size along the mesh axes', size_text(part)),
        ('mesh', f'{part.mesh_format} in {part.unit}, {len(part.faces)} triangles'),
        ('mass', f'{1000 * part.mass:.4g} g'),
        *([('symmetry', symmetry_text(symmetry))] if symmetry is not None else []),
        ('mesh sha256', part.mesh_sha256),
        *hashes,
    ]
