"""`resting_aspects calibrate`: from counts by hand to a surface."""

import argparse
from pathlib import Path

from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.studies.calibration.calibrate import calibrate

DESCRIPTION = """Find the restitution and the friction of a surface from parts that were
counted on it by hand: the conditions that fit, their uncertainty, and what the
counts do not determine. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects calibrate counts.yaml
  resting_aspects calibrate counts.yaml --out table --drops 1000
"""
DOCUMENT, ENTRY, PICTURE = 'calibration.json', 'surface.yaml', 'calibration.png'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'counts',
        metavar='COUNTS',
        type=Path,
        help='counts file (YAML): parts with their counts on one surface, and what is known of '
        'the release; see docs/reference/files.md',
    )
    options.add_integer(
        parser,
        '--points',
        'number of conditions at which the parts are first dropped in the simulation (32 for '
        'each fitted condition); as many follow where the counts are probable',
    )
    options.add_integer(
        parser,
        '--drops',
        'number of drops of each part at each point (as many as were counted, but 100 to 300)',
    )
    options.add_seed(parser, 'result')
    parser.add_argument(
        '--no-discrepancy',
        action='store_true',
        help='the counts are simulated, so that only sampling makes them deviate',
    )
    options.add_out(
        parser,
        'write calibration.json, surface.yaml (an entry for a surfaces file) and '
        'calibration.png into this folder',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    options.add_workers(parser)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; returns the exit code. Raises RestingAspectsError for wrong input."""
    folder = life_cycle.result_folder(arguments, '', (DOCUMENT, ENTRY, PICTURE))
    with life_cycle.session(arguments) as started:
        result = calibrate(
            arguments.counts,
            points=arguments.points,
            drops=arguments.drops,
            discrepancy=not arguments.no_discrepancy,
            seed=arguments.seed,
            **started,
        )

        def show() -> None:
            print(result)
            print(f'\n{result.surface_entry(uncertainty=False)}', end='')

        def save_entry(path: Path) -> None:
            life_cycle.save_text(path, result.surface_entry())

        files = {ENTRY: save_entry, PICTURE: result.save_picture}
        life_cycle.finish(arguments, folder, (DOCUMENT, result.to_json), files, show)
        if folder is not None:
            use = f'--surfaces {folder / ENTRY} --surface {result.surface}'
            life_cycle.say(arguments, f'To use it: {use}')
        return life_cycle.exit_code('fewer points', started)
