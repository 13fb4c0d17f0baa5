"""`resting_aspects estimate`: what the literature predicts from a part's shape alone."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import add_part

ALL = 'all'
EXAMPLES = """examples:
  resting_aspects estimate l_bracket
  resting_aspects estimate my_part.stl --method rolling,csa --json
  resting_aspects estimate hex_nut --against out/hex_nut/distribution.json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'estimate',
        description='How probable each aspect of a part is by the analytic methods of the\n'
        'literature: in milliseconds, and without the conditions of a drop, which they\n'
        'know nothing of. docs/estimators.md says how far off each is. With --against\n'
        'the drops of a log (or a JSON document of drop or request, or a CSV of\n'
        'counts, as compare takes them) are shown beside them.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
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
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.estimate_here import estimate_here

    return estimate_here(arguments)
