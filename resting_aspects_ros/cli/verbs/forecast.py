"""`resting_aspects forecast`: parts per minute of a feeder with a camera and a robot."""

import argparse
import re
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.cli.action_options import add_action_values, requested_actions
from resting_aspects_ros.cli.life_cycle import DONE, finish, result_folder, session
from resting_aspects_ros.cli.options import (
    add_actions_file,
    add_confidence,
    add_contact_conditions,
    add_integer,
    add_out,
    add_output,
    add_part_place,
    add_seed,
    add_workers,
    parse_numbers,
    requested_conditions,
    requested_part,
)
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS

if TYPE_CHECKING:
    from resting_aspects_ros.api.forecast_result import ForecastResult
    from resting_aspects_ros.api.reorient import ReorientResult
    from resting_aspects_ros.feeding.footprint import Footprint
    from resting_aspects_ros.part.part import Part

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
DOCUMENT, PICTURE, PAGE = 'forecast.json', 'forecast.png', 'forecast.html'
PER_ASPECT = 200
# Longer sides are probably mistakes of the unit.
MAX_SIDE = 5.0
_SIDE = re.compile(r'\s*([\d.]+)\s*([a-z]*)\s*', re.IGNORECASE)
# Texts of the times, s; those without a default are None or that of the action.
_TIMES = {
    'robot': 'from one pick of the robot to the next (1.2)',
    'vibrate': 'vibration before each image (that of the action)',
    'settle': 'from the end of the vibration until the parts are at rest (that of the action)',
    'image': 'image and its evaluation (0.2)',
    'supply': 'supply of a part, for each supplied part (0)',
    'place': 'with --overlap: how long the robot is away from the tray after its last pick (half '
    'of --robot)',
}


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
    add_actions_file(parser)
    add_integer(
        parser,
        '--per-aspect',
        f'number of actions from each aspect ({PER_ASPECT}); four times as many halve the '
        'interval',
        default=PER_ASPECT,
    )
    add_integer(
        parser,
        '--drops',
        f'number of drops; supplied parts have their distribution ({DEFAULT_DROPS})',
        default=DEFAULT_DROPS,
    )
    add_seed(parser, 'forecast')
    add_confidence(parser)
    add_workers(parser)
    add_out(
        parser,
        f'write {DOCUMENT} and {PICTURE} into this folder',
        f'{PAGE}, a page with the curves and all numbers',
    )
    add_output(parser, each=False)
    add_action_values(parser)
    add_contact_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        from resting_aspects_ros.api.forecast import forecast
        from resting_aspects_ros.api.result import save_figure

        cell, simulation = _cell(arguments), _simulation(arguments)
        sets = _sets(arguments)
        parts = [requested_part(arguments, given) for given in arguments.part]
        out = result_folder(arguments, parts[0].name, (DOCUMENT, PICTURE))
        results: list[ForecastResult] = []
        for part, of_part in zip(parts, sets, strict=True):
            known: Part | ReorientResult = part
            more = {**simulation, **started.options}
            for pickable, classes in of_part:
                found = forecast(known, pickable, pickable_classes=classes, **cell, **more)
                results.append(found)
                # The next forecast of this part does not need another simulation.
                known, more = found.reorientation, {'stopped': started.options['stopped']}
        first, *others = results
        finish(
            arguments,
            out,
            (DOCUMENT, partial(first.to_json, others)),
            {}
            if arguments.report
            else {PICTURE: lambda path: save_figure(first.figure(others), path)},
            partial(_show, results),
            lambda folder: first.report(folder, others),
        )
        return DONE


