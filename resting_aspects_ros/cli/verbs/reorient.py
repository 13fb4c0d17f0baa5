"""`resting_aspects reorient`: how an action brings a part from aspect to aspect."""

import argparse
from functools import partial

from resting_aspects_ros.cli.action_options import add_action_values
from resting_aspects_ros.cli.life_cycle import session
from resting_aspects_ros.cli.options import (
    add_actions_file,
    add_confidence,
    add_contact_conditions,
    add_engine,
    add_out,
    add_output,
    add_part,
    add_seed,
    add_surroundings,
    add_workers,
    parse_integer,
    parse_share,
)
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS

DESCRIPTION = """Simulate what a feeder does to parts at rest, many times from each aspect, and
show in which aspects they come to rest again: the transition matrix, the
shares after many repetitions, how soon a wanted aspect is reached, and the best
action in each aspect. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects reorient l_bracket
  resting_aspects reorient l_bracket --action kick --speed 0.5 --spin 20
  resting_aspects reorient t_prism --action tap,toss --wanted 1,3
  resting_aspects reorient l_bracket --action tap,hard_tap --report
  resting_aspects reorient my_part.stl --actions my_actions.yaml --action jolt
  resting_aspects reorient hex_nut --precision 0.05 --out result
  resting_aspects reorient l_bracket --action hard_tap --json > transitions.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--action',
        metavar='NAME',
        help='an action of config/actions.yaml or of --actions, such as tap, or a kind of action '
        'with the values below; several names separated by commas are compared (tap; with '
        '--actions all actions of the file)',
    )
    add_actions_file(parser)
    parser.add_argument(
        '--per-aspect',
        metavar='N',
        type=parse_integer,
        help='number of actions from each aspect (400). With --precision the maximum (as many as '
        'needed)',
    )
    parser.add_argument(
        '--precision',
        metavar='P',
        type=partial(parse_share, '--precision'),
        help='stop as soon as every interval of the matrix is at most +-P wide, such as 0.05',
    )
    parser.add_argument(
        '--drops',
        metavar='N',
        type=parse_integer,
        default=DEFAULT_DROPS,
        help='number of drops; their distribution is shown beside the long run, and parts that '
        f'leave the aspects are replaced by dropped parts ({DEFAULT_DROPS})',
    )
    add_seed(parser, 'transitions')
    wanted = parser.add_mutually_exclusive_group()
    wanted.add_argument(
        '--wanted',
        metavar='IDS',
        help='wanted aspects, such as 1,3: show how likely and how soon they are reached, and '
        'with several actions the best one in each other aspect',
    )
    wanted.add_argument(
        '--wanted-classes', metavar='NUMBERS', help='the same for symmetry classes'
    )
    add_confidence(parser)
    add_engine(parser)
    add_workers(parser)
    add_out(
        parser,
        'write transitions.json, transitions.png and roadmap.json into this folder',
        'reorientation.html, a page with the figures, all numbers and all conditions',
    )
    parser.add_argument(
        '--check-convergence',
        action='store_true',
        help='repeat the actions with half the time step, and show how much the matrix changes',
    )
    add_output(parser)
    add_action_values(parser)
    add_contact_conditions(parser)
    add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        # These imports are slow because of NumPy.
        from resting_aspects_ros.cli.reorient_run import reorient_and_show

        return reorient_and_show(arguments, started)
