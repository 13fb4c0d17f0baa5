"""`resting_aspects track`: what passes the traps of a bowl or linear feeder."""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.cli.life_cycle import (
    exit_code,
    finish,
    partial_result,
    result_folder,
    session,
    text_file,
)
from resting_aspects_ros.cli.options import (
    add_conditions,
    add_output,
    add_part,
    add_workers,
    parse_integer,
    requested_conditions,
)
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.simulation.limits import DEFAULT_SEED

if TYPE_CHECKING:
    from resting_aspects_ros.api.track import TrackResult

DESCRIPTION = """Show how a part lies on the track of a bowl or linear feeder, which
orientations pass the traps, and how many good parts per minute that gives; or
design traps that pass only a wanted orientation. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects track hex_nut
  resting_aspects track hex_nut --on wiper_and_balcony --want 1
  resting_aspects track hex_nut --width 40mm --trap wiper:height=12.7mm --want 1
  resting_aspects track u_bracket --design --want 1 --tolerance 0.1mm --report
  resting_aspects track my_part.stl --on my_track.yaml --json
"""
DOCUMENT, PICTURE = 'track.json', 'orientations.png'
# Flags of the track, the keys of its file, and what they are.
SURFACE = {
    'width': 'width of the track (twice the radius of the part, and 10 mm)',
    'roll': 'inclination towards the wall (5deg)',
    'pitch': 'inclination downhill (0)',
    'speed': 'speed of the parts (50mm/s)',
    'fill': 'share of the track that parts cover before the traps (1)',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--on',
        metavar='TRACK',
        help='YAML file of a track, or the name of one in config/tracks; replaces the flags of '
        'the track',
    )
    for name, text in SURFACE.items():
        parser.add_argument(f'--{name}', metavar='X', help=text)
    parser.add_argument('--wall-height', metavar='X', help='height of the wall (above all parts)')
    parser.add_argument('--wall-friction', metavar='X', help='friction of the wall (0.2)')
    parser.add_argument(
        '--trap',
        action='append',
        metavar='KIND:NAME=X,...',
        default=[],
        help='a trap, such as wiper:height=12.7mm or balcony:width=11mm; can be repeated, in the '
        'order in which parts pass them',
    )
    parser.add_argument(
        '--want',
        metavar='ROW',
        type=parse_integer,
        help='the orientation that the feeder shall deliver (1, the most probable one)',
    )
    parser.add_argument(
        '--design', action='store_true', help='propose traps that pass only the wanted orientation'
    )
    parser.add_argument(
        '--tolerance', metavar='X', default='0', help='of the parts, half width (0)'
    )
    parser.add_argument('--trap-tolerance', metavar='X', default='0', help='of traps (0)')
    parser.add_argument(
        '--drops',
        metavar='N',
        type=parse_integer,
        default=2000,
        help='number of drops for the shares of the aspects (2000)',
    )
    parser.add_argument(
        '--seed',
        metavar='S',
        type=parse_integer,
        default=DEFAULT_SEED,
        help=f'the same seed gives the same result ({DEFAULT_SEED})',
    )
    add_workers(parser)
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        help=f'write {DOCUMENT} and {PICTURE} into this folder',
    )
    parser.add_argument(
        '--report',
        action='store_true',
        help='also write track.html, a page with all orientations and the track to scale, into '
        'the folder of --out (out/ and the part)',
    )
    add_output(parser, each=False)
    add_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        # These imports are slow because of NumPy.
        from resting_aspects_ros.api.load_part import load_part
        from resting_aspects_ros.api.track import default_track, design_track, given_track, track

        part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
        described = _described(arguments)
        if arguments.on is not None:
            on = given_track(arguments.on)
        else:
            on = given_track({**default_track(part).document, **described})
        out = result_folder(arguments, part.name, (DOCUMENT, PICTURE))
        options: dict[str, Any] = {
            'drops': arguments.drops,
            'surface': requested_conditions(arguments),
            'tolerance': parse_quantity('--tolerance', arguments.tolerance, 'm'),
            'trap_tolerance': parse_quantity('--trap-tolerance', arguments.trap_tolerance, 'm'),
            'seed': arguments.seed,
            **started.options,
        }
        want = 1 if arguments.want is None else arguments.want
        if arguments.design:
            designs, failure = partial_result(partial(design_track, part, want, on, **options))
            if not designs:
                plain, _ = partial_result(partial(track, part, on, want, **options))
                _show([plain], as_json=arguments.json)
                print(
                    f'no set of traps passes only row {want}: choose another row, or use an '
                    'asymmetric cut-out or a camera',
                    file=sys.stderr,
                )
                return 1
            results = designs
        else:
            result, failure = partial_result(partial(track, part, on, want, **options))
            results = [result]
        best = results[0]
        finish(
            arguments,
            out,
            {DOCUMENT: text_file(best.to_json), PICTURE: best.save_picture},
            partial(_show, results, as_json=arguments.json),
            best.report if arguments.report else None,
        )
        has = f'{best.drop.distribution.drops} of {arguments.drops} drops'
        return exit_code(has, complete=best.complete, failure=failure)


def _described(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the keys of a track that the flags describe; raises InvalidValueError."""
    given = {name: getattr(arguments, name) for name in SURFACE}
    wall = {'height': arguments.wall_height, 'friction': arguments.wall_friction}
    described: dict[str, Any] = {name: text for name, text in given.items() if text is not None}
    wall = {name: text for name, text in wall.items() if text is not None}
    if wall:
        described['wall'] = wall
    if arguments.trap:
        described['traps'] = [_trap(text) for text in arguments.trap]
    if described and arguments.on is not None:
        name = next(iter(described))
        raise InvalidValueError(
            f'invalid {name} {described[name]!r}: expected only without --on, which describes the '
            'track'
        )
    return described


def _trap(text: str) -> dict[str, str]:
    """Return the mapping of a trap in a text such as ``wiper:height=12mm``."""
    kind, _, values = text.partition(':')
    trap = {'kind': kind.strip()}
    for word in filter(None, values.split(',')):
        name, equals, value = (each.strip() for each in word.partition('='))
        if not equals:
            raise InvalidValueError(
                f'invalid --trap {text!r}: expected KIND:NAME=X,..., such as wiper:height=12mm'
            )
        trap[name.replace('-', '_')] = value
    return trap


def _show(results: 'list[TrackResult]', *, as_json: bool) -> None:
    from resting_aspects_ros.cli.console import make_console, show_table
    from resting_aspects_ros.track.show import margin_text

    if as_json:
        sys.stdout.write(results[0].to_json())
        return
    console = make_console()
    best = results[0]
    for table in best.tables():
        show_table(console, table)
    for k, design in enumerate(results):
        if design.margin is not None:
            which = 'Best design' if k == 0 else 'Alternative'
            print(f'{which}: {"; ".join(design.trap_names)}; margin {margin_text(design.margin)}.')
    for sentence in best.sentences:
        print(sentence)
