"""`resting_aspects request`: ask a running suite for a distribution, as a ROS client."""

import argparse
import sys
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import (
    add_conditions,
    add_run,
    check_output,
    conditions_of,
)
from resting_aspects_ros.commands.progress import DropProgress
from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.drops.surfaces import Surfaces

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
        description='Call get_distribution of the running nodes: a known distribution is answered '
        'at once, otherwise the part is dropped first. What follows --ros-args goes to ROS.',
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
    check_output('--picture', arguments.picture)
    conditions = conditions_of(arguments, Surfaces.read(surfaces_file()))
    from resting_aspects_ros.nodes.client import distribution_request, suite_client

    request = distribution_request(
        arguments.part, conditions, arguments.drops, arguments.seed, arguments.only_known
    )
    ros_args = ['--ros-args', *arguments.ros_args] if arguments.ros_args else []
    with suite_client(ros_args) as client:
        with DropProgress(arguments.part, arguments.drops) as progress:
            answer = client.get(request, progress.update)
        part = client.part(arguments.part) if arguments.picture else None
    show(answer, part, as_json=arguments.json, picture=arguments.picture)
    return 0


def show(answer: Any, part: Any, *, as_json: bool, picture: Path | None) -> None:
    """Print an AspectDistribution as a table or a document; save its picture."""
    from resting_aspects_ros.nodes.convert import distribution_from, run_from

    distribution, run = distribution_from(answer), run_from(answer.run)
    surface = run.conditions.surface or 'own conditions'
    title = f'{run.part}, {distribution.drops} drops on {surface}, seed {run.seed}'
    if picture is not None:
        from resting_aspects_ros.report.picture import save_picture

        save_picture(distribution, part, picture, title)
    if as_json:
        import dataclasses

        from resting_aspects_ros.report.document import distribution_document, to_json

        fields = {**dataclasses.asdict(run), 'method': answer.method, 'complete': answer.complete}
        sys.stdout.write(to_json(distribution_document(distribution, fields)))
        return
    from rich.console import Console

    from resting_aspects_ros.report.table import distribution_table

    Console().print(distribution_table(distribution, title))
