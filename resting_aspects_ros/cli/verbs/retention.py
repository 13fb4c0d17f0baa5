"""`resting_aspects retention`: how strong a disturbance makes a part leave each aspect."""

import argparse
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.options import (
    add_confidence,
    add_contact_conditions,
    add_engine,
    add_output,
    add_part,
    add_workers,
)
from resting_aspects_ros.cli.result_folder import make_result_folder
from resting_aspects_ros.cli.start_workers import start_workers
from resting_aspects_ros.cli.values import parse_integer, parse_quantity, parse_share
from resting_aspects_ros.simulation.interruption import Interruption, catch
from resting_aspects_ros.simulation.job import DEFAULT_SEED

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
INTERRUPTED = 130


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
    with Interruption() as stop, ExitStack() as stack:
        confidence = parse_share('--confidence', arguments.confidence)
        lift = arguments.max_lift
        max_lift = None if lift is None else parse_quantity('--max-lift', lift, 'm')
        # These imports are slow because of NumPy.
        from resting_aspects_ros.api.load_part import load_part
        from resting_aspects_ros.api.retention import retention
        from resting_aspects_ros.cli.options import requested_conditions

        conditions = requested_conditions(arguments)
        part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
        out = make_result_folder(arguments, part.name, (DOCUMENT, PICTURE), _check_report)
        result = retention(
            part,
            arguments.per_height,
            surface=conditions,
            max_lift=max_lift,
            seed=arguments.seed,
            confidence=confidence,
            engine=arguments.engine,
            workers=start_workers(arguments, stack),
            progress=True,
            stopped=lambda: stop.asked,
        )
        if not result.curves:
            print('interrupted; no part was disturbed', file=sys.stderr)
            return INTERRUPTED
        _write(result, out, arguments)
        if not result.complete:
            print('interrupted; the curves have fewer disturbances', file=sys.stderr)
            return INTERRUPTED
        return 0


def _check_report(flag: str, out: Path) -> None:
    # This import is slow, and only needed for a report.
    from resting_aspects_ros.api.reorientation_files import check_reorientation_report

    check_reorientation_report(flag, out, ())


def _write(result: 'RetentionResult', out: Path | None, arguments: argparse.Namespace) -> None:
    """Save and print the result, even if a step fails; the slow report is last."""
    from resting_aspects_ros.api.output_files import whole_file
    from resting_aspects_ros.cli.console import make_console, show_table
    from resting_aspects_ros.report.transitions import retention_table

    written = []
    try:
        if out is not None:
            with whole_file(out / DOCUMENT) as file:
                file.write_text(result.to_json(), encoding='utf-8')
            written.append(out / DOCUMENT)
            if not arguments.report:
                result.save_picture(out / PICTURE)
                written.append(out / PICTURE)
    finally:
        if arguments.json:
            sys.stdout.write(result.to_json())
        else:
            show_table(
                make_console(),
                retention_table(result.curves, result.title, result.run.conditions.gravity),
            )
    if written and not arguments.json:
        print(f'Written: {", ".join(str(path) for path in written)}', flush=True)
    if arguments.report and out is not None:
        # Everything else is saved, so Ctrl-C may end the report at once.
        catch(signal.default_int_handler)
        from resting_aspects_ros.api.reorientation_files import write_retention_report

        page = write_retention_report(result, out)
        if not arguments.json:
            print(f'Report: {page}')