def _cell(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the feeder and the robot; raises InvalidValueError."""
    options = requested_times(arguments)
    if arguments.gripper is not None:
        options['gripper'] = parse_gripper(arguments.gripper)
    return options | {
        'tray': parse_tray(arguments.tray),
        'clearance': parse_quantity('--clearance', arguments.clearance, 'm'),
        'parts_on_tray': arguments.parts_on_tray,
        'max_picks': arguments.max_picks,
        'minutes': parse_quantity('--minutes', arguments.minutes, ''),
    }


def _simulation(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the drops and the actions; raises InvalidValueError."""
    from resting_aspects_ros.api.forecast import DEFAULT_ACTION

    arguments.action = arguments.action or DEFAULT_ACTION
    actions = requested_actions(arguments)
    if len(actions) > 1:
        raise InvalidValueError(f'invalid --action {arguments.action!r}: expected a single action')
    return {
        'action': actions[0],
        'per_aspect': arguments.per_aspect,
        'drops': arguments.drops,
        'seed': arguments.seed,
        'surface': requested_conditions(arguments),
        'confidence': arguments.confidence,
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


def _show(results: 'Sequence[ForecastResult]') -> None:
    """Print a sentence for each result, then the table, and notes."""
    from resting_aspects_ros.cli.console import show_table, show_texts
    from resting_aspects_ros.report.forecast import (
        cell_text,
        forecast_table,
        range_text,
    )

    names = [f'{result.named.title}: ' if len(results) > 1 else '' for result in results]
    for name, result in zip(names, results, strict=True):
        show_texts(f'{name}{result.sentence}', soft_wrap=True)
    show_texts(cell_text(results[0].named))
    print()
    show_table(forecast_table([result.named for result in results]))
    for name, result in zip(names, results, strict=True):
        if text := range_text(result.named):
            show_texts(f'{name}{text}')
    show_texts(*_notes(results))


def _notes(results: 'Sequence[ForecastResult]') -> list[str]:
    """Return the notes of all results; with a name if they do not hold for each of them."""
    notes = [(result.named.title, result.notes) for result in results]
    common = [note for note in notes[0][1] if all(note in each for _, each in notes)]
    named = [f'{name}: {note}' for name, each in notes for note in each if note not in common]
    return [*common, *named]


# -- The feeder, the camera and the robot, which feeder_demo has, too -----------------------------


def add_pickable(parser: argparse.ArgumentParser) -> None:
    """Add --pickable and --pickable-classes, each of which can be given several times."""
    group = parser.add_mutually_exclusive_group(required=True)
    group.add_argument(
        '--pickable',
        metavar='IDS',
        action='append',
        help='aspects in which the robot can pick the part, such as 1,3; repeat it to compare '
        'several sets, or to give each of several parts a set',
    )
    group.add_argument(
        '--pickable-classes', metavar='NUMBERS', action='append', help='symmetry classes instead'
    )


def add_cell(
    parser: argparse.ArgumentParser, minutes: str, duration: str, *, gripper: bool
) -> None:
    """Add the times of a cycle, the tray and, if requested, the gripper.

    minutes, duration : default of --minutes, and what it is the duration of
    """
    group = parser.add_argument_group(
        'feeder, camera and robot',
        'A cycle is a vibration, the time until the parts are at rest, an image, and\n'
        'the picks of all free parts in it. Times may have a unit, such as 1.2s or\n'
        '200ms; lengths too, such as 5mm.',
    )
    for name, text in _TIMES.items():
        group.add_argument(f'--{name}', metavar='S', help=text)
    group.add_argument(
        '--overlap',
        action='store_true',
        help='the next vibration, settling and image run while the robot places the last part',
    )
    group.add_argument(
        '--tray',
        metavar='WxD',
        default='200x200mm',
        help='width and depth of the tray (200x200mm)',
    )
    group.add_argument(
        '--clearance',
        metavar='M',
        default='5mm',
        help='minimum distance from a part that can be picked to any other part (5mm)',
    )
    if gripper:
        group.add_argument(
            '--gripper',
            metavar='LxW',
            help='footprint of the gripper, in which no other part may be: length along the part '
            'and width, or a diameter, such as 40x10mm or 20mm (none)',
        )
    add_integer(
        group, '--parts-on-tray', 'number of parts on the tray (the one with the highest rate)'
    )
    add_integer(group, '--max-picks', 'maximum number of picks after one image (all free parts)')
    group.add_argument(
        '--minutes', metavar='MIN', default=minutes, help=f'duration of {duration} ({minutes})'
    )


def requested_times(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `cycle_times` that have a flag; raises InvalidValueError."""
    times: dict[str, Any] = {
        name: parse_quantity(f'--{name}', text, 's')
        for name in _TIMES
        if (text := getattr(arguments, name)) is not None
    }
    return {**times, 'overlap': arguments.overlap}


def parse_tray(text: str) -> tuple[float, float]:
    """Return width and depth, m, of '200x150mm'; raises InvalidValueError."""
    sides = _sides('--tray', text, 'two sides with a unit, such as 200x150mm')
    if len(sides) != 2 or not all(0 < side <= MAX_SIDE for side in sides):
        raise InvalidValueError(
            f'invalid --tray {shown(text)}: expected two sides of more than 0 and at most '
            f'{MAX_SIDE:g} m, with a unit, such as 200x150mm'
        )
    return sides[0], sides[1]


def parse_gripper(text: str) -> 'Footprint':
    """Return the footprint '40x10mm', a rectangle, or '20mm', a disc; raises InvalidValueError."""
    from resting_aspects_ros.feeding.footprint import Footprint

    expected = 'length and width, or a diameter, with a unit, such as 40x10mm or 20mm'
    sides = _sides('--gripper', text, expected)
    if len(sides) > 2 or not all(0 < side <= MAX_SIDE for side in sides):
        raise InvalidValueError(f'invalid --gripper {shown(text)}: expected {expected}')
    return Footprint(sides[0], sides[1]) if len(sides) == 2 else Footprint(0, 0, sides[0] / 2)


def _sides(flag: str, text: str, expected: str) -> list[float]:
    """Return lengths, m, of '200x150mm'; the last unit is that of sides without one."""
    found = [_SIDE.fullmatch(side) for side in text.lower().split('x')]
    if None in found:
        raise InvalidValueError(f'invalid {flag} {shown(text)}: expected {expected}')
    pairs = [(match[1], match[2]) for match in found if match]
    unit = pairs[-1][1]
    return [parse_quantity(flag, number + (own or unit), 'm') for number, own in pairs]
