"""`resting_aspects forecast`: parts per minute of a feeder with a camera and a robot."""

import argparse
from functools import partial
from typing import Any

from resting_aspects_ros.api.forecast import DEFAULT_ACTION, forecast
from resting_aspects_ros.api.forecast_result import ForecastResult
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.api.result import save_figure
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_items
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.footprint import MAX_SIDE, Footprint
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS

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
"""
DOCUMENT, PICTURE, PAGE = 'forecast.json', 'forecast.png', 'forecast.html'
PER_ASPECT = 200
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
    options.add_part_place(parser)
    pickable = parser.add_mutually_exclusive_group(required=True)
    text = (
        'aspects in which the robot can pick the part, such as 1,3; repeat it to compare several '
        'sets, or to give each of several parts a set'
    )
    options.add_numbers(pickable, '--pickable', 'IDS', text, 'append')
    text = 'symmetry classes instead'
    options.add_numbers(pickable, '--pickable-classes', 'NUMBERS', text, 'append')
    _add_cell(parser)
    parser.add_argument(
        '--action',
        metavar='NAME',
        default=DEFAULT_ACTION,
        help='what the feeder does before each image: an action of config/actions.yaml or of '
        '--actions (flip)',
    )
    options.add_actions_file(parser)
    options.add_integer(
        parser,
        '--per-aspect',
        f'number of actions from each aspect ({PER_ASPECT}); four times as many halve the '
        'interval',
        default=PER_ASPECT,
    )
    options.add_integer(
        parser,
        '--drops',
        f'number of drops; supplied parts have their distribution ({DEFAULT_DROPS})',
        default=DEFAULT_DROPS,
    )
    options.add_seed(parser, 'forecast')
    options.add_confidence(parser)
    options.add_workers(parser)
    options.add_out(
        parser,
        f'write {DOCUMENT} and {PICTURE} into this folder',
        f'{PAGE}, a page with the curves and all numbers',
    )
    options.add_output(parser, each=False)
    options.add_contact_conditions(parser)


def run(arguments: argparse.Namespace) -> None:
    """Simulate and show. Raises RestingAspectsError for wrong input."""
    with life_cycle.session(arguments) as started:
        cell, simulation = _cell(arguments), _simulation(arguments)
        sets = _sets(arguments)
        parts = [options.requested_part(arguments, given) for given in arguments.part]
        out = life_cycle.result_folder(arguments, parts[0].name, (DOCUMENT, PICTURE))
        results: list[ForecastResult] = []
        for part, of_part in zip(parts, sets, strict=True):
            known: Part | ReorientResult = part
            more = {**simulation, **started}
            for pickable, classes in of_part:
                found = forecast(known, pickable, pickable_classes=classes, **cell, **more)
                results.append(found)
                # The next forecast of this part does not need another simulation.
                known, more = found.reorientation, {'stopped': started['stopped']}
        first, *others = results
        life_cycle.finish(
            arguments,
            out,
            (DOCUMENT, partial(first.to_json, others)),
            {}
            if arguments.report
            else {PICTURE: lambda path: save_figure(first.figure(others), path)},
            lambda: show_items(first.page(others).sections[0].items),
            lambda folder: first.report(folder, others),
        )


def _cell(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the feeder, the camera and the robot."""
    given = {name: getattr(arguments, name) for name in _TIMES}
    cell: dict[str, Any] = {name: time for name, time in given.items() if time is not None}
    same = ('overlap', 'tray', 'clearance', 'gripper', 'parts_on_tray', 'max_picks', 'minutes')
    return cell | {name: getattr(arguments, name) for name in same}


def _simulation(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the drops and the actions; raises InvalidValueError."""
    same = ('per_aspect', 'drops', 'seed', 'confidence')
    return {
        **{name: getattr(arguments, name) for name in same},
        'surface': options.requested_conditions(arguments),
        'action': options.known_actions(arguments).get(arguments.action),
    }


_Sets = list[tuple[tuple[int, ...] | None, tuple[int, ...] | None]]


def _sets(arguments: argparse.Namespace) -> list[_Sets]:
    """Return for each part the requested sets of ids or of numbers of classes."""
    by_id = arguments.pickable is not None
    flag = '--pickable' if by_id else '--pickable-classes'
    numbers = arguments.pickable if by_id else arguments.pickable_classes
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


# -- The feeder, the camera and the robot ---------------------------------------------------------


def _add_cell(parser: argparse.ArgumentParser) -> None:
    """Add the times of a cycle, the tray and the gripper."""
    group = parser.add_argument_group(
        'feeder, camera and robot',
        'A cycle is a vibration, the time until the parts are at rest, an image, and\n'
        'the picks of all free parts in it. Times may have a unit, such as 1.2s or\n'
        '200ms; lengths too, such as 5mm.',
    )
    for name, text in _TIMES.items():
        options.add_number(group, f'--{name}', 's', text)
    group.add_argument(
        '--overlap',
        action='store_true',
        help='the next vibration, settling and image run while the robot places the last part',
    )
    add_tray(group)
    text = 'minimum distance from a part that can be picked to any other part (5mm)'
    options.add_number(group, '--clearance', 'm', text, default='5mm')
    group.add_argument(
        '--gripper',
        metavar='LxW',
        type=parse_gripper,
        help='footprint of the gripper, in which no other part may be: length along the part '
        'and width, or a diameter, such as 40x10mm or 20mm (none)',
    )
    number = 'number of parts on the tray (the one with the highest rate)'
    options.add_integer(group, '--parts-on-tray', number)
    picks = 'maximum number of picks after one image (all free parts)'
    options.add_integer(group, '--max-picks', picks)
    text = 'duration of a run, for the interval of its rate (60)'
    options.add_number(group, '--minutes', '', text, default='60')


def add_tray(group: 'argparse._ActionsContainer') -> None:
    """Add --tray, two sides."""
    group.add_argument(
        '--tray',
        metavar='WxD',
        type=parse_tray,
        default='200x200mm',
        help='width and depth of the tray (200x200mm)',
    )


def parse_tray(text: str) -> tuple[float, float]:
    """Return width and depth, m, of '200x150mm'; raises InvalidValueError."""
    sides = _sides('--tray', text)
    if len(sides) != 2:
        raise InvalidValueError(
            f'invalid --tray {shown(text)}: expected two sides with a unit, such as 200x150mm'
        )
    return sides[0], sides[1]


def parse_gripper(text: str) -> Footprint:
    """Return the footprint '40x10mm', a rectangle, or '20mm', a disc; raises InvalidValueError."""
    sides = _sides('--gripper', text)
    if len(sides) > 2 or not all(0 <= side <= MAX_SIDE for side in sides):
        raise InvalidValueError(
            f'invalid --gripper {shown(text)}: expected length and width, or a diameter, with a '
            f'unit, such as 40x10mm or 20mm, of at most {MAX_SIDE:g} m'
        )
    return Footprint(sides[0], sides[1]) if len(sides) == 2 else Footprint(0, 0, sides[0] / 2)


def _sides(flag: str, text: str) -> list[float]:
    """Return lengths, m, of '200x150mm'; the last unit is that of sides without one."""
    words = [word.strip() for word in text.split('x')]
    if not all(words):
        raise InvalidValueError(
            f'invalid {flag} {shown(text)}: expected lengths with a unit, such as 200x150mm'
        )
    unit = words[-1].lstrip('0123456789. ')
    return [
        parse_quantity(flag, word if word[-1:].isalpha() else word + unit, 'm') for word in words
    ]
