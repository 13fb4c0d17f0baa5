"""`resting_aspects calibrate`: from counts by hand to a surface."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.life_cycle import INTERRUPTED, result_folder, session
from resting_aspects_ros.cli.options import add_out, add_seed, add_workers, parse_integer
from resting_aspects_ros.errors import analysis

if TYPE_CHECKING:
    from resting_aspects_ros.studies.calibration.result import CalibrationResult

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
    parser.add_argument(
        '--points',
        metavar='N',
        type=parse_integer,
        help='number of conditions at which the parts are first dropped in the simulation (32 for '
        'each fitted condition); as many follow where the counts are probable',
    )
    parser.add_argument(
        '--drops',
        metavar='N',
        type=parse_integer,
        help='number of drops of each part at each point (as many as were counted, but 100 to '
        '300)',
    )
    add_seed(parser, 'result')
    parser.add_argument(
        '--no-discrepancy',
        action='store_true',
        help='the counts are simulated, so that only sampling makes them deviate',
    )
    add_out(
        parser,
        'write calibration.json, surface.yaml (an entry for a surfaces file) and '
        'calibration.png into this folder',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    add_workers(parser)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; returns the exit code. Raises RestingAspectsError for wrong input."""
    # These imports are slow because of NumPy.
    from resting_aspects_ros.studies.calibration.calibrate import calibrate

    folder = result_folder(arguments, '', (DOCUMENT, ENTRY, PICTURE))
    with session(arguments) as started:
        result = calibrate(
            arguments.counts,
            points=arguments.points,
            drops=arguments.drops,
            discrepancy=not arguments.no_discrepancy,
            seed=arguments.seed,
            **started.options,
        )
        _write(result, folder, as_json=arguments.json)
        if started.stop.asked:
            print(f'interrupted; {result.surface} has fewer points', file=sys.stderr)
        return INTERRUPTED if started.stop.asked else 0


def _write(result: 'CalibrationResult', folder: Path | None, *, as_json: bool) -> None:
    """Print and save a result."""
    if not as_json:
        with analysis('the tables of the result'):
            print(result)
            print(f'\n{result.surface_entry(uncertainty=False)}', end='')
    if folder is not None:
        _save(result, folder, quiet=as_json)
    if as_json:
        sys.stdout.write(result.to_json())


def _save(result: 'CalibrationResult', folder: Path, *, quiet: bool) -> None:
    from resting_aspects_ros.api.result import whole_file

    written = []
    for name, text in ((DOCUMENT, result.to_json), (ENTRY, result.surface_entry)):
        with analysis(f'the file {name}'), whole_file(folder / name) as file:
            file.write_text(text(), encoding='utf-8')
            written.append(folder / name)
    with analysis('the picture'):
        result.save_picture(folder / PICTURE)
        written.append(folder / PICTURE)
    if not quiet:
        print(f'Written: {", ".join(map(str, written))}')
        print(f'To use it: --surfaces {folder / ENTRY} --surface {result.surface}', flush=True)
