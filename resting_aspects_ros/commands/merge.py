"""`resting_aspects merge`: the drops of several logs as one distribution, each drop once."""

import argparse
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import add_each

EXAMPLES = """examples:
  resting_aspects merge out/logs/l_bracket_*
  resting_aspects merge monday.mcap tuesday.mcap --any-engine --json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'merge',
        description='The distribution over all drops in logs of one part under the same\n'
        'conditions. A drop that is in several of them, by its seed and its index,\n'
        'counts once.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        'logs', metavar='LOG', type=Path, nargs='+', help='folder of a run, or an .mcap file'
    )
    parser.add_argument(
        '--any-engine',
        action='store_true',
        help='also of different engines, versions of them, or time steps',
    )
    add_each(parser)
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.merge_logs import merge_logs

    return merge_logs(
        arguments.logs,
        any_engine=arguments.any_engine,
        as_json=arguments.json,
        each=arguments.each,
    )
