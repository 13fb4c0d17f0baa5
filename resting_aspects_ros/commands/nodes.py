"""`resting_aspects nodes`: the whole suite in one process."""

import argparse
from typing import Any

from resting_aspects_ros.signals import ending_at_once

EXAMPLES = """examples:
  resting_aspects nodes
  resting_aspects nodes --ros-args -p log_folder:=logs -r __ns:=/cell_1
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'nodes',
        help='run all ROS nodes in one process',
        description='Run drop_simulator, aspect_classifier and drop_recorder in one process,\n'
        'until Ctrl-C. What follows --ros-args goes to ROS.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--ros-args', nargs=argparse.REMAINDER, default=[], help='for ROS')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Spin until told to stop."""
    with ending_at_once():
        from resting_aspects_ros.nodes.aspect_classifier import AspectClassifier
        from resting_aspects_ros.nodes.drop_recorder import DropRecorder
        from resting_aspects_ros.nodes.drop_simulator import DropSimulator
        from resting_aspects_ros.nodes.spin import spin_nodes

    ros_args = ['--ros-args', *arguments.ros_args] if arguments.ros_args else []
    return spin_nodes([DropSimulator, AspectClassifier, DropRecorder], ros_args)
