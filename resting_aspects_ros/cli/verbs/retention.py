"""`resting_aspects retention`: how strong a disturbance makes a part leave each aspect."""

import argparse
from functools import partial
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.life_cycle import (
    exit_code,
    finish,
    partial_result,
    result_folder,
    session,
)
from resting_aspects_ros.cli.options import (
    add_confidence,
    add_contact_conditions,
    add_engine,
    add_integer,
    add_out,
    add_output,
    add_part,
    add_seed,
    add_workers,
    requested_conditions,
    requested_part,
)
from resting_aspects_ros.errors import StoppedError
from resting_aspects_ros.input_files import parse_quantity

if TYPE_CHECKING:
    from resting_aspects_ros.api.retention import RetentionResult

DESCRIPTION = """Disturb a part at rest in each aspect with rising energy, and show at which
energy it leaves the aspect. The energy is given as a lift height: the height by
which it would lift the centre of mass. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects retention l_bracket
  resting_aspects retention my_part.stl --per-height 1000 --out result
  resting_aspects retention l_bracket --report
  resting_aspects retention hex_nut --max-lift 20mm --friction 0.4 --json
"""
DOCUMENT, PICTURE, PAGE = 'retention.json', 'retention.png', 'retention.html'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    add_integer(
        parser,
        '--per-height',
        'number of disturbances of each energy from each aspect (400)',
        default=400,
    )
    parser.add_argument(
        '--max-lift',
        metavar='M',
        type=lambda text: parse_quantity('--max-lift', text, 'm'),
        help='maximum lift height, such as 20mm (20 times the barrier of the aspect, at most '
        'twice the radius of the part)',
    )
    add_seed(parser, 'curves')
    add_confidence(parser)
    add_engine(parser)
    add_workers(parser)
    add_out(
        parser,
        f'write {DOCUMENT} and {PICTURE} into this folder',
        f'{PAGE}, a page with the curves and all conditions',
    )
    add_output(parser, each=False)
    add_contact_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        from resting_aspects_ros.api.retention import retention

        part = requested_part(arguments)
        out = result_folder(arguments, part.name, (DOCUMENT, PICTURE))
        simulate = partial(
            retention,
            part,
            arguments.per_height,
            surface=requested_conditions(arguments),
            max_lift=arguments.max_lift,
            seed=arguments.seed,
            confidence=arguments.confidence,
            engine=arguments.engine,
            **started.options,
        )
        result, failure = partial_result(simulate)
        if not result.curves:
            raise failure or StoppedError('interrupted; no part was disturbed')
        document = DOCUMENT, result.to_json
        files = {} if arguments.report else {PICTURE: result.save_picture}
        finish(arguments, out, document, files, partial(_show, result), result.report)
        disturbed = sum(int(curve.parts.sum()) for curve in result.curves)
        has = f'{disturbed} of {result.run.drops} disturbances'
        return exit_code(has, complete=result.complete, failure=failure)


def _show(result: 'RetentionResult') -> None:
    from resting_aspects_ros.cli.console import show_table
    from resting_aspects_ros.report.transitions import retention_table

    show_table(retention_table(result.curves, result.title, result.run.conditions.gravity))
