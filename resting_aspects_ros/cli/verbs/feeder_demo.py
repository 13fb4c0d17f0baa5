"""`resting_aspects feeder_demo`: a vision feeder without hardware, over ROS."""

import argparse
import sys
from pathlib import Path

from resting_aspects_ros.api.result import check_files
from resting_aspects_ros.cli.life_cycle import DONE, INTERRUPTED
from resting_aspects_ros.cli.options import add_seed
from resting_aspects_ros.cli.verbs.forecast import add_cell, parse_tray, requested_times
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS
from resting_aspects_ros.system import Interruption

PART, MINUTES = 'l_bracket', '10'
DROPS, PER_ASPECT = DEFAULT_DROPS, 40
DOCUMENT, PICTURE, LAYOUT = 'feeder_demo.json', 'feeder_demo.png', 'foxglove.json'

DESCRIPTION = f"""Run a vision feeder without hardware, in simulated time: drop the part {DROPS}
times and flip it {PER_ASPECT} times from each aspect over ROS, forecast the parts per
minute, and then let camera_simulator, vision_example and feeder_controller work
together as processes that communicate over DDS. Show the picks beside the
forecast, and write a picture of the tray, a JSON document and logs."""
EXAMPLES = """examples:
  resting_aspects feeder_demo
  resting_aspects feeder_demo hex_nut --pickable-classes 1 --robot 0.9s
  resting_aspects feeder_demo l_bracket --pickable 1,3 --minutes 30 --seed 2
  resting_aspects feeder_demo t_prism --tray 150x150mm --out result --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'part', metavar='PART', nargs='?', default=PART, help=f'name of a part ({PART})'
    )
    parser.add_argument(
        '--parts', metavar='DIR', type=Path, help='folder of named parts (the examples)'
    )
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        '--pickable',
        metavar='IDS',
        help='aspects in which the robot can pick the part, such as 1,3: all of their symmetry '
        'classes (the most probable class)',
    )
    group.add_argument('--pickable-classes', metavar='NUMBERS', help='symmetry classes instead')
    add_cell(parser, MINUTES, 'the run in simulated time', gripper=False)
    add_seed(parser, 'drops, flips, places on the tray and noise of the camera')
    parser.add_argument(
        '--real-time',
        action='store_true',
        help='run as fast as a real feeder, to watch it with RViz or Foxglove',
    )
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        default=Path('out/feeder_demo'),
        help='folder of the picture, the document, the logs and the output of the nodes '
        '(out/feeder_demo)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; returns the exit code. Raises RestingAspectsError if a node fails."""
    out: Path = arguments.out
    check_files('--out', out, (DOCUMENT, PICTURE, LAYOUT))
    with Interruption() as stop:
        from resting_aspects_ros.cli.feeder_demo_run import FeederDemo, planned_demo

        size, times = parse_tray(arguments.tray), requested_times(arguments)
        plan = planned_demo(arguments, size, times, DROPS, PER_ASPECT)
        demo = FeederDemo(plan, out, stop.check)
        failure: RestingAspectsError | None = None
        try:
            demo.run(out / LAYOUT)
        except KeyboardInterrupt:
            print('interrupted', file=sys.stderr)
        except RestingAspectsError as error:
            if not demo.has_begun:
                raise
            failure = error
        found = demo.save(out / DOCUMENT, out / PICTURE)
        if arguments.json:
            sys.stdout.write(found)
        if failure is not None:
            raise failure
        return INTERRUPTED if stop.asked else DONE
