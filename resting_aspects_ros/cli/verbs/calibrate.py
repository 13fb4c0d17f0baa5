"""`resting_aspects calibrate`: from counts by hand to a surface."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.cli.life_cycle import INTERRUPTED, session
from resting_aspects_ros.cli.options import add_out, add_seed, add_workers, parse_integer
from resting_aspects_ros.errors import InvalidValueError, analysis

if TYPE_CHECKING:
    from resting_aspects_ros.studies.calibration.result import CalibrationResult

DESCRIPTION = """Find the restitution and the friction of a surface from parts that were
counted on it by hand: the conditions that fit, their uncertainty, and what the
counts do not determine. With several files, also whether the surfaces differ.
No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects calibrate counts.yaml
  resting_aspects calibrate counts.yaml --out table --drops 1000
  resting_aspects calibrate thick_glass.yaml thin_glass.yaml
"""
DOCUMENT, ENTRY, PICTURE = 'calibration.json', 'surface.yaml', 'calibration.png'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'counts',
        metavar='COUNTS',
        nargs='+',
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
        'calibration.png; with several files, into a folder for each surface',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    add_workers(parser)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; returns the exit code. Raises RestingAspectsError for wrong input."""
    # These imports are slow because of NumPy.
    from resting_aspects_ros.studies.calibration.calibrate import calibrate, given_counts

    surfaces = [given_counts(path).surface for path in arguments.counts]
    if len(set(surfaces)) < len(surfaces):
        raise InvalidValueError(
            f'invalid surfaces {", ".join(surfaces)}: expected a different name in each file'
        )
    folders = {name: _folder(arguments.out, name, len(surfaces)) for name in surfaces}
    results: list[CalibrationResult] = []
    with session(arguments) as started:
        for name, path in zip(surfaces, arguments.counts, strict=True):
            result = calibrate(
                path,
                points=arguments.points,
                drops=arguments.drops,
                discrepancy=not arguments.no_discrepancy,
                seed=arguments.seed,
                **started.options,
            )
            results.append(result)
            _write(result, folders[name], quiet=arguments.json)
            if started.stop.asked:
                break
        _compare(results, as_json=arguments.json)
        if started.stop.asked:
            print(f'interrupted; {result.surface} has fewer points', file=sys.stderr)
        return INTERRUPTED if started.stop.asked else 0


def _compare(results: list['CalibrationResult'], *, as_json: bool) -> None:
    """Print the comparisons of all pairs of surfaces, or everything as one JSON document."""
    from resting_aspects_ros.studies.calibration.result import comparison_text

    compared = [one.compare(other) for k, one in enumerate(results) for other in results[k + 1 :]]
    if not as_json:
        for each in compared:
            print(f'\n{comparison_text(each)}')
        return
    documents = [result.document() for result in results]
    whole: Any = documents[0]
    if len(results) > 1:
        whole = {'surfaces': documents, 'comparisons': [vars(each) for each in compared]}
    print(json.dumps(whole, indent=2))


def _folder(out: Path | None, surface: str, surfaces: int) -> Path | None:
    """Return the folder of a surface, which can be written; None if nothing is saved."""
    if out is None:
        return None
    from resting_aspects_ros.api.result import check_files

    folder = out if surfaces == 1 else out / surface
    check_files('--out', folder, (DOCUMENT, ENTRY, PICTURE))
    return folder


def _write(result: 'CalibrationResult', folder: Path | None, *, quiet: bool) -> None:
    """Save and print a result."""
    if not quiet:
        with analysis('the tables of the result'):
            print(result)
            print(f'\n{result.surface_entry(uncertainty=False)}', end='')
    if folder is None:
        return
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
        print(f'Written: {", ".join(map(str, written))}', flush=True)
