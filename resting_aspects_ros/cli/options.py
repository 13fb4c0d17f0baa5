"""Options that several subcommands share, and numbers with a unit."""

import argparse
import math
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import NUMBER, parse_quantity
from resting_aspects_ros.simulation import conditions

if TYPE_CHECKING:
    from resting_aspects_ros.part.part import Part
    from resting_aspects_ros.simulation.actions import Actions

MAX_INTEGER = 1e20


def add_integer(
    parser: 'argparse._ActionsContainer',
    flag: str,
    text: str,
    *,
    metavar: str = 'N',
    default: int | None = None,
) -> None:
    """Add a flag whose value is an integer, such as 1000 or 1e4."""
    parser.add_argument(flag, metavar=metavar, type=parse_integer, default=default, help=text)


def add_share(
    parser: 'argparse._ActionsContainer',
    flag: str,
    metavar: str,
    text: str,
    *,
    default: str | None = None,
) -> None:
    """Add a flag whose value is a share, such as 0.02 or 2%."""
    share = partial(parse_share, flag)
    parser.add_argument(flag, metavar=metavar, type=share, default=default, help=text)


def add_number(
    parser: 'argparse._ActionsContainer',
    flag: str,
    unit: str,
    text: str,
    *,
    default: str | None = None,
    dest: str | None = None,
) -> None:
    """Add a flag whose value is a number with a unit, such as 60mm; it becomes a float in SI."""
    parser.add_argument(
        flag,
        metavar=unit.upper().replace(' ', '') or 'X',
        type=partial(parse_quantity, flag, unit=unit),
        default=default,
        dest=dest or flag[2:].replace('-', '_'),
        help=text,
    )


def add_numbers(
    parser: 'argparse._ActionsContainer', flag: str, metavar: str, text: str, action: str = 'store'
) -> None:
    """Add a flag whose value is numbers, such as 1,3."""
    numbers = partial(parse_numbers, flag)
    parser.add_argument(flag, metavar=metavar, type=numbers, action=action, help=text)


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the part, a name or a file; see `part.library`."""
    parser.add_argument('part', metavar='PART_OR_MESH', help='name of a part, or a mesh file')
    add_part_place(parser)


def add_part_place(parser: argparse.ArgumentParser) -> None:
    """Add --unit, --body and --parts, which tell how to load a part."""
    parser.add_argument(
        '--unit',
        metavar='UNIT',
        help='unit of the mesh file: um, mm, cm, m, in or ft (that of its YAML, else mm)',
    )
    parser.add_argument(
        '--body',
        metavar='BODY',
        help='body of a mesh file to use, if it has several: its name, or its number; 1 is the '
        'largest',
    )
    parser.add_argument(
        '--parts', metavar='DIR', type=Path, help='folder of named parts (the examples)'
    )


def requested_part(arguments: argparse.Namespace, given: str | None = None) -> 'Part':
    """Return the part that the flags request, or a ``given`` one with their unit and body."""
    from resting_aspects_ros.part.library import load_part

    name = arguments.part if given is None else given
    return load_part(name, arguments.unit, arguments.parts, arguments.body)


def add_confidence(parser: argparse.ArgumentParser) -> None:
    """Add --confidence, a share."""
    text = 'confidence of the intervals: more than 0.5 and less than 1 (0.95)'
    add_share(parser, '--confidence', 'C', text, default='0.95')


def add_output(parser: argparse.ArgumentParser, *, each: bool = True) -> None:
    """Add --json and --table, and --each for a table of aspects."""
    if each:
        parser.add_argument(
            '--each',
            action='store_true',
            help='show a row for each aspect, even for those that a rotation of the part maps '
            'onto each other',
        )
    output = parser.add_mutually_exclusive_group()
    output.add_argument('--json', action='store_true', help='print one JSON document instead')
    output.add_argument(
        '--table',
        metavar='FILE',
        type=Path,
        help='also write the printed tables as .csv or .xlsx, with numbers as numbers',
    )


def add_out(parser: argparse.ArgumentParser, text: str, page: str = '') -> None:
    """Add --out, which writes what ``text`` says, and --report for a ``page``."""
    parser.add_argument('--out', metavar='DIR', type=Path, help=text)
    if page:
        parser.add_argument(
            '--report',
            action='store_true',
            help=f'also write {page}, into the folder of --out (out/ and the part)',
        )


def add_seed(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --seed; ``what`` is the same for the same seed."""
    seed = conditions.DEFAULT_SEED
    text = f'the same seed gives the same {what} ({seed})'
    add_integer(parser, '--seed', text, metavar='S', default=seed)


