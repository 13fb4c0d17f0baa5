"""`resting_aspects nodes`: all nodes of the suite in one process."""

import argparse

from resting_aspects_ros.cli.options import add_ros_args
from resting_aspects_ros.nodes.aspect_classifier.node import AspectClassifier
from resting_aspects_ros.nodes.drop_recorder.node import DropRecorder
from resting_aspects_ros.nodes.drop_simulator.node import DropSimulator
from resting_aspects_ros.ros.program import spin_nodes

DESCRIPTION = """Run drop_simulator, aspect_classifier and drop_recorder in one process,
until Ctrl-C. Each node is also a separate program, whose --help lists its
parameters."""
EXAMPLES = """examples:
  resting_aspects nodes
  resting_aspects nodes --ros-args -p parts_folder:=my_parts
  resting_aspects nodes --ros-args -p log_folder:=logs -r __ns:=/cell_1
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_ros_args(parser)


def run(arguments: argparse.Namespace) -> int:
    """Spin until a signal stops it; returns the exit code."""
    ros_args = ['--ros-args', *arguments.ros_args] if arguments.ros_args else []
    return spin_nodes([DropSimulator, AspectClassifier, DropRecorder], ros_args)
