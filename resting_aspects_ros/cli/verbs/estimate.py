"""`resting_aspects estimate`: the distribution of a part without drops, by several methods."""

import argparse
import math
import sys

from resting_aspects_ros.api.estimate import EstimateResult, estimate
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.options import (
    add_conditions,
    add_output,
    add_part,
    changed_conditions,
)
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators.estimate import LEARNED, METHODS
from resting_aspects_ros.report.estimate_report import estimate_table, legend
from resting_aspects_ros.simulation.surfaces import all_surfaces

ALL = 'all'
DESCRIPTION = """Show how probable each aspect of a part is, without drops. The methods take
milliseconds and assume an infinite level plane. The analytic methods of the
literature depend only on the shape; learned was fitted to drops of random
solids and depends on the conditions, too. The conditions also determine which
method is recommended. The error of each method is in
docs/explanation/estimators.md. With --against the methods
are compared with drops: a log, a JSON document of drop or request, or a CSV of
counts, as in compare."""
EXAMPLES = """examples:
  resting_aspects estimate l_bracket
  resting_aspects estimate my_part.stl --method rolling,csa --json
  resting_aspects estimate my_part.stl --height 300mm --friction 0.4
  resting_aspects estimate hex_nut --against out/hex_nut/distribution.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--method',
        metavar='NAME',
        default=ALL,
        help=f'{", ".join(METHODS)}, some of them separated by commas, or all (all)',
    )
    parser.add_argument('--against', metavar='LOG', help='drops of the same part to compare with')
    add_output(parser)
    add_conditions(parser, 'that of --against, else rubber_mat')


def run(arguments: argparse.Namespace) -> int:
    """Estimate and show; returns the exit code.

    Raises RestingAspectsError for wrong input, NotDefinedError if no requested method is defined.
    """
    names = _methods(arguments.method)
    changed = changed_conditions(arguments)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    surface = arguments.surface and all_surfaces(arguments.surfaces).get(arguments.surface)
    result = estimate(part, names, surface=surface, against=arguments.against, **changed)
    show_estimates(result, each=arguments.each, as_json=arguments.json)
    return 0


def show_estimates(result: EstimateResult, *, each: bool, as_json: bool) -> None:
    """Print estimates on standard output, as one JSON document or as a table."""
    if as_json:
        sys.stdout.write(result.to_json())
        return
    against = result.against
    by_class = not each or (against is not None and against.by_class)
    methods = [name for name in METHODS if name in {*result.estimates, *result.not_defined}]
    shares = {
        name: None
        if found is None
        else found.class_probabilities()
        if by_class
        else found.probabilities
        for name, found in ((name, result.estimates.get(name)) for name in methods)
    }
    best = '' if result.recommended is None else result.recommended.method
    aspects = result.aspects
    rows = aspects.classes() if by_class else [(aspect,) for aspect in aspects.aspects]
    title = f'{result.part.name}: probability by method, %'
    if against is not None:
        title = f'{title}\nagainst {against.title}'
    console = make_console()
    table = estimate_table(
        result.part,
        rows,
        shares,
        title,
        best,
        result.counted(by_class=by_class),
        result.comparisons(by_class=by_class),
    )
    show_table(console, table)
    lines = legend([name for name in methods if name in result.estimates], best)
    if (found := result.estimates.get(LEARNED)) is not None and not math.isnan(found.weight):
        lines.append(f'The prediction of {LEARNED} is as certain as {found.weight:.0f} drops.')
    lines += [f'{reason}.' for reason in result.not_defined.values()]
    lines += ['All methods assume an infinite level plane.']
    for line in [*lines, *([] if result.recommended is None else [result.recommended.reason])]:
        console.print(line, markup=False, highlight=False)


def _methods(text: str) -> list[str]:
    """Return the requested methods in the order of METHODS; raises InvalidValueError."""
    named = list(METHODS) if text == ALL else [name.strip() for name in text.split(',')]
    for name in named:
        if name not in METHODS:
            raise InvalidValueError(
                f'invalid --method {text!r}: expected {ALL}, or some of {", ".join(METHODS)}, '
                'separated by commas'
            )
    return [name for name in METHODS if name in named]
