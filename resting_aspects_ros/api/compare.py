"""Compare two distributions over the same aspects."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from resting_aspects_ros.api.count_files import counted_drops
from resting_aspects_ros.api.counts import (
    CountedDrops,
    check_same_part,
    common_groups,
    counted_by_class,
)
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.errors import InvalidValueError, warn
from resting_aspects_ros.report.comparison import ComparedResults, comparison_document, verdict
from resting_aspects_ros.statistics import comparison as statistics
from resting_aspects_ros.statistics.intervals import CONFIDENCE, check_confidence

# Seed of the Monte Carlo p values, so that equal inputs give equal results.
SEED = 1
MAX_LISTED = 20


@dataclass(frozen=True, eq=False)
class ComparisonResult(Result):
    """Two distributions side by side.

    Attributes
    ----------
    a, b : CountedDrops
        The drops that are compared, with their ids of aspects, or of symmetry classes.
    comparison : Comparison
        Shares, deviations, bounds and p value; arrays in the order of ``a.ids``.
    """

    a: CountedDrops
    b: CountedDrops
    comparison: statistics.Comparison

    @property
    def sides(self) -> ComparedResults:
        """Return both sides, as reports show them."""
        a, b = self.a, self.b
        down = a.down if a.down is not None else b.down
        what: Literal['aspect', 'class'] = 'class' if a.by_class else 'aspect'
        return ComparedResults(a.ids, down, a.tally, b.tally, what, a.names)

    @property
    def verdict(self) -> str:
        """Return a sentence that states whether chance explains the difference."""
        sides = self.sides
        return verdict(self.comparison, [f'{sides.what} {name}' for name in sides.names])

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects compare --json` prints."""
        said = {'a': _fields(self.a), 'b': _fields(self.b)}
        return comparison_document(self.comparison, self.sides, said)


def compare(
    a: DropResult | CountedDrops | str | Path,
    b: DropResult | CountedDrops | str | Path,
    *,
    confidence: float = CONFIDENCE,
) -> ComparisonResult:
    """Compare two sets of drops, neither of which is the truth.

    If one of them is counted by symmetry class, both are compared by class. Classes that one of
    them counts together are compared together.

    Parameters
    ----------
    a, b : DropResult, CountedDrops, str or Path
        A result, counts, or a file: a log (the folder of a run, or its .mcap file), a JSON
        document of `resting_aspects drop` or `request`, or a CSV with columns aspect (or class)
        and count.
        Reading a log imports ROS.
    confidence : float
        Confidence of the bounds, which hold for all aspects together: more than 0.5 and less
        than 1.

    Returns
    -------
    ComparisonResult

    Raises
    ------
    InvalidValueError
        A file cannot be read, the two are of different parts, or their aspects differ.

    Warns
    -----
    RestingAspectsWarning
        One of them is incomplete, or the two are not independent.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> a = ra.drop('tetrahedron', drops=200, seed=1)
    >>> b = ra.drop('tetrahedron', drops=200, seed=2)
    >>> result = ra.compare(a, b)
    >>> result.comparison.p_value > 0.001
    True
    """
    check_confidence(confidence)
    one, other = counted_drops(a), counted_drops(b)
    if one.by_class or other.by_class:
        one, other = counted_by_class(one), counted_by_class(other)
    _check_same_aspects(one, other)
    if one.by_class:
        into = common_groups(one.groups, other.groups)
        one, other = one.grouped(into), other.grouped(into)
    for given in (one, other):
        _warn_if_incomplete(given)
    _warn_if_dependent(one, other)
    generator = np.random.default_rng(SEED)
    found = statistics.compare(one.tally, other.tally, generator, confidence)
    return ComparisonResult(one, other, found)


def _check_same_aspects(a: CountedDrops, b: CountedDrops) -> None:
    """Raise InvalidValueError if an aspect of one is not an aspect of the other."""
    check_same_part(
        (f'A, {a.source!r},', a.part, a.part_sha256),
        (f'B, {b.source!r},', b.part, b.part_sha256),
    )
    if a.members == b.members:
        return
    # Counts that the suite wrote have all aspects of the part, so they are the reference.
    one, other = (b, a) if a.down is not None or set(a.members) > set(b.members) else (a, b)
    many = 'classes' if a.by_class else 'aspects'
    raise InvalidValueError(
        f'invalid {many} {_listed(one.members)} in {one.source!r}: expected those in '
        f'{other.source!r}, {_listed(other.members)}; {_differences(one, other)}'
    )


def _differences(one: CountedDrops, other: CountedDrops) -> str:
    """Return which ids differ, and how to correct them."""
    parts = []
    if unknown := set(one.members) - set(other.members):
        parts.append(f'not among them: {_listed(sorted(unknown))}')
    if missing := set(other.members) - set(one.members):
        parts.append(
            f'missing: {_listed(sorted(missing))} (an aspect that was never seen has count 0; '
            'aspects that look the same are counted by class, in a column class instead of aspect)'
        )
    return '; '.join(parts)


def _warn_if_incomplete(given: CountedDrops) -> None:
    if not given.complete:
        known = given.run is not None and given.run.precision == 0
        asked = f' of {given.run.drops}' if given.run and known else ''
        warn(f'{given.source!r} is not complete: it has {given.drops}{asked} drops')


def _warn_if_dependent(a: CountedDrops, b: CountedDrops) -> None:
    """Warn if drops of both started from the same orientations."""
    if a.run is None or b.run is None or a.run.seed != b.run.seed:
        return
    end = min(a.run.first_drop + a.drops, b.run.first_drop + b.drops)
    common = end - max(a.run.first_drop, b.run.first_drop)
    if common <= 0:
        return
    if a.run.sequence() == b.run.sequence():
        warn(
            f'{common} drops of A and B are the same (equal part, conditions, engine and seed '
            f'{a.run.seed}): they are not independent, so the bounds and the p value are invalid'
        )
    else:
        warn(
            f'{common} drops of A and B start from the same orientations (seed {a.run.seed}): '
            'they are not independent, so the bounds and the p value are only rough; use another '
            'seed'
        )


def _fields(given: CountedDrops) -> dict[str, object]:
    return {
        'file': given.source,
        'part': given.part or None,
        'part_sha256': given.part_sha256 or None,
        'run_id': given.run.run_id if given.run else None,
        'complete': given.complete,
        'drops': given.drops,
    }


def _listed(ids: Sequence[int]) -> str:
    more = f' and {len(ids) - MAX_LISTED} more' if len(ids) > MAX_LISTED else ''
    return (', '.join(map(str, ids[:MAX_LISTED])) or 'none') + more