def add_model_range(parser: argparse.ArgumentParser) -> None:
    """Add --no-model-range."""
    parser.add_argument(
        '--no-model-range',
        action='store_true',
        help='leave out the model range of each probability, and the 8000 drops for it',
    )


def add_actions_file(parser: argparse.ArgumentParser) -> None:
    """Add --actions, a file of named actions."""
    parser.add_argument(
        '--actions', metavar='FILE', type=Path, help='file of named actions (config/actions.yaml)'
    )


def known_actions(arguments: argparse.Namespace) -> 'Actions':
    """Return the actions of the file that --actions names, or those of the suite."""
    from resting_aspects_ros.api.conditions import shipped_actions
    from resting_aspects_ros.simulation.actions import Actions

    return shipped_actions() if arguments.actions is None else Actions(arguments.actions)


def add_conditions(
    parser: argparse.ArgumentParser, default: str = conditions.DEFAULT_SURFACE
) -> None:
    """Add --surface and a flag for each condition, generated from conditions.QUANTITIES."""
    group = _add_surface(parser, 'conditions of the drops', conditions.QUANTITIES, default)
    group.add_argument(
        '--height-of',
        type=str.upper,
        choices=[h.name for h in conditions.HeightOf],
        help='reference point of the height',
    )


def add_surroundings(parser: argparse.ArgumentParser) -> None:
    """Add --surroundings and --set; see requested_conditions."""
    group = parser.add_argument_group('surroundings, instead of a level plane')
    group.add_argument(
        '--surroundings',
        metavar='NAME_OR_FILE',
        nargs='?',
        const='',
        help='a slope, walls, a groove, a chute, a tray or a mesh: the name of one of those in '
        'config/surroundings, a kind, or a YAML file; without a value, the names are listed in '
        'the error',
    )
    group.add_argument(
        '--set',
        metavar='NAME=VALUE',
        action='append',
        default=[],
        help='change a value of the surroundings, such as angle=20deg, belt.friction=0.4, '
        'belt.speed=0.1 or release.y_min=30mm; can be repeated',
    )


def add_contact_conditions(parser: argparse.ArgumentParser) -> None:
    """Add --surface and a flag for each condition that matters for parts at rest, too."""
    contact = {name: each for name, each in conditions.QUANTITIES.items() if not each.at_release}
    _add_surface(parser, 'conditions of the contact', contact, conditions.DEFAULT_SURFACE)


def _add_surface(
    parser: argparse.ArgumentParser,
    title: str,
    quantities: Mapping[str, conditions.Quantity],
    default: str,
) -> 'argparse._ArgumentGroup':
    group = parser.add_argument_group(
        title,
        'The surface defines all of them. Each flag changes one. Lengths, speeds,\n'
        'gravity and spin may have a unit, such as 60mm, 2.4in, 300mm/s or 20rpm.',
    )
    group.add_argument(
        '--surface',
        metavar='NAME',
        default='',
        help=f'named conditions: rubber_mat, steel or thrown ({default})',
    )
    group.add_argument(
        '--surfaces',
        metavar='FILE',
        type=Path,
        help='YAML file of more surfaces for --surface, such as surface.yaml of calibrate',
    )
    add_quantities(group, quantities)
    return group


def add_quantities(
    group: 'argparse._ArgumentGroup',
    quantities: Mapping[str, conditions.Quantity],
    prefix: str = '',
) -> None:
    """Add a flag for each quantity; its attribute has the prefix before the name."""
    for name, quantity in quantities.items():
        text = f'{quantity.text}: {quantity.allowed()}'
        add_number(group, flag_of(name), quantity.unit, text, dest=prefix + name)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add --workers and --scheduler, which tell where to simulate; see start_workers."""
    place = parser.add_mutually_exclusive_group()
    text = 'number of worker threads, or of processes of Bullet (one per core)'
    add_integer(place, '--workers', text, metavar='W')
    place.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help='simulate on the Dask cluster of this scheduler, such as tcp://10.0.0.5:8786. Needs '
        'the package distributed; the poses are the same',
    )


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Add --engine and --device, which both set the engine."""
    engine = parser.add_mutually_exclusive_group()
    engine.add_argument(
        '--engine',
        choices=(conditions.KERNEL, conditions.BULLET),
        default='',
        help='what simulates the drops: kernel, 30 times faster, or bullet, an independent check '
        '(kernel, but bullet where parts fall from an edge or touch blocks or a mesh)',
    )
    engine.add_argument(
        '--device',
        choices=(conditions.CUDA,),
        dest='engine',
        help='run the kernel on an NVIDIA GPU; needs the package numba-cuda',
    )


