"""`resting_aspects classify`: sort a file of resting poses, with or without the part."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import add_part_place
from resting_aspects_ros.commands.quantities import parse_quantity

EXAMPLES = """examples:
  resting_aspects classify poses.csv
  resting_aspects classify poses.csv --part l_bracket
  resting_aspects classify poses.csv --part my_part.stl --json > o.json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'classify',
        description='Sort resting poses by their orientations alone: two are the same if they\n'
        'differ by a turn about the vertical. With --part also by the aspects that\n'
        'follow from its shape; then poses on which the two differ are listed. They\n'
        'agree on a pose that is in an aspect and in the cluster that goes with it.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        'poses',
        metavar='POSES.csv',
        type=Path,
        help='a line of names with qx, qy, qz, qw or x, y, z, w among them, in any order, '
        'then a line for each pose: unit quaternions, world from part, z up. Of a column '
        'status only SETTLED is sorted',
    )
    parser.add_argument('--part', metavar='PART_OR_MESH', help='name of a part, or a mesh file')
    add_part_place(parser)
    parser.add_argument(
        '--tolerance',
        metavar='DEG',
        help='poses whose down directions are at most this apart are the same, and so on '
        'from each to the next (5): 1 to 30 degrees',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    text = arguments.tolerance
    degrees = None if text is None else parse_quantity('--tolerance', text, '')
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.classify_here import classify_here

    return classify_here(arguments, degrees)
