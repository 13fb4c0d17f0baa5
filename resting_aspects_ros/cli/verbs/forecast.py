"""`resting_aspects forecast`: parts per minute of a feeder with a camera and a robot."""

import argparse
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.action_options import add_action_values
from resting_aspects_ros.cli.forecast_options import add_cell, add_pickable
from resting_aspects_ros.cli.options import (
    add_confidence,
    add_contact_conditions,
    add_output,
    add_part_place,
    add_workers,
)
from resting_aspects_ros.cli.result_folder import make_result_folder
from resting_aspects_ros.cli.start_workers import start_workers
from resting_aspects_ros.cli.values import parse_integer, parse_share
from resting_aspects_ros.simulation.interruption import Interruption, catch
from resting_aspects_ros.simulation.job import DEFAULT_DROPS, DEFAULT_SEED

if TYPE_CHECKING:
    from resting_aspects_ros.api.forecast_result import ForecastResult

DESCRIPTION = """Predict how many parts per minute a robot picks from a vibrating tray under a
camera: the rate with its interval, the best number of parts on the tray, how
often nothing can be picked, and whether the robot, the feeder or vision limits.
Parts do not lean on each other or entangle in this model, which holds up to a
coverage of the tray of about 30 %. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects forecast l_bracket --pickable 1,3
  resting_aspects forecast hex_nut --pickable-classes 1 --robot 0.9s --overlap
  resting_aspects forecast l_bracket --pickable 1 --pickable 1,3 --report
  resting_aspects forecast old.stl new.stl --pickable 1 --tray 300x200mm --json
  resting_aspects forecast hex_nut --pickable-classes 1 --parts-on-tray 40
"""
DOCUMENT, PICTURE = 'forecast.json', 'forecast.png'
INTERRUPTED = 130
PER_ASPECT = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'part',
        metavar='PART_OR_MESH',
        nargs='+',
        help='name of a part, or a mesh file; several are shown side by side',
    )
    add_part_place(parser)
    add_pickable(parser)
    add_cell(parser, '60', 'a run, for the interval of its rate', gripper=True)
    parser.add_argument(
        '--action',
        metavar='NAME',
        help='what the feeder does before each image: an action of config/actions.yaml or of '
        '--actions, or a kind of action with the values below (flip)',
    )
    parser.add_argument(
        '--actions', metavar='FILE', type=Path, help='file of named actions (config/actions.yaml)'
    )
    parser.add_argument(
        '--grasps',
        metavar='FILE',
        type=Path,
        help='YAML file of the grasps of the part instead of --gripper, such as '
        'config/grasps/l_bracket.yaml (none)',
    )
    parser.add_argument(
        '--controller',
        action='store_true',
        help='also simulate runs in which feeder_controller decides, about 5 s for each forecast',
    )
    parser.add_argument(
        '--per-aspect',
        metavar='N',
        type=parse_integer,
        default=PER_ASPECT,
        help=f'number of actions from each aspect ({PER_ASPECT}); four times as many halve the '
        'interval',
    )
    parser.add_argument(
        '--drops',
        metavar='N',
        type=parse_integer,
        default=DEFAULT_DROPS,
        help=f'number of drops; supplied parts have their distribution ({DEFAULT_DROPS})',
    )
    parser.add_argument(
        '--seed',
        metavar='S',
        type=parse_integer,
        default=DEFAULT_SEED,
        help=f'the same seed gives the same forecast ({DEFAULT_SEED})',
    )
    add_confidence(parser)
    add_workers(parser)
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        help='write forecast.json and forecast.png into this folder',
    )
    parser.add_argument(
        '--report',
        action='store_true',
        help='also write forecast.html, a page with the curves and all numbers, into the folder '
        'of --out (out/ and the part)',
    )
    add_output(parser, each=False)
    add_action_values(parser)
    add_contact_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with Interruption() as stop, ExitStack() as stack:
        confidence = parse_share('--confidence', arguments.confidence)
        # These imports are slow because of NumPy.
        from resting_aspects_ros.cli.forecast_run import make_forecasts, requested_forecasts

        requested = requested_forecasts(arguments, confidence)
        part_name = requested.parts[0].name
        out = make_result_folder(arguments, part_name, (DOCUMENT, PICTURE), _check_report)
        workers = start_workers(arguments, stack)
        results = make_forecasts(requested, workers, lambda: stop.asked)
        if not results:
            print('interrupted; there is no forecast', file=sys.stderr)
            return INTERRUPTED
        _write(results, out, arguments)
        return 0


def _check_report(flag: str, out: Path) -> None:
    # This import is slow, and only needed for a report.
    from resting_aspects_ros.api.forecast_result import check_forecast_report

    check_forecast_report(flag, out)


def _write(
    results: 'Sequence[ForecastResult]', out: Path | None, arguments: argparse.Namespace
) -> None:
    """Save and print the results, even if a step fails; the slow report is last."""
    from resting_aspects_ros.api.output_files import whole_file

    first, *others = results
    written = []
    try:
        if out is not None:
            with whole_file(out / DOCUMENT) as file:
                file.write_text(first.to_json(others), encoding='utf-8')
            written.append(out / DOCUMENT)
            if not arguments.report:
                from resting_aspects_ros.api.forecast_result import save_forecast_picture

                save_forecast_picture(results, out / PICTURE)
                written.append(out / PICTURE)
    finally:
        if arguments.json:
            sys.stdout.write(first.to_json(others))
        else:
            _show(results)
    if written and not arguments.json:
        print(f'Written: {", ".join(str(path) for path in written)}', flush=True)
    if arguments.report and out is not None:
        # Everything else is saved, so Ctrl-C may end the report at once.
        catch(signal.default_int_handler)
        from resting_aspects_ros.api.forecast_result import write_forecast_report

        page = write_forecast_report(results, out)
        if not arguments.json:
            print(f'Report: {page}')


def _show(results: 'Sequence[ForecastResult]') -> None:
    """Print a sentence for each result, then the table, and notes."""
    from resting_aspects_ros.cli.console import make_console, show_table
    from resting_aspects_ros.report.forecast import cell_text, controlled_text, forecast_table

    console = make_console()
    several = len(results) > 1
    for result in results:
        name = f'{result.named.title}: ' if several else ''
        lines = [result.sentence]
        if result.controlled is not None:
            lines.append(controlled_text(result.controlled))
        for line in lines:
            console.print(f'{name}{line}', markup=False, highlight=False, soft_wrap=True)
    console.print(cell_text(results[0].named), markup=False, highlight=False)
    console.print()
    show_table(console, forecast_table([result.named for result in results]))
    for note in _notes(results):
        console.print(note, markup=False, highlight=False)


def _notes(results: 'Sequence[ForecastResult]') -> list[str]:
    """Return the notes of all results; with a name if they do not hold for each of them."""
    notes = {result.named.title: result.notes for result in results}
    common = [note for note in results[0].notes if all(note in each for each in notes.values())]
    named = [
        f'{name}: {note}' for name, each in notes.items() for note in each if note not in common
    ]
    return [*common, *named]
