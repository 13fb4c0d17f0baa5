"""The options of `resting_aspects forecast` that describe the feeder, the camera and the robot."""

import argparse
import re
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.cli.options import parse_integer
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import parse_quantity

if TYPE_CHECKING:
    from resting_aspects_ros.feeding.footprint import Footprint

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
    group.add_argument(
        '--parts-on-tray',
        metavar='N',
        type=parse_integer,
        help='number of parts on the tray (the one with the highest rate)',
    )
    group.add_argument(
        '--max-picks',
        metavar='N',
        type=parse_integer,
        help='maximum number of picks after one image (all free parts)',
    )
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
