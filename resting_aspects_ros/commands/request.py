"""`resting_aspects request`: ask a running suite for a distribution, as a ROS client."""

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.commands.interruption import Interruption
from resting_aspects_ros.commands.options import add_conditions, add_run, conditions_of, drops_of
from resting_aspects_ros.commands.outputs import check_output
from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.surfaces import Surfaces

if TYPE_CHECKING:
    from resting_aspects_ros.commands.answer import Answer
    from resting_aspects_ros.core.part import Part

EXAMPLES = """examples:
  resting_aspects nodes                      (in another terminal)
  resting_aspects request l_bracket --drops 2000
  resting_aspects request hex_nut --only-known --json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'request',
        help='ask the running ROS nodes for a distribution',
        description='Call get_distribution of the running nodes: a known distribution is\n'
        'answered at once, otherwise the part is dropped first. What follows --ros-args\n'
        'goes to ROS.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('part', metavar='PART', help='name of a part that the simulator knows')
    add_run(parser, None)
    parser.add_argument('--only-known', action='store_true', help='do not drop')
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.add_argument('--picture', metavar='FILE.png', type=Path, help='write a picture')
    add_conditions(parser)
    parser.add_argument('--ros-args', nargs=argparse.REMAINDER, default=[], help='for ROS')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for what the suite refuses."""
    with Interruption() as stop:
        check_output('--picture', arguments.picture)
        conditions = conditions_of(arguments, Surfaces.read(surfaces_file()))
        # A second to import, which --help does not need.
        from resting_aspects_ros.commands.progress import DropProgress
        from resting_aspects_ros.nodes.client import distribution_request, suite_client

        request = distribution_request(
            arguments.part,
            conditions,
            *drops_of(arguments),
            arguments.seed,
            only_known=arguments.only_known,
        )
        with ExitStack() as stack:
            try:
                client = stack.enter_context(suite_client(['--ros-args', *arguments.ros_args]))
            except RuntimeError as error:  # all that rclpy raises for arguments
                words = ' '.join(arguments.ros_args)
                raise InvalidValueError(f'--ros-args is {words!r}, ROS refuses: {error}') from None
            with DropProgress(arguments.part, request.drops) as progress:
                message = client.get(request, progress.update, stop.check)
                progress.end(message.drops)
            answer = answer_from(message, client.part(arguments.part))
        if arguments.picture is not None:
            answer.save_picture(arguments.picture)
        answer.print(as_json=arguments.json)
    return 0


def answer_from(message: Any, part: 'Part') -> 'Answer':
    """The answer in an AspectDistribution."""
    from resting_aspects_ros.commands.answer import Answer
    from resting_aspects_ros.nodes.convert import run_from
    from resting_aspects_ros.nodes.distribution_messages import distribution_from

    distribution, run = distribution_from(message), run_from(message.run)
    return Answer(distribution, run, part, message.method, message.complete)
