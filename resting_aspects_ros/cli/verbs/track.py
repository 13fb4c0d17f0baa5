"""`resting_aspects track`: what passes the traps of a bowl or linear feeder."""

import argparse
from functools import partial
from typing import Any

from resting_aspects_ros.api.track import default_track, design_track, given_track, track
from resting_aspects_ros.api.track_result import TrackResult
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.errors import InvalidValueError

DESCRIPTION = """Show how a part lies on the track of a bowl or linear feeder, which
orientations pass the traps, and how many good parts per minute that gives; or
design traps that pass only a wanted orientation. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects track hex_nut
  resting_aspects track hex_nut --on wiper_and_balcony --want 1
  resting_aspects track hex_nut --width 40mm --trap wiper:height=12.7mm --want 1
  resting_aspects track u_bracket --design --want 1 --tolerance 0.1mm --report
  resting_aspects track hex_nut --design --simulate 20 --speed 100mm/s
"""
DOCUMENT, ROWS, PICTURE = 'track.json', 'orientations.csv', 'orientations.png'
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
    options.add_part(parser)
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
        action='append',
        metavar='ROW',
        type=options.parse_integer,
        default=[],
        help='row of the table (not an aspect) that the feeder shall deliver (1); can be repeated',
    )
    parser.add_argument(
        '--design',
        action='store_true',
        help='propose traps that pass only the wanted orientation, after those that are given',
    )
    options.add_integer(
        parser,
        '--simulate',
        'let N parts of each row run over the traps at the speed of the track (0); with '
        '--design, margins are those of simulated parts',
        default=0,
    )
    parser.add_argument(
        '--before',
        action='append',
        metavar='ACTION',
        default=[],
        help='an action of config/actions.yaml that parts undergo before the traps, such as '
        'step_down; can be repeated',
    )
    options.add_number(parser, '--tolerance', 'm', 'of the parts, half width (0)', default='0')
    options.add_number(parser, '--trap-tolerance', 'm', 'of traps (0)', default='0')
    options.add_integer(
        parser, '--drops', 'number of drops for the shares of the aspects (2000)', default=2000
    )
    options.add_seed(parser, 'result')
    options.add_model_range(parser)
    options.add_workers(parser)
    options.add_out(
        parser,
        f'write {DOCUMENT}, {ROWS} and {PICTURE} into this folder',
        'track.html, a page with all orientations and the track to scale',
    )
    options.add_output(parser, each=False)
    options.add_conditions(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with life_cycle.session(arguments) as started:
        part = options.requested_part(arguments)
        described = _described(arguments)
        if arguments.on is not None:
            on = given_track(arguments.on)
        else:
            on = given_track({**default_track(part).document, **described})
        out = life_cycle.result_folder(arguments, part.name, (DOCUMENT, ROWS, PICTURE))
        same = ('simulate', 'before', 'drops', 'tolerance', 'trap_tolerance', 'seed')
        requested = {name: getattr(arguments, name) for name in same}
        requested['surface'] = options.requested_conditions(arguments)
        requested['model_range'] = not arguments.no_model_range

        def simulate() -> TrackResult:
            if arguments.design:
                return design_track(part, arguments.want, on, **requested, **started)
            return track(part, on, arguments.want, **requested, **started)

        result, failure = life_cycle.partial_result(simulate)
        life_cycle.finish(
            arguments,
            out,
            (DOCUMENT, result.to_json),
            {ROWS: result.save_csv, PICTURE: result.save_picture},
            partial(_show, result),
            result.report,
        )
        has = f'{result.drop.distribution.drops} of {arguments.drops} drops'
        code = life_cycle.exit_code(has, started, failure)
        if result.design is not None and not result.design.designs:
            return code or life_cycle.FAILED
        return code


def _described(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the keys of a track that the flags describe; raises InvalidValueError."""
    described: dict[str, Any] = {name: getattr(arguments, name) for name in SURFACE}
    wall = {'height': arguments.wall_height, 'friction': arguments.wall_friction}
    described['wall'] = {name: text for name, text in wall.items() if text is not None} or None
    described = {name: text for name, text in described.items() if text is not None}
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


def _show(result: TrackResult) -> None:
    for table in result.tables():
        show_table(table)
    show_texts(*result.sentences)
