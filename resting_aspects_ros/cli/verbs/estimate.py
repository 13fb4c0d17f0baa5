"""`resting_aspects estimate`: the distribution of a part without drops, by several methods."""

import argparse

from resting_aspects_ros.api.estimate import EstimateResult, estimate
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.estimate import METHODS
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.report.drops import estimate_table

ALL = 'all'
DESCRIPTION = """Show how probable each aspect of a part is by the analytic methods of the
literature. They use only the shape, and assume an infinite level plane; the
command `drop` simulates the conditions. With --against the methods are compared
with drops: a log, a JSON document of drop or request, or a CSV of counts, as in
compare."""
EXAMPLES = """examples:
  resting_aspects estimate l_bracket
  resting_aspects estimate my_part.stl --method rolling,csa --json
  resting_aspects estimate hex_nut --against out/hex_nut/distribution.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_part(parser)
    parser.add_argument(
        '--method',
        metavar='NAME',
        default=ALL,
        help=f'{", ".join(METHODS)}, some of them separated by commas, or all (all)',
    )
    parser.add_argument('--against', metavar='LOG', help='drops of the same part to compare with')
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Estimate and show.

    Raises RestingAspectsError for wrong input, NotDefinedError if no requested method is defined.
    """
    words = METHODS if arguments.method == ALL else arguments.method.split(',')
    names = [word.strip() for word in words]
    result = estimate(options.requested_part(arguments), names, against=arguments.against)
    show_result(arguments, result.to_json, lambda: _show(result, each=arguments.each))


def _show(result: EstimateResult, *, each: bool) -> None:
    against = result.against
    by_class = not each or (against is not None and against.by_class)
    methods = [name for name in METHODS if name in {*result.estimates, *result.not_defined}]
    shares: dict[str, Array | None] = dict.fromkeys(methods)
    for name, found in result.estimates.items():
        shares[name] = found.class_probabilities() if by_class else found.probabilities
    aspects = result.aspects
    rows = aspects.classes() if by_class else [(aspect,) for aspect in aspects]
    title = f'{result.part.name}: probability by method, %'
    if against is None:
        table = estimate_table(result.part, rows, shares, title)
    else:
        title = f'{title}\nagainst {against.title}'
        compared = result.comparisons(by_class=by_class)
        table = estimate_table(result.part, rows, shares, title, *compared)
    show_table(table)
    lines = [
        f'{name:<16}{METHODS[name].label}: {METHODS[name].meaning}'
        for name in methods
        if name in result.estimates
    ]
    lines += [f'{reason}.' for reason in result.not_defined.values()]
    show_texts(*lines, 'All methods assume an infinite level plane.')
