"""`resting_aspects recover`: close logs that were broken off."""

import argparse
from pathlib import Path
from typing import Any

EXAMPLES = """examples:
  resting_aspects recover out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50
  resting_aspects recover out/logs/*
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'recover',
        description='Rebuild index, summary and metadata.yaml of logs whose recorder was killed.\n'
        'Every message that is in the file in full is kept, and a classifier that is\n'
        'started uses the drops. Logs that are closed, or are being written, stay as they\n'
        'are. A file in which more is damaged than its end is kept beside the new one,\n'
        'as .damaged.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        'logs', metavar='LOG', type=Path, nargs='+', help='folder of a run, or an .mcap file'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError if a single log cannot be recovered."""
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.recover_logs import recover_logs

    return recover_logs(arguments.logs)
