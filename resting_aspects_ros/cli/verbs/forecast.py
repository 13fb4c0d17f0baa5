"""`resting_aspects forecast`: parts per minute of a feeder with a camera and a robot."""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.cli.action_options import add_action_values, requested_actions
from resting_aspects_ros.cli.forecast_options import (
    add_cell,
    add_pickable,
    parse_gripper,
    parse_tray,
    requested_times,
)
from resting_aspects_ros.cli.life_cycle import DONE, finish, result_folder, session, text_file
from resting_aspects_ros.cli.options import (
    add_confidence,
    add_contact_conditions,
    add_output,
    add_part_place,
    add_workers,
    parse_integer,
    parse_numbers,
    parse_share,
    requested_conditions,
)
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.simulation.limits import DEFAULT_DROPS, DEFAULT_SEED

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
    confidence = parse_share('--confidence', arguments.confidence)
    with session(arguments) as started:
        # These imports are slow because of NumPy and shapely.
        from resting_aspects_ros.api.forecast import forecast_each
        from resting_aspects_ros.api.forecast_result import save_forecast_picture
        from resting_aspects_ros.api.load_part import load_part

        options = _options(arguments)
        sets = _sets(arguments)
        parts = [
            load_part(name, arguments.unit, arguments.parts, arguments.body)
            for name in arguments.part
        ]
        out = result_folder(arguments, parts[0].name, (DOCUMENT, PICTURE))
        requests = list(zip(parts, sets, strict=True))
        results = forecast_each(requests, confidence=confidence, **options, **started.options)
        first, *others = results
        files: dict[str, Callable[[Path], object]] = {
            DOCUMENT: text_file(partial(first.to_json, others))
        }
        if not arguments.report:
            files[PICTURE] = partial(save_forecast_picture, results)
        show = partial(_show, results, as_json=arguments.json)
        report = (lambda folder: first.report(folder, others)) if arguments.report else None
        finish(arguments, out, files, show, report)
        return DONE


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the forecast that the flags request; raises InvalidValueError."""
    from resting_aspects_ros.api.forecast import DEFAULT_ACTION

    arguments.action = arguments.action or DEFAULT_ACTION
    actions = requested_actions(arguments)
    if len(actions) > 1:
        raise InvalidValueError(f'invalid --action {arguments.action!r}: expected a single action')
    options = requested_times(arguments)
    if arguments.grasps is not None:
        # The import of shapely is only needed here.
        from resting_aspects_ros.api.grasps import load_grasps

        if arguments.gripper is not None:
            raise InvalidValueError('invalid --gripper: expected none with --grasps')
        if len(arguments.part) > 1:
            raise InvalidValueError('invalid --grasps: expected a single part')
        options['grasps'] = load_grasps(arguments.grasps)
    if arguments.gripper is not None:
        options['gripper'] = parse_gripper(arguments.gripper)
    return options | {
        'action': actions[0],
        'tray': parse_tray(arguments.tray),
        'clearance': parse_quantity('--clearance', arguments.clearance, 'm'),
        'parts_on_tray': arguments.parts_on_tray,
        'max_picks': arguments.max_picks,
        'minutes': parse_quantity('--minutes', arguments.minutes, ''),
        'controller': arguments.controller,
        'per_aspect': arguments.per_aspect,
        'drops': arguments.drops,
        'seed': arguments.seed,
        'surface': requested_conditions(arguments),
    }


_Sets = list[tuple[tuple[int, ...] | None, tuple[int, ...] | None]]


def _sets(arguments: argparse.Namespace) -> list[_Sets]:
    """Return for each part the requested sets of ids or of numbers of classes."""
    by_id = arguments.pickable is not None
    flag = '--pickable' if by_id else '--pickable-classes'
    texts = arguments.pickable if by_id else arguments.pickable_classes
    numbers = [parse_numbers(flag, text) for text in texts]
    sets: _Sets = [(each, None) if by_id else (None, each) for each in numbers]
    parts = len(arguments.part)
    if parts == 1 or len(sets) == 1:
        return [sets] * parts
    if len(sets) != parts:
        raise InvalidValueError(
            f'invalid {flag}: {len(sets)} sets for {parts} parts: expected one set, or one for '
            'each part'
        )
    return [[each] for each in sets]


def _show(results: 'Sequence[ForecastResult]', *, as_json: bool) -> None:
    """Print a sentence for each result, then the table, and notes; or a document."""
    if as_json:
        sys.stdout.write(results[0].to_json(results[1:]))
        return
    from resting_aspects_ros.cli.console import make_console, show_table
    from resting_aspects_ros.report.forecast import (
        cell_text,
        controlled_text,
        forecast_table,
        range_text,
    )

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
    for result in results:
        if text := range_text(result.named):
            name = f'{result.named.title}: ' if several else ''
            console.print(f'{name}{text}', markup=False, highlight=False)
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
