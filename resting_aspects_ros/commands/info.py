"""`resting_aspects info`: what is in a log."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import add_each

EXAMPLES = """examples:
  resting_aspects info out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50
  resting_aspects info run_0.mcap --json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'info',
        description='Part, conditions, seed, versions, number of poses, and the distribution\n'
        'that a log holds, closed or broken off.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('log', metavar='LOG', type=Path, help='folder of a run, or an .mcap file')
    add_each(parser)
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError if it is no log."""
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.info_of_log import show_info

    return show_info(arguments.log, as_json=arguments.json, each=arguments.each)
