"""`resting_aspects request`: ask a running suite for a distribution, as a ROS client."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.commands.interruption import Interruption
from resting_aspects_ros.commands.options import (
    add_conditions,
    add_run,
    changes_of,
    conditions_of,
    drops_of,
)
from resting_aspects_ros.commands.outputs import check_output
from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.surfaces import Surfaces

if TYPE_CHECKING:
    from resting_aspects_ros.commands.answer import Answer
    from resting_aspects_ros.core.part import Part
    from resting_aspects_ros.nodes.client import SuiteClient

EXAMPLES = """examples:
  resting_aspects nodes                      (in another terminal)
  resting_aspects request l_bracket --drops 2000
  resting_aspects request hex_nut --only-known --json
  resting_aspects request hex_nut --method rolling
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
    parser.add_argument(
        '--method',
        metavar='NAME',
        default='drops',
        help='drops, or an analytic method of `estimate`, which knows no conditions (drops)',
    )
    parser.add_argument('--only-known', action='store_true', help='do not drop')
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.add_argument('--picture', metavar='FILE.png', type=Path, help='write a picture')
    add_conditions(parser, "the simulator's default")
    parser.add_argument('--ros-args', nargs=argparse.REMAINDER, default=[], help='for ROS')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for what the suite refuses."""
    with Interruption() as stop:
        if arguments.picture is not None and arguments.method != 'drops':
            raise InvalidValueError(
                f'--picture is {str(arguments.picture)!r}, allowed only with --method drops'
            )
        check_output('--picture', arguments.picture)
        if arguments.method != 'drops':
            return _estimate(arguments, stop)
        # Also without a surface: wrong values are refused before a suite is looked for.
        conditions = conditions_of(arguments, Surfaces.read(surfaces_file()))
        # A second to import, which --help does not need.
        from resting_aspects_ros.commands.progress import DropProgress
        from resting_aspects_ros.nodes.client import distribution_request
        from resting_aspects_ros.nodes.convert import conditions_msg

        request = distribution_request(
            arguments.part,
            conditions if arguments.surface else None,
            *drops_of(arguments),
            arguments.seed,
            only_known=arguments.only_known,
        )
        changes = {} if arguments.surface else changes_of(arguments)
        with _client(arguments) as client:
            if changes:
                changed = client.default_conditions().changed(**changes)
                request.conditions = [conditions_msg(changed)]
            with DropProgress(arguments.part, request.drops) as progress:
                message = client.get(request, progress.update, stop.check)
                progress.end(message.drops)
            answer = answer_from(message, client.part(arguments.part))
        if arguments.picture is not None:
            answer.save_picture(arguments.picture)
        answer.print(as_json=arguments.json)
    return 0


def _estimate(arguments: argparse.Namespace, stop: Interruption) -> int:
    """Ask for what an analytic method predicts, and show it."""
    from resting_aspects_ros.commands.estimate_here import show_estimates
    from resting_aspects_ros.nodes.client import estimate_request
    from resting_aspects_ros.nodes.distribution_messages import estimate_from

    request = estimate_request(arguments.part, arguments.method)
    with _client(arguments) as client:
        found = estimate_from(client.get(request, lambda _: None, stop.check))
        part = client.part(arguments.part)
    show_estimates(part, found.aspects, {found.method: found}, {}, as_json=arguments.json)
    return 0


@contextmanager
def _client(arguments: argparse.Namespace) -> 'Iterator[SuiteClient]':
    from resting_aspects_ros.nodes.client import suite_client

    with ExitStack() as stack:
        try:
            client = stack.enter_context(suite_client(['--ros-args', *arguments.ros_args]))
        except RuntimeError as error:  # all that rclpy raises for arguments
            words = ' '.join(arguments.ros_args)
            raise InvalidValueError(f'--ros-args is {words!r}, ROS refuses: {error}') from None
        yield client


def answer_from(message: Any, part: 'Part') -> 'Answer':
    """The answer in an AspectDistribution."""
    from resting_aspects_ros.commands.answer import Answer
    from resting_aspects_ros.nodes.convert import run_from
    from resting_aspects_ros.nodes.distribution_messages import distribution_from

    distribution, run = distribution_from(message), run_from(message.run)
    return Answer(distribution, run, part, message.method, message.complete)
