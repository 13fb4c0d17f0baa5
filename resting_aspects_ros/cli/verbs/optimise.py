"""`resting_aspects optimise`: the conditions with the most of the wanted aspects."""

import argparse
from contextlib import ExitStack
from pathlib import Path

from resting_aspects_ros.cli.options import (
    add_conditions,
    add_confidence,
    add_output,
    add_part,
    add_surroundings,
    add_workers,
)
from resting_aspects_ros.cli.start_workers import start_workers
from resting_aspects_ros.cli.values import parse_integer, parse_share
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.job import DEFAULT_SEED

DESCRIPTION = """Find the conditions, within given ranges, in which most parts come to rest in
wanted aspects, or whose distribution has the least entropy. Fresh drops at the
best conditions, at the second best and at those of the other flags show how
certain the answer is. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects optimise l_bracket --vary height=20mm:200mm --wanted 1
  resting_aspects optimise hex_nut --vary friction=0.1:0.5 --wanted-classes 1
  resting_aspects optimise part.stl --vary height=5mm:0.2 --wanted 1 --out best
  resting_aspects optimise l_bracket --vary height=20mm:0.2 --minimise-entropy
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--vary',
        metavar='NAME=LOW:HIGH',
        action='append',
        required=True,
        help='what varies, and its range: a condition, surroundings.NAME or action.NAME, such as '
        'height=20mm:200mm, surroundings.angle=0deg:20deg or action.speed=0.1:1; a third value is '
        'a number of levels, or log; can be repeated',
    )
    # No group of exclusive options, whose usage would be too wide: make_objective checks them.
    parser.add_argument(
        '--wanted', metavar='IDS', help='find the largest share of these aspects, such as 1,3'
    )
    parser.add_argument(
        '--wanted-classes', metavar='NUMBERS', help='the same for symmetry classes'
    )
    parser.add_argument(
        '--wanted-contacts',
        metavar='PLANE=CONTACT,...',
        action='append',
        default=[],
        help='in surroundings with walls, find the largest share of parts that touch the planes '
        'so, such as belt=1,wall=edge: an aspect, side, edge, corner or none; can be repeated for '
        'alternatives',
    )
    parser.add_argument(
        '--minimise-entropy',
        action='store_true',
        help='instead find the least entropy over the symmetry classes',
    )
    parser.add_argument(
        '--action',
        metavar='NAME',
        help='an action of config/actions.yaml or of --actions, which is done once to each part '
        'that was dropped, before it is counted (none)',
    )
    parser.add_argument(
        '--actions', metavar='FILE', type=Path, help='file of named actions (config/actions.yaml)'
    )
    parser.add_argument(
        '--budget',
        metavar='N',
        type=parse_integer,
        default=200_000,
        help='number of all drops: half of them search, a quarter are fresh drops that compare '
        'the best conditions with others, and a quarter show how flat the optimum is (200000)',
    )
    parser.add_argument(
        '--seed',
        metavar='S',
        type=parse_integer,
        default=DEFAULT_SEED,
        help=f'the same seed gives the same result ({DEFAULT_SEED})',
    )
    add_confidence(parser)
    add_workers(parser)
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        help='write optimum.json, points.csv and the page report.html into this folder',
    )
    add_output(parser, each=False)
    add_conditions(parser)
    add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Search and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with Interruption() as stop, ExitStack() as stack:
        confidence = parse_share('--confidence', arguments.confidence)
        # These imports are slow because of NumPy.
        from resting_aspects_ros.cli.optimise_run import optimise_and_show

        workers = start_workers(arguments, stack)
        return optimise_and_show(arguments, workers, confidence, stop)
