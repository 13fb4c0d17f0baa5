"""The files of a report on a result."""

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
    """Return the default folder of the report on a part."""
    return Path('out') / part


def check_report(flag: str, folder: Path) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    make_folder(flag, folder)
    for name in (PAGE, *_figure_files()):
        check_output(flag, folder / name)


def _figure_files() -> list[str]:
    return [f'{figure}.{ending}' for figure in FIGURES for ending in ENDINGS]


def write_report(result: DropResult, folder: Path, against: CountedDrops | None = None) -> Path:
    """Write the report and return the path of the page. Raises OutputError."""
    written = set()
    for name, data in report_files(_report(result, against)):
        with whole_file(folder / name) as file:
            file.write_bytes(data)
        written.add(name)
    for name in _figure_files():
        if name not in written:  # a figure of an earlier report
            (folder / name).unlink(missing_ok=True)
    return folder / PAGE


def _report(result: DropResult, against: CountedDrops | None) -> Report:
    distribution, part = result.distribution, result.part
    estimates: dict[str, Array] = {}
    reasons: dict[str, str] = {}
    recommended = ''
    if part is not None and len(distribution.aspects):
        shape = RestingShape(part, distribution.aspects)
        recommended = recommended_method(shape, result.run.conditions).reason
        found, reasons = estimate_each(shape, METHODS)
        estimates = {name: each.probabilities for name, each in found.items()}
    return Report(
        title=result.run.part,
        subtitle=result.subtitle,
        distribution=distribution,
        part=part,
        notes=tuple(_notes(result)),
        facts=_facts(result),
        history=result.history,
        estimates=estimates,
        not_defined=reasons,
        recommended=recommended,
        measured=None if against is None else _measured(result, against),
    )


def _measured(result: DropResult, against: CountedDrops) -> ReferenceCounts:
    tally = counted_by_class_of(against, result.distribution.aspects)
    own = result.distribution.by_class()
    counted = DropCounts(own.counts, own.unclassified, own.unsettled, own.failed)
    found = compare(counted, tally, np.random.default_rng(SEED), own.confidence)
    return ReferenceCounts(printable(Path(against.source).name), counted, tally, found)


def _notes(result: DropResult) -> Iterator[str]:
    run, drops = result.run, result.distribution.drops
    if not result.complete:
        goal = f'a precision of ±{run.precision:g}' if run.precision else f'{run.drops} drops'
        yield f'The run is not complete: it has {drops} drops, and {goal} was requested.'
    if result.convergence is not None:
        yield result.convergence.text().replace('\n', ' ')
    if result.part is None:
        yield (
            'The mesh of the part is not available. Therefore this report has no pictures and '
            'no analytic estimates.'
        )
    else:
        yield from (f'{warning[0].upper()}{warning[1:]}.' for warning in result.part.warnings)


def _facts(result: DropResult) -> dict[str, list[tuple[str, str]]]:
    run = result.run
    requested = f'{run.drops}' if not run.precision else f'up to {run.drops}'
    drops = [('number of drops', f'{result.distribution.drops} of {requested}')]
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
        ('maximum energy gain in a drop', _energy_text(result)),
    ]
    return {
        'Part': _part_facts(result.part, result),
        'Conditions': [
            ('surface', surface_text(run.conditions)),
            *condition_facts(run.conditions),
        ],
        'Run': drops,
    }


def _energy_text(result: DropResult) -> str:
    """Return the energy that the engine added in a drop, as the rise of the part it equals."""
    growth = result.distribution.energy_growth  # as a height, hull radii
    if result.part is None:
        return f'equal to a rise by {growth:.2g} of the part radius'
    return f'equal to a rise by {1000 * growth * result.part.hull_radius:.2g} mm'


def _part_facts(part: Part | None, result: DropResult) -> list[tuple[str, str]]:
    hashes = [('part sha256', result.run.part_sha256)]
    if part is None:
        return [('name', result.run.part), *hashes]
    symmetry = result.distribution.aspects.symmetry
    return [
        ('name', part.name),
        ('size along the mesh axes', size_text(part)),
        ('mesh', f'{part.mesh_format} in {part.unit}, {len(part.faces)} triangles'),
        ('mass', f'{1000 * part.mass:.4g} g'),
        *([('symmetry', symmetry_text(symmetry))] if symmetry is not None else []),
        ('mesh sha256', part.mesh_sha256),
        *hashes,
    ]
