"""`resting_aspects drop`: drop a part on this machine, without ROS nodes."""

import argparse
from pathlib import Path

from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.life_cycle import session
from resting_aspects_ros.simulation.conditions import DEFAULT_SEED, Noise, quantities_of

DESCRIPTION = """Drop a part many times in simulation and show in which aspects it comes
to rest, and how probable each is. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects drop l_bracket
  resting_aspects drop my_part.stl --unit mm --drops 5000 --out result
  resting_aspects drop old.stl new.stl FOLDER --out out/batch
  resting_aspects drop t_prism --precision 0.02
  resting_aspects drop hex_nut --surroundings slope --set angle=12deg
  resting_aspects drop die --initial-states tosses.csv --replicates 24
  resting_aspects drop --from-log out/logs/hex_nut_20250131T120000Z_4f1c2d3e4f50
  resting_aspects drop hex_nut --height 100mm --friction 0.4 --json > nut.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'part',
        metavar='PART_OR_MESH',
        nargs='*',
        help='name of a part, or a mesh file; several of them, or a folder of mesh files, are a '
        'batch with an index page',
    )
    options.add_part_place(parser)
    parser.add_argument(
        '--from-log',
        metavar='LOG',
        type=Path,
        help='repeat the drops recorded in a log, with its part, conditions and seed; the poses '
        'are the same',
    )
    options.add_run(parser, str(DEFAULT_SEED))
    states = parser.add_argument_group('given initial states, instead of random releases')
    states.add_argument(
        '--initial-states',
        metavar='FILE.csv',
        type=Path,
        help='start from the poses and velocities in a CSV with the columns z_com_m, qx, qy, qz, '
        'qw and, if needed, x_m, y_m, vx, vy, vz, wx, wy, wz',
    )
    options.add_integer(states, '--replicates', 'number of drops from each state (1)')
    for name, quantity in quantities_of(Noise).items():
        text = f'standard deviation of the {quantity.text} in each axis (0)'
        options.add_number(states, f'--noise-{name}', quantity.unit, text)
    parser.add_argument(
        '--interval',
        choices=('wilson', 'simultaneous'),
        default='wilson',
        help='intervals of each aspect by itself, or intervals that hold simultaneously (wilson)',
    )
    options.add_confidence(parser)
    options.add_engine(parser)
    options.add_workers(parser)
    options.add_out(
        parser,
        'write distribution.json, distribution.png and, of a single part, poses.csv into '
        'this folder',
        'report.html, a page with pictures and charts',
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
        help='repeat the drops with half the time step, and show how much the result changes',
    )
    options.add_model_range(parser)
    options.add_output(parser)
    options.add_conditions(parser)
    options.add_surroundings(parser)


def _is_folder(given: list[str]) -> bool:
    if not given or not given[0] or not Path(given[0]).is_dir():  # Path('') is the folder '.'
        return False
    # This import is slow, and only needed if there is such a folder.
    from resting_aspects_ros.studies.batch import part_folder

    return part_folder(given[0]) is not None


def run(arguments: argparse.Namespace) -> int:
    """Drop and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        from resting_aspects_ros.cli import drop_run

        # With --parts, one part is a name in that folder, even if there is a folder of this name.
        if len(arguments.part) > 1 or (arguments.parts is None and _is_folder(arguments.part)):
            return drop_run.drop_batch_and_show(arguments, started)
        arguments.part = arguments.part[0] if arguments.part else None
        return drop_run.drop_and_show(arguments, started)
