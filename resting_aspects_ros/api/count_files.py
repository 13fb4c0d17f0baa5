"""Read counts of drops, or of newly supplied parts, from a log, JSON or a CSV.

A CSV of counts has a column ``aspect`` or ``class``, and a column ``count``. The rows of a batch
follow each other and have the same text in the column ``batch`` or ``time``; without this column,
all rows are one batch. Without a column ``count`` each row is one drop or part. Classes that a
camera confuses can be counted together, such as '3+4'. What is in no aspect is counted as
'unclassified', 'unsettled' or 'failed'.
"""

import io
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.counts import (
    MAX_BYTES,
    CountedDrops,
    check_counts,
    counts_of_run,
    parse_group,
)
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.errors import InvalidValueError, LogError, shown
from resting_aspects_ros.input_files import MAX_COUNTED, CsvTable, open_text
from resting_aspects_ros.logs.bag import is_log
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE
from resting_aspects_ros.statistics.comparison import REST, DropCounts
from resting_aspects_ros.statistics.counted_parts import Groups, ObservedCounts

LABELS = ('batch', 'time')
_EXPECTED = (
    'columns aspect or class and, unless each row is one, count; optionally also batch or time'
)


def counted_drops(given: DropResult | CountedDrops | str | Path) -> CountedDrops:
    """Return the counts of a result or of a file; raises InvalidValueError."""
    if isinstance(given, CountedDrops):
        return given
    if isinstance(given, str | Path):
        return read_counts(Path(given))
    if not isinstance(given, DropResult):
        raise InvalidValueError(
            f'invalid result {shown(given)}: expected a result of drop, or a file'
        )
    counted = counts_of_run(
        f'run {given.run.run_id}', given.distribution, given.run, complete=given.complete
    )
    check_counts(counted)
    return counted


def read_counts(path: Path) -> CountedDrops:
    """Read a file of counts of any kind, all batches together; raises InvalidValueError."""
    if is_log(path):
        given = _last_of_log(path)
    else:
        with open_text(path, 'counts file', MAX_BYTES) as file:
            text = file.read()
            if path.suffix == '.json' or text.lstrip().startswith('{'):
                # This imports pydantic, which other files do not need.
                from resting_aspects_ros.api.result_json import counts_of, read_document

                given = counts_of(path, read_document(path, text))
            else:
                counts, rest, by_class = _read_csv(path, io.StringIO(text, newline=''))
                tally = DropCounts(counts.totals, *(rest[name] for name in REST))
                given = CountedDrops(str(path), counts.groups, tally, by_class)
    check_counts(given)
    return given


def read_observed(path: Path, ids: Sequence[int], part: str = '') -> ObservedCounts:
    """Read counts of parts by symmetry class, in batches, from a log of a feeder or a CSV.

    ``ids`` are the numbers of all symmetry classes of the part. A log states the name of the part
    with the counts; without ``part`` it has those of one part. Raises InvalidValueError.
    """
    if is_log(path):
        # ROS is imported only for a log.
        from resting_aspects_ros.run_logs import observed_in_logs

        return observed_in_logs(path, part, ids)
    with open_text(path, 'counts file', MAX_BYTES) as file:
        observed, _, _ = _read_csv(path, file, ids)
    check_parts(observed)
    return observed


def counts_from_array(
    counts: npt.ArrayLike, groups: Groups, what: str = 'counts'
) -> ObservedCounts:
    """Return the counts of an array (b, c): a row for each batch, a column for each group.

    Raises InvalidValueError unless these are integers from 0 to MAX_COUNTED.
    """
    try:
        rows = np.asarray(counts, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.zeros(0)
    fits = (rows >= 0) & (rows <= MAX_COUNTED) & (rows == np.floor(rows))
    if rows.ndim != 2 or rows.shape[1] != len(groups) or not fits.all():
        raise InvalidValueError(
            f'invalid {what} {shown(counts)}: expected rows of {len(groups)} integers from 0 to '
            f'{MAX_COUNTED}, one for each class'
        )
    observed = ObservedCounts.of_rows(rows.astype(np.int64), what, groups)
    check_parts(observed)
    return observed


def check_parts(counts: ObservedCounts) -> None:
    """Raise InvalidValueError if no part was counted, or too many."""
    if not 1 <= counts.parts <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of counted parts {counts.parts} in {counts.source!r}: expected 1 to '
            f'{MAX_COUNTED}'
        )


