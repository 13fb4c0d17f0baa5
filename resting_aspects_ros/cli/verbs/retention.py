"""`resting_aspects retention`: how strong a disturbance makes a part leave each aspect."""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.life_cycle import (
    exit_code,
    finish,
    partial_result,
    result_folder,
    session,
    text_file,
)
from resting_aspects_ros.cli.options import (
    add_confidence,
    add_contact_conditions,
    add_engine,
    add_output,
    add_part,
    add_workers,
    parse_integer,
    parse_share,
    requested_conditions,
)
from resting_aspects_ros.errors import StoppedError
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.simulation.limits import DEFAULT_SEED

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
DOCUMENT, PICTURE = 'retention.json', 'retention.png'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--per-height',
        metavar='N',
        type=parse_integer,
        default=400,
        help='number of disturbances of each energy from each aspect (400)',
    )
    parser.add_argument(
        '--max-lift',
        metavar='M',
        help='maximum lift height, such as 20mm (20 times the barrier of the aspect, at most '
        'twice the radius of the part)',
    )
    parser.add_argument(
        '--seed',
        metavar='S',
        type=parse_integer,
        default=DEFAULT_SEED,
        help=f'the same seed gives the same curves ({DEFAULT_SEED})',
    )
    add_confidence(parser)
    add_engine(parser)
    add_workers(parser)
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        help='write retention.json and retention.png into this folder',
    )
    parser.add_argument(
        '--report',
        action='store_true',
        help='also write retention.html, a page with the curves and all conditions, into the '
        'folder of --out (out/ and the part)',
    )
    add_output(parser, each=False)
    add_contact_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    confidence = parse_share('--confidence', arguments.confidence)
    lift = arguments.max_lift
    with session(arguments) as started:
        # These imports are slow because of NumPy.
        from resting_aspects_ros.api.load_part import load_part
        from resting_aspects_ros.api.retention import retention

        part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
        out = result_folder(arguments, part.name, (DOCUMENT, PICTURE))
        simulate = partial(
            retention,
            part,
            arguments.per_height,
            surface=requested_conditions(arguments),
            max_lift=None if lift is None else parse_quantity('--max-lift', lift, 'm'),
            seed=arguments.seed,
            confidence=confidence,
            engine=arguments.engine,
            **started.options,
        )
        result, failure = partial_result(simulate)
        if not result.curves:
            raise failure or StoppedError('interrupted; no part was disturbed')
        files = {DOCUMENT: text_file(result.to_json)}
        if not arguments.report:
            files[PICTURE] = result.save_picture
        report = result.report if arguments.report else None
        finish(arguments, out, files, partial(_show, result, as_json=arguments.json), report)
        disturbed = sum(int(curve.parts.sum()) for curve in result.curves)
        has = f'{disturbed} of {result.run.drops} disturbances'
        return exit_code(has, complete=result.complete, failure=failure)


def _show(result: 'RetentionResult', *, as_json: bool) -> None:
    from resting_aspects_ros.cli.console import make_console, show_table
    from resting_aspects_ros.report.transitions import retention_table

    if as_json:
        sys.stdout.write(result.to_json())
        return
    table = retention_table(result.curves, result.title, result.run.conditions.gravity)
    show_table(make_console(), table)
