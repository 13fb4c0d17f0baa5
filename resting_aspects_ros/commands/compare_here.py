"""What `resting_aspects compare` does: read two files, compare, and show."""

import argparse
import sys

import numpy as np

from resting_aspects_ros.commands.answer import make_console, show_table
from resting_aspects_ros.commands.counts_files import read_counts
from resting_aspects_ros.commands.given_counts import GivenCounts, counted_by_class
from resting_aspects_ros.core.comparison import compare
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.intervals import check_confidence
from resting_aspects_ros.report.comparison_document import comparison_document
from resting_aspects_ros.report.comparison_table import Sides, comparison_table, measures_text
from resting_aspects_ros.report.document import to_json

# Of the tables that are drawn: the same question has the same answer.
SEED = 1


def compare_here(arguments: argparse.Namespace, confidence: float) -> int:
    """Read, compare and show; returns the exit code.

    Raises RestingAspectsError for wrong input.
    """
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
    sides = Sides(a.ids, down, a.tally, b.tally, 'class' if a.by_class else 'aspect')
    if arguments.json:
        said = {'a': _fields(a), 'b': _fields(b)}
        sys.stdout.write(to_json(comparison_document(comparison, sides, said)))
        return 0
    console = make_console()
    show_table(console, comparison_table(comparison, sides, f'A: {a.title}\nB: {b.title}'))
    console.print(measures_text(comparison, sides), markup=False, highlight=False)
    return 0


def _check_same_aspects(a: GivenCounts, b: GivenCounts) -> None:
    """Raises InvalidValueError if an aspect of one is not one of the other."""
    if a.part_sha256 and b.part_sha256 and a.part_sha256 != b.part_sha256:
        raise InvalidValueError(
            f'B is {str(b.path)!r} of {b.part!r} with part_sha256 {b.part_sha256!r}, allowed is '
            f'that of A, {str(a.path)!r} of {a.part!r}: {a.part_sha256!r}. Aspects of different '
            'parts have nothing to do with each other'
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


def _differences(one: GivenCounts, other: GivenCounts) -> str:
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


def _warn_if_incomplete(given: GivenCounts) -> None:
    if not given.complete:
        known = given.run is not None and given.run.precision == 0
        asked = f' of {given.run.drops}' if given.run and known else ''
        _warn(f'{str(given.path)!r} is not complete: it counts {given.drops}{asked} drops')


def _warn_if_dependent(a: GivenCounts, b: GivenCounts) -> None:
    """Say if the drops of one tell something of those of the other."""
    if a.run is None or b.run is None or a.run.seed != b.run.seed:
        return
    end = min(a.run.first_drop + a.drops, b.run.first_drop + b.drops)
    common = end - max(a.run.first_drop, b.run.first_drop)
    if common <= 0:
        return
    if a.run.sequence() == b.run.sequence():
        _warn(
            f'{common} drops of A and B are the same (part, conditions, seed {a.run.seed} and '
            'engine are): they are not independent, so bounds and p value mean nothing'
        )
    else:
        _warn(
            f'{common} drops of A and B begin with the same orientations (seed {a.run.seed}): '
            'they are not independent, so bounds and p value are only rough; take another seed'
        )


def _fields(given: GivenCounts) -> dict[str, object]:
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


def _warn(text: str) -> None:
    print(f'warning: {text}', file=sys.stderr)