def requested_conditions(arguments: argparse.Namespace) -> conditions.DropConditions:
    """Return the conditions that the flags request; raises InvalidValueError."""
    from resting_aspects_ros.api.conditions import requested_surroundings, with_surroundings

    name, changes = getattr(arguments, 'surroundings', None), getattr(arguments, 'set', [])
    return with_surroundings(requested_surface(arguments), requested_surroundings(name, changes))


def requested_surface(arguments: argparse.Namespace) -> conditions.DropConditions:
    """Return the requested conditions without surroundings; raises InvalidValueError."""
    surface = conditions.all_surfaces(arguments.surfaces).get(arguments.surface)
    return surface.changed(**changed_conditions(arguments))


def changed_conditions(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the conditions that have a flag of their own among the arguments."""
    given = {name: getattr(arguments, name, None) for name in conditions.QUANTITIES}
    changes: dict[str, object] = {k: value for k, value in given.items() if value is not None}
    if (height_of := getattr(arguments, 'height_of', None)) is not None:
        changes['height_of'] = conditions.HeightOf[height_of]
    return changes


def add_ros_args(parser: argparse.ArgumentParser) -> None:
    """Add --ros-args, which all nodes accept."""
    parser.add_argument(
        '--ros-args',
        nargs=argparse.REMAINDER,
        default=[],
        help='the arguments that follow are for ROS: -r __ns:=/cell_1 sets a namespace, '
        '-p name:=value a parameter of a node',
    )


def add_run(parser: argparse.ArgumentParser, default_seed: str) -> None:
    """Add --drops, --precision and --seed."""
    add_integer(
        parser,
        '--drops',
        f'number of drops ({conditions.DEFAULT_DROPS}); 385 give intervals of about +-0.05, '
        '10000 of +-0.01. With --precision the maximum (as many as needed)',
    )
    add_share(
        parser,
        '--precision',
        'P',
        'stop as soon as every interval is at most +-P wide, such as 0.01 or 1%%, also those '
        'of aspects that were never seen',
    )
    add_integer(
        parser, '--seed', f'the same seed gives the same drops ({default_seed})', metavar='S'
    )


def refuse(
    arguments: argparse.Namespace, names: Iterable[str], expected: str, part: str = '--part'
) -> None:
    """Raise InvalidValueError if a flag is given that is expected only in another case.

    part : how the help names the part
    """
    for name in names:
        given = getattr(arguments, name)
        if given is None or given is False or given in ('', []):
            continue
        flag = part if name == 'part' else flag_of(name)
        given = given[0] if isinstance(given, list) else given
        text = '' if given is True else f' {shown(str(given))}'
        raise InvalidValueError(f'invalid {flag}{text}: expected only {expected}')


def flag_of(name: str) -> str:
    """Return the flag of a quantity."""
    return '--' + name.replace('_', '-')


# -- Numbers in texts -----------------------------------------------------------------------------


def parse_share(name: str, text: str) -> float:
    """Return 0.02 for ``0.02`` or ``2%``; raises InvalidValueError."""
    match = NUMBER.fullmatch(text)
    if match is None or match[2] not in ('', '%'):
        raise InvalidValueError(
            f'invalid {name} {shown(text)}: expected a number, such as 0.02 or 2%'
        )
    number = float(match[1])
    if number > 1 and not match[2]:
        raise InvalidValueError(
            f'invalid {name} {shown(text)}: expected at most 1; {number:g} percent is '
            f'{match[1]}% or {number / 100:g}'
        )
    return number / (100 if match[2] else 1)


def parse_integer(text: str) -> int:
    """Return ``1000``, ``10_000`` or ``1e4`` as an integer; the type of an option."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number.is_integer() or not 0 < abs(number) < MAX_INTEGER:
        raise argparse.ArgumentTypeError(f'{shown(text)} is not an integer, such as 1000 or 1e4')
    return int(number)


def parse_numbers(flag: str, text: str) -> tuple[int, ...]:
    """Return the numbers in '1,3'; raises InvalidValueError."""
    try:
        return tuple(int(each) for each in text.split(','))
    except ValueError:
        raise InvalidValueError(
            f'invalid {flag} {shown(text)}: expected numbers separated by commas, such as 1,3'
        ) from None
