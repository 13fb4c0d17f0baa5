"""`resting_aspects request`: request a distribution from a running suite, as a ROS client."""

import argparse
import dataclasses
from typing import Any

from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.model_range import missing_in
from resting_aspects_ros.api.runner import DropProgress
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import print_result
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.client import NotAvailableError, RestingAspectsClient, UnknownPartError
from resting_aspects_ros.errors import warn
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import run_from
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
    MAX_DROPS,
    DropConditions,
)
from resting_aspects_ros.statistics.intervals import max_drops
from resting_aspects_ros.system import Interruption

DESCRIPTION = """Call the service get_distribution of the running nodes. A known distribution is
returned at once, otherwise the part is dropped first."""
EXAMPLES = """examples:
  resting_aspects nodes                      (in another terminal)
  resting_aspects request l_bracket --drops 2000
  resting_aspects request hex_nut --only-known --json
  resting_aspects request hex_nut --ros-args -r __ns:=/cell_1
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('part', metavar='PART', help='name of a part that the simulator knows')
    options.add_run(parser, f'a known run with any seed, or a new run with {DEFAULT_SEED}')
    parser.add_argument(
        '--only-known',
        action='store_true',
        help='do not drop; without --drops and --precision accept any known distribution',
    )
    options.add_output(parser)
    options.add_conditions(parser, "the simulator's default")
    options.add_surroundings(parser)
    options.add_ros_args(parser)


def run(arguments: argparse.Namespace) -> None:
    """Request and show. Raises RestingAspectsError."""
    with (
        Interruption() as stop,
        RestingAspectsClient(ros_args=arguments.ros_args, check=stop.check) as client,
    ):
        conditions = _conditions(arguments, client)
        precision = arguments.precision or 0.0
        drops = arguments.drops or (0 if precision else DEFAULT_DROPS)
        with DropProgress(arguments.part, max_drops(drops, precision, MAX_DROPS)) as progress:
            message = client.get_distribution(
                arguments.part,
                drops=arguments.drops,
                precision=precision,
                conditions=conditions,
                seed=arguments.seed,
                only_known=arguments.only_known,
                progress=progress.update,
            )
            progress.end(message.drops)
        result = result_from(message, _part(client, arguments.part))
    show_result(arguments, result.to_json, lambda: print_result(result, each=arguments.each))


def _conditions(
    arguments: argparse.Namespace, client: RestingAspectsClient
) -> DropConditions | None:
    """Return the requested conditions; None if no flag gives any."""
    conditions = options.requested_conditions(arguments)
    changes = options.changed_conditions(arguments)
    if arguments.surface:
        return conditions
    if not (changes or arguments.surroundings):
        return None
    return dataclasses.replace(
        client.default_conditions().changed(**changes), surroundings=conditions.surroundings
    )


def _part(client: RestingAspectsClient, name: str) -> Part | None:
    """Return the part if a simulator offers it, else None with a warning."""
    try:
        return client.get_part(name)
    except (NotAvailableError, UnknownPartError) as error:
        warn(f'the part and its supports are not shown: {error}')
        return None


def result_from(message: Any, part: Part | None) -> DropResult:
    """Convert an AspectDistribution into a result."""
    distribution, run = distribution_from(message), run_from(message.run)
    return DropResult(
        distribution,
        run,
        part,
        message.complete,
        contacts=distribution.contacts,
        no_model_range='' if distribution.model else missing_in(run),
    )
