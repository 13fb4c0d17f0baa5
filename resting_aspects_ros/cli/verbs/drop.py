"""`resting_aspects drop`: drop a part here and now, without ROS."""

import argparse
from contextlib import ExitStack
from pathlib import Path

from resting_aspects_ros.cli.options import (
    add_conditions,
    add_output,
    add_part,
    add_run,
    parse_share,
    whole,
)
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED

DESCRIPTION = """Drop a part many times in simulation and show in which aspects it comes
to rest, and how probable each is. Needs no ROS graph."""
EXAMPLES = """examples:
  resting_aspects drop l_bracket
  resting_aspects drop my_part.stl --unit mm --drops 5000 --out result
  resting_aspects drop l_bracket --report --log out/logs
  resting_aspects drop t_prism --precision 0.02
  resting_aspects drop washer --drops 5000 --check-convergence
  resting_aspects drop l_bracket --drops 1000000 --scheduler tcp://10.0.0.5:8786
  resting_aspects drop --from-log out/logs/hex_nut_20250131T120000Z_4f1c2d3e4f50
  resting_aspects drop hex_nut --height 100mm --friction 0.4 --json > nut.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser, needed=False)
    parser.add_argument(
        '--from-log',
        metavar='LOG',
        type=Path,
        help='make the drops again that a log has, with its part, conditions and seed: the same '
        'poses',
    )
    add_run(parser, str(DEFAULT_SEED))
    parser.add_argument(
        '--interval',
        choices=('wilson', 'simultaneous'),
        default='wilson',
        help='of each aspect by itself, or such that all hold at once (wilson)',
    )
    parser.add_argument(
        '--confidence',
        metavar='C',
        default='0.95',
        help='of the intervals, more than 0.5 and less than 1 (0.95)',
    )
    who = parser.add_mutually_exclusive_group()
    who.add_argument('--workers', metavar='W', type=whole, help='processes (one per core)')
    who.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help='drop on a Dask cluster instead: that of its scheduler, such as '
        'tcp://10.0.0.5:8786. Needs the package distributed; the poses are the same',
    )
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        help='write distribution.json, distribution.png and poses.csv here',
    )
    parser.add_argument(
        '--report',
        action='store_true',
        help='with the files of --out (out/ and the part) write report.html, a page with pictures '
        'and charts',
    )
    parser.add_argument(
        '--log',
        metavar='DIR',
        type=Path,
        help='write a log of the run into this folder, as drop_recorder does: an MCAP file that '
        'rosbag2, Foxglove and the commands replay, info and report read',
    )
    parser.add_argument('--poses', metavar='FILE.csv', type=Path, help='write the resting poses')
    parser.add_argument(
        '--check-convergence',
        action='store_true',
        help='make the same drops again in half the time step, and say how far the answer moves',
    )
    add_output(parser)
    add_conditions(parser)
    parser.add_argument(
        '--force', action='store_true', help='drop even from a height that looks like a mistake'
    )


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    with Interruption() as stop, ExitStack() as stack:
        confidence = parse_share('--confidence', arguments.confidence)
        # NumPy and what needs it take a while to import.
        from resting_aspects_ros.simulation.chunks import Workers
        from resting_aspects_ros.simulation.process_workers import ProcessWorkers, default_workers

        workers: Workers | None = None
        if arguments.scheduler is None:
            # The worker processes import the engine while this one reads the part. They stop
            # last, so that the answer is written whatever becomes of them.
            count = default_workers() if arguments.workers is None else arguments.workers
            workers = processes = ProcessWorkers(count)
            stack.callback(processes.stop)
        from resting_aspects_ros.cli.drop_request import requested_drops
        from resting_aspects_ros.cli.drop_run import drop_and_show

        request = requested_drops(arguments)
        if workers is None:
            from resting_aspects_ros.simulation.dask_workers import ClusterWorkers

            workers = cluster = ClusterWorkers(arguments.scheduler)
            stack.callback(cluster.stop)
        if not arguments.force:
            request.check_height()
        return drop_and_show(arguments, request, workers, confidence, stop)
