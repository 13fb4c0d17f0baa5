"""`resting_aspects replay`: playback of a log on the topics of the suite."""

import argparse
from pathlib import Path

from resting_aspects_ros.cli.options import add_number, add_ros_args
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import printable
from resting_aspects_ros.nodes.log_replayer.node import LogReplayer
from resting_aspects_ros.ros.program import spin_nodes

DESCRIPTION = """Publish the messages of a log on the topics of the suite, with the recorded
QoS, bytes and pauses, so that a controller can be developed without drops.
Names are relative to the namespace of the command, not to the recorded one. It
keeps running after the last message so that late subscribers receive the
latched topics: part, poses and last distribution. The services
log_replayer/pause and log_replayer/resume pause and resume it."""
EXAMPLES = """examples:
  resting_aspects replay out/logs/l_bracket_20250131T235959Z_4f1c
  resting_aspects replay run.mcap --rate 10 --ros-args -r __ns:=/cell_1
  resting_aspects replay run.mcap --as-fast-as-possible
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'log', metavar='LOG', type=Path, help='folder of a run, or an .mcap file, closed or not'
    )
    pace = parser.add_mutually_exclusive_group()
    text = 'playback speed relative to the recording: 0.001 to 1000 (1)'
    add_number(pace, '--rate', '', text)
    pace.add_argument(
        '--as-fast-as-possible',
        action='store_true',
        help='publish without the recorded pauses. A topic with more messages than its depth '
        '(200 for resting_poses) may lose some',
    )
    parser.add_argument(
        '--loop',
        action='store_true',
        help='start again one second after the end. The runs keep their ids: aspect_classifier '
        'and drop_recorder count no drop twice',
    )
    parser.add_argument(
        '--clock',
        action='store_true',
        help='publish the recorded time on /clock, for nodes with use_sim_time',
    )
    add_ros_args(parser)


def run(arguments: argparse.Namespace) -> int:
    """Spin until a signal stops it; returns the exit code."""
    if printable(str(arguments.log)) != str(arguments.log):
        raise InvalidValueError(
            f'invalid log {str(arguments.log)!r}: expected a name in UTF-8, as ROS requires'
        )
    given: dict[str, object] = {'log': str(arguments.log)}
    if arguments.rate is not None:
        given['rate'] = arguments.rate
    flags = ('as_fast_as_possible', 'loop', 'clock')
    given |= {name: True for name in flags if getattr(arguments, name)}
    ros_args = ['--ros-args', *arguments.ros_args] if arguments.ros_args else []
    return spin_nodes([lambda: LogReplayer(given)], ros_args)
