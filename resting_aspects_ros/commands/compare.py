"""`resting_aspects compare`: how far two distributions are apart."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.quantities import parse_quantity

EXAMPLES = """examples:
  resting_aspects compare out/nut/distribution.json manual.csv
  resting_aspects compare out/logs/my_part_20270131T235959Z_4f1c p.json
  resting_aspects compare before.json after.json --confidence 0.99 --json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'compare',
        description='How far two distributions over the same aspects are apart, and whether\n'
        'chance explains it. Each of A and B is a log (the folder of a run, or its\n'
        '.mcap file), a JSON document of drop or request, or a CSV of counts: a line\n'
        'of names with aspect and count among them, then a line for each aspect, also\n'
        'with count 0, and if there are for unclassified, unsettled and failed drops;\n'
        'with class instead of aspect, a line for each class of aspects that look alike.\n'
        'Shares are of the drops that are in an aspect.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('a', metavar='A', type=Path, help='log, JSON document or CSV')
    parser.add_argument('b', metavar='B', type=Path, help='what A is compared with, likewise')
    parser.add_argument(
        '--confidence',
        metavar='C',
        default='0.95',
        help='of the intervals: more than 0.5 and less than 1 (0.95)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    confidence = parse_quantity('--confidence', arguments.confidence, '')
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.compare_here import compare_here

    return compare_here(arguments, confidence)
