"""`resting_aspects report`: a result as a page to look at."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import add_part_place

EXAMPLES = """examples:
  resting_aspects report out/nut/distribution.json
  resting_aspects report out/logs/l_bracket_20250131T120000Z_4f1c --out report
  resting_aspects report result/distribution.json --against counted_by_hand.csv
  resting_aspects report request.json --part my_part.stl --unit in
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'report',
        description='Write report.html, one file that needs no network, with the part in 3D, a\n'
        'picture and the probability of each aspect, charts, and all conditions; and\n'
        'the figures as PNG and SVG.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        'result',
        metavar='LOG_OR_JSON',
        type=Path,
        help='a log (the folder of a run, or its .mcap file), or a JSON document of drop or '
        'request',
    )
    parser.add_argument(
        '--against',
        metavar='COUNTS',
        type=Path,
        help='show it beside counts by hand (a CSV with aspect or class, and count), a log or a '
        'JSON document',
    )
    parser.add_argument(
        '--out', metavar='DIR', type=Path, help='folder of the files (out/ and the part)'
    )
    parser.add_argument(
        '--part',
        metavar='PART_OR_MESH',
        help='the part of a JSON document (the mesh that it names, else the part of its name)',
    )
    add_part_place(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.report_here import report_here

    return report_here(arguments)
