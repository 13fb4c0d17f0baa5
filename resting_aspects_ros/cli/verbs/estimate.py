"""`resting_aspects estimate`: what the literature predicts from a part's shape alone."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.recommended_method import recommended_method
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.options import add_output, add_part, parse_quantity
from resting_aspects_ros.cli.part_argument import part_of
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators.estimate import METHODS, Estimate, estimate_each
from resting_aspects_ros.core.estimators.recommendation import Recommendation
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.report.estimate_report import (
    against_fields,
    estimate_document,
    estimate_table,
    legend,
)
from resting_aspects_ros.simulation.conditions import DropConditions

if TYPE_CHECKING:  # imported when there is something to compare with
    from resting_aspects_ros.api.inputs.counts import CountsFile

# Of the tables that are drawn for p values: the same question has the same answer.
SEED = 1
ALL = 'all'
DESCRIPTION = """How probable each aspect of a part is by the analytic methods of the
literature. They take milliseconds and know the shape alone. The surface and the
height of release decide which method is recommended. The error of each method
is in docs/explanation/estimators.md. With --against the drops of a log (or a
JSON document of drop or request, or a CSV of counts, as compare takes them)
are shown beside them."""
EXAMPLES = """examples:
  resting_aspects estimate l_bracket
  resting_aspects estimate my_part.stl --method rolling,csa --json
  resting_aspects estimate my_part.stl --height 300mm
  resting_aspects estimate hex_nut --against out/hex_nut/distribution.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--method',
        metavar='NAME',
        default=ALL,
        help='solid_angle, csa, crsa, stability, energy_barrier, quasi_static, rolling, some of '
        'them with commas between, or all (all)',
    )
    parser.add_argument(
        '--against', metavar='LOG', type=Path, help='drops of the same part to compare with'
    )
    parser.add_argument(
        '--surface',
        metavar='NAME',
        default='',
        help='recommend for the conditions of this surface (those of --against, else rubber_mat)',
    )
    parser.add_argument(
        '--height', metavar='M', help='recommend for this height of release, such as 300mm'
    )
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Load, estimate and show; returns the exit code.

    Raises RestingAspectsError for wrong input, NotDefinedError if no method asked for is defined.
    """
    names = _methods(arguments.method)
    part = part_of(arguments)
    shape = RestingShape(part)
    against = None
    if arguments.against is not None:
        from resting_aspects_ros.api.inputs.count_files import read_counts
        from resting_aspects_ros.api.inputs.counts import check_against

        against = read_counts(arguments.against)
        check_against(against, part.name, part.part_sha256, shape.aspects)
    recommended = recommended_method(shape, _conditions(arguments, against))
    estimates, reasons = _estimates(shape, names)
    show_estimates(
        part,
        shape.aspects,
        estimates,
        reasons,
        recommended,
        against,
        each=arguments.each,
        as_json=arguments.json,
    )
    return 0


def show_estimates(
    part: Part,
    aspects: AspectSet,
    estimates: Mapping[str, Estimate | None],
    reasons: Mapping[str, str],
    recommended: Recommendation | None = None,
    against: 'CountsFile | None' = None,
    *,
    each: bool = False,
    as_json: bool,
) -> None:
    """On standard output, as a document and nothing else, or as a table."""
    known_by_class = against is not None and against.by_class
    by_class = known_by_class or not (each or as_json)
    shares = {
        name: None
        if found is None
        else found.class_probabilities()
        if by_class
        else found.probabilities
        for name, found in estimates.items()
    }
    tally, deviations = None, {}
    if against is not None:
        from resting_aspects_ros.api.inputs.counts import counted_by_class_of
        from resting_aspects_ros.core.statistics.comparison import compare_with_exact

        tally = counted_by_class_of(against, aspects) if by_class else against.tally
        deviations = {
            name: compare_with_exact(tally, share, np.random.default_rng(SEED))
            for name, share in shares.items()
            if share is not None
        }
    if as_json:
        document = estimate_document(part, estimates, reasons, recommended)
        if against is not None and tally is not None:
            path = str(against.path)
            document['against'] = against_fields(path, tally, deviations, by_class=by_class)
        sys.stdout.write(to_json(document))
        return
    best = '' if recommended is None else recommended.method
    rows = aspects.classes() if by_class else [(aspect,) for aspect in aspects.aspects]
    title = _title(part, against)
    console = make_console()
    show_table(console, estimate_table(part, rows, shares, title, best, tally, deviations))
    defined = [name for name, found in estimates.items() if found is not None]
    lines = legend(defined, best) + [f'{reason}.' for reason in reasons.values()]
    for line in [*lines, *([] if recommended is None else [recommended.reason])]:
        console.print(line, markup=False, highlight=False)


def _conditions(arguments: argparse.Namespace, against: 'CountsFile | None') -> DropConditions:
    """Those that flags ask for, else those of the drops, else the default ones."""
    if against is not None and against.run is not None and not arguments.surface:
        conditions = against.run.conditions
    else:
        conditions = shipped_surfaces().get(arguments.surface)
    if arguments.height is None:
        return conditions
    return conditions.changed(height=parse_quantity('--height', arguments.height, 'm'))


def _methods(text: str) -> list[str]:
    """Those that are named, in the order of METHODS; raises InvalidValueError."""
    asked = list(METHODS) if text == ALL else [name.strip() for name in text.split(',')]
    for name in asked:
        if name not in METHODS:
            raise InvalidValueError(
                f'--method is {text!r}, allowed is {ALL}, or some of {", ".join(METHODS)} with '
                'commas between'
            )
    return [name for name in METHODS if name in asked]


def _estimates(
    shape: RestingShape, names: Sequence[str]
) -> tuple[dict[str, Estimate | None], dict[str, str]]:
    """By method what it says, or why it says nothing."""
    found, reasons = estimate_each(shape, names)
    if len(reasons) == len(names):
        raise NotDefinedError('; '.join(reasons.values()))
    return {name: found.get(name) for name in names}, reasons


def _title(part: Part, against: 'CountsFile | None') -> str:
    title = f'{part.name}: probability by method, %'
    return title if against is None else f'{title}\nagainst {against.title}'
