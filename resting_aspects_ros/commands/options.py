"""Options that several subcommands share."""

import argparse
from pathlib import Path

from resting_aspects_ros.commands.quantities import parse_integer, parse_quantity, parse_share
from resting_aspects_ros.core.errors import shown
from resting_aspects_ros.drops.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.drops.run import DEFAULT_DROPS, check_drops
from resting_aspects_ros.drops.surfaces import DEFAULT_SURFACE, Surfaces


def add_part(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """The part, by name or as a file; see given_part."""
    parser.add_argument(
        'part',
        metavar='PART_OR_MESH',
        nargs=None if needed else '?',
        help='name of a part, or a mesh file',
    )
    add_part_place(parser)


def add_part_place(parser: argparse.ArgumentParser) -> None:
    """--unit, --body and --parts, which say more of a part."""
    parser.add_argument(
        '--unit',
        metavar='UNIT',
        help='of the mesh file: um, mm, cm, m, in or ft (that of its YAML, else mm)',
    )
    parser.add_argument(
        '--body',
        metavar='N',
        type=whole,
        help='which body of a mesh file, if it has several that do not touch: 1 is the largest',
    )
    parser.add_argument(
        '--parts', metavar='DIR', type=Path, help='folder of named parts (the examples)'
    )


def add_each(parser: argparse.ArgumentParser) -> None:
    """--each, which shows aspects that look alike one by one."""
    parser.add_argument(
        '--each',
        action='store_true',
        help='show a row for each aspect, also for those that a rotation of the part maps onto '
        'each other',
    )


def add_conditions(parser: argparse.ArgumentParser, default: str = DEFAULT_SURFACE) -> None:
    """--surface and one flag for each condition, from the conditions' own declaration."""
    group = parser.add_argument_group(
        'conditions of the drops',
        'Those of the surface, unless changed one by one. Lengths, speeds, gravity and\n'
        'spin may have a unit, such as 60mm, 2.4in, 300mm/s or 20rpm.',
    )
    group.add_argument(
        '--surface',
        metavar='NAME',
        default='',
        help=f'named conditions: rubber_mat, steel or thrown ({default})',
    )
    for name, quantity in QUANTITIES.items():
        group.add_argument(
            _flag(name),
            metavar=quantity.unit.upper() or 'X',
            help=f'{quantity.text}: {quantity.allowed()}',
        )
    group.add_argument(
        '--height-of',
        type=str.upper,
        choices=[h.name for h in HeightOf],
        help='what the height is of, when the part is released',
    )


def conditions_of(arguments: argparse.Namespace, surfaces: Surfaces) -> DropConditions:
    """The conditions that the flags ask for; raises InvalidValueError."""
    return surfaces.get(arguments.surface).changed(**changes_of(arguments))


def changes_of(arguments: argparse.Namespace) -> dict[str, object]:
    """The conditions that are changed one by one."""
    changes: dict[str, object] = {
        name: parse_quantity(_flag(name), text, quantity.unit)
        for name, quantity in QUANTITIES.items()
        if (text := getattr(arguments, name)) is not None
    }
    if arguments.height_of is not None:
        changes['height_of'] = HeightOf[arguments.height_of]
    return changes


def add_ros_args(parser: argparse.ArgumentParser) -> None:
    """--ros-args, as any node has it."""
    parser.add_argument(
        '--ros-args',
        nargs=argparse.REMAINDER,
        default=[],
        help='all that follows is for ROS: -r __ns:=/cell_1 for a namespace, -p name:=value for a '
        'parameter of a node',
    )


def add_run(parser: argparse.ArgumentParser, default_seed: str) -> None:
    """--drops, --precision and --seed, None if it is not given; see drops_of."""
    parser.add_argument(
        '--drops',
        metavar='N',
        type=whole,
        help=f'how many ({DEFAULT_DROPS}); 385 give intervals of about +-0.05, 10000 of +-0.01. '
        'With --precision the most that are made (as many as it takes)',
    )
    parser.add_argument(
        '--precision',
        metavar='P',
        help='stop as soon as every interval is at most +-P wide, such as 0.01 or 1%%: those of '
        'aspects that were never seen, too',
    )
    parser.add_argument(
        '--seed',
        metavar='S',
        type=whole,
        help=f'the same seed gives the same drops ({default_seed})',
    )


def drops_of(arguments: argparse.Namespace) -> tuple[int, float]:
    """How many drops are asked for, and to which precision; 0 is not given."""
    if arguments.precision is None:
        return DEFAULT_DROPS if arguments.drops is None else arguments.drops, 0.0
    # It takes a while to import, which --help does not need.
    from resting_aspects_ros.core.stopping import check_precision

    precision = parse_share('--precision', arguments.precision)
    check_precision(precision)
    if arguments.drops is not None:
        check_drops(arguments.drops)
    return arguments.drops or 0, precision


def _flag(name: str) -> str:
    return '--' + name.replace('_', '-')


def whole(text: str) -> int:
    """A whole number, as the type of an option."""
    try:
        return parse_integer(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{shown(text)} is not an integer, such as 1000 or 1e4'
        ) from None