def _last_of_log(path: Path) -> CountedDrops:
    """Read the last distribution in a log."""
    # This import takes a second, and other files do not need it.
    from resting_aspects_ros.run_logs import LoggedRun

    try:
        logged = LoggedRun(path)
        counted = logged.last_distribution
    except LogError as error:
        raise InvalidValueError(str(error)) from None
    if counted is None:
        raise InvalidValueError(
            f'invalid log {str(path)!r}: expected a log with a message of type {DISTRIBUTION_TYPE}'
        )
    logged.warn_if_unfinished()
    distribution, run, complete = counted
    return counts_of_run(str(path), distribution, run, complete=complete)


def _read_csv(
    path: Path, lines: Iterable[str], ids: Sequence[int] | None = None
) -> tuple[ObservedCounts, Counter[str], bool]:
    """Read the counts in a CSV; of the classes ``ids`` if they are given.

    Returns the counts, the number in each of REST, and whether they are counts of classes.
    """
    table = CsvTable(path, lines)
    what = 'aspect' if 'aspect' in table.names and ids is None else 'class'
    of_key = table.column(what, _EXPECTED)
    of_count = table.column('count', _EXPECTED) if 'count' in table.names else None
    of_label = next((k for k, name in enumerate(table.names) if name in LABELS), None)
    if of_count is None and not {*table.names} <= {what, *LABELS}:  # a misspelt count
        raise table.wrong_header(_EXPECTED)
    expected = 'the number of an aspect'
    if what == 'class':
        among = '' if ids is None else f', one of {", ".join(map(str, ids))}'
        expected = f'the number of a class{among}, each in one group only (such as 3+4)'
    expected += f', or one of {", ".join(REST)}'
    labels: list[str] = []
    found: list[tuple[int, tuple[int, ...], int]] = []  # batch, group and number
    group_of: dict[int, tuple[int, ...]] = {}
    rest: Counter[str] = Counter()
    seen: set[object] = set()
    started: set[str] = set()
    for line, row in table.rows():
        label = '' if of_label is None else row[of_label].strip()
        if of_count is None or not labels or label != labels[-1]:
            if of_count is not None and of_label is not None and label in started:
                raise table.wrong(line, row, of_label, 'the rows of a batch together')
            started.add(label)
            labels.append(label)
            seen.clear()
        word = row[of_key].strip().lower()
        number = 1 if of_count is None else table.count(line, row, of_count)
        group = parse_group(word) if what == 'class' or word.isdecimal() else None
        if word in REST:
            rest[word] += number
        elif (
            group is None
            or (ids is not None and not set(group) <= set(ids))
            or any(group_of.setdefault(each, group) != group for each in group)
        ):
            raise table.wrong(line, row, of_key, expected)
        else:
            found.append((len(labels) - 1, group, number))
        if (group or word) in seen:
            raise table.wrong(line, row, of_key, f'each {what} once in a batch')
        seen.add(group or word)
    unseen = ((each,) for each in ids or () if each not in group_of)
    groups = tuple(sorted({*group_of.values(), *unseen}))
    cells = [(batch, groups.index(group), number) for batch, group, number in found]
    batch, place, count = np.array(cells, dtype=np.int64).reshape(-1, 3).T
    given = tuple(labels) if any(labels) else ()
    observed = ObservedCounts(str(path), groups, batch, place, count, given, rest.total())
    return observed, rest, what == 'class'
