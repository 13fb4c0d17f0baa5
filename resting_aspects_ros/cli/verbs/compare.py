"""`resting_aspects compare`: how far two distributions are apart."""

import argparse
import sys
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.inputs.count_files import read_counts
from resting_aspects_ros.api.inputs.counts import CountsFile, check_same_part, counted_by_class
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.options import add_output, parse_share
from resting_aspects_ros.core.errors import InvalidValueError, warn
from resting_aspects_ros.core.statistics.comparison import compare
from resting_aspects_ros.core.statistics.intervals import check_confidence
from resting_aspects_ros.report.comparison_report import (
    ComparedResults,
    comparison_document,
    comparison_table,
    measures_text,
)
from resting_aspects_ros.report.comparison_text import verdict
from resting_aspects_ros.report.document import to_json

# Of the tables that are drawn: the same question has the same answer.
SEED = 1

DESCRIPTION = """How far two distributions over the same aspects are apart, and whether
chance explains it. Each of A and B is a log (the folder of a run, or its
.mcap file), a JSON document of drop or request, or a CSV of counts: a line
of names with aspect and count among them, then a line for each aspect, also
with count 0, and if there are for unclassified, unsettled and failed drops;
with class instead of aspect, a line for each class of aspects that look alike.
Shares are of the drops that are in an aspect."""
EXAMPLES = """examples:
  resting_aspects compare out/nut/distribution.json manual.csv
  resting_aspects compare out/logs/my_part_20270131T235959Z_4f1c p.json
  resting_aspects compare before.json after.json --confidence 0.99 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('a', metavar='A', type=Path, help='log, JSON document or CSV')
    parser.add_argument('b', metavar='B', type=Path, help='what A is compared with, likewise')
    parser.add_argument(
        '--confidence',
        metavar='C',
        default='0.95',
        help='of the intervals: more than 0.5 and less than 1 (0.95)',
    )
    add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> int:
    """Read, compare and show; returns the exit code. Raises RestingAspectsError."""
    confidence = parse_share('--confidence', arguments.confidence)
    check_confidence(confidence)
    a, b = read_counts(arguments.a), read_counts(arguments.b)
    if a.by_class or b.by_class:
        a, b = counted_by_class(a), counted_by_class(b)
    _check_same_aspects(a, b)
    for given in (a, b):
        _warn_if_incomplete(given)
    _warn_if_dependent(a, b)
    comparison = compare(a.tally, b.tally, np.random.default_rng(SEED), confidence)
    down = a.down if a.down is not None else b.down
    sides = ComparedResults(a.ids, down, a.tally, b.tally, 'class' if a.by_class else 'aspect')
    if arguments.json:
        said = {'a': _fields(a), 'b': _fields(b)}
        sys.stdout.write(to_json(comparison_document(comparison, sides, said)))
        return 0
    console = make_console()
    show_table(console, comparison_table(comparison, sides, f'A: {a.title}\nB: {b.title}'))
    console.print(measures_text(comparison, sides), markup=False, highlight=False)
    names = [f'{sides.what} {number}' for number in sides.ids]
    console.print(verdict(comparison, names), markup=False, highlight=False)
    return 0


def _check_same_aspects(a: CountsFile, b: CountsFile) -> None:
    """Raises InvalidValueError if an aspect of one is not one of the other."""
    check_same_part(
        (f'A, {str(a.path)!r},', a.part, a.part_sha256),
        (f'B, {str(b.path)!r},', b.part, b.part_sha256),
    )
    if a.ids == b.ids:
        return
    # What comes from the suite has all that the part has.
    one, other = (b, a) if a.down is not None or set(a.ids) > set(b.ids) else (a, b)
    many = 'classes' if a.by_class else 'aspects'
    raise InvalidValueError(
        f'{many} in {str(one.path)!r} are {_listed(one.ids)}, allowed are those in '
        f'{str(other.path)!r}: {_listed(other.ids)}; {_differences(one, other)}'
    )


def _differences(one: CountsFile, other: CountsFile) -> str:
    """Which ids make the difference, and what can be done."""
    words = []
    if unknown := set(one.ids) - set(other.ids):
        words.append(f'not among them: {_listed(sorted(unknown))}')
    if missing := set(other.ids) - set(one.ids):
        words.append(
            f'missing: {_listed(sorted(missing))} (what was never seen has count 0; what cannot '
            'be told apart is counted by class, in a column class instead of aspect)'
        )
    return '; '.join(words)


def _warn_if_incomplete(given: CountsFile) -> None:
    if not given.complete:
        known = given.run is not None and given.run.precision == 0
        asked = f' of {given.run.drops}' if given.run and known else ''
        warn(f'{str(given.path)!r} is not complete: it counts {given.drops}{asked} drops')


def _warn_if_dependent(a: CountsFile, b: CountsFile) -> None:
    """Say if the drops of one tell something of those of the other."""
    if a.run is None or b.run is None or a.run.seed != b.run.seed:
        return
    end = min(a.run.first_drop + a.drops, b.run.first_drop + b.drops)
    common = end - max(a.run.first_drop, b.run.first_drop)
    if common <= 0:
        return
    if a.run.sequence() == b.run.sequence():
        warn(
            f'{common} drops of A and B are the same (part, conditions, seed {a.run.seed} and '
            'engine are): they are not independent, so bounds and p value mean nothing'
        )
    else:
        warn(
            f'{common} drops of A and B begin with the same orientations (seed {a.run.seed}): '
            'they are not independent, so bounds and p value are only rough; take another seed'
        )


def _fields(given: CountsFile) -> dict[str, object]:
    return {
        'file': str(given.path),
        'part': given.part or None,
        'part_sha256': given.part_sha256 or None,
        'run_id': given.run.run_id if given.run else None,
        'complete': given.complete,
        'drops': given.drops,
    }


def _listed(ids: tuple[int, ...] | list[int]) -> str:
    most = 20
    more = f' and {len(ids) - most} more' if len(ids) > most else ''
    return (', '.join(map(str, ids[:most])) or 'none') + more
