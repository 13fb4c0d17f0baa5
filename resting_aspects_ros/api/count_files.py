"""Read counts of drops, or of newly supplied parts, from a log, JSON or a CSV.

A CSV of counts has one of two forms:

* Rows of an aspect or class: a column ``aspect`` or ``class``, and a column ``count``. The rows of
  a batch follow each other and have the same text in the column ``batch`` or ``time``; without
  this column, all rows are one batch. Without a column ``count`` each row is one drop or part.
* Columns of classes: a row for each batch, and a column for each class.

Classes that a camera confuses can be counted together, such as '3+4'. What is in no aspect is
counted as 'unclassified', 'unsettled' or 'failed'.
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

ASPECT, CLASS, COUNT = 'aspect', 'class', 'count'
LABELS = ('batch', 'time')
_EXPECTED = (
    'a column aspect or class and, unless each row is one, a column count; or one column for each '
    'class, named by its number, as class_1, or as 3+4 for classes that are counted together (a '
    'class that was never seen has count 0); and optionally one column batch or time'
)
# A group of classes that are counted together, the id of an aspect, or a name in REST.
_Key = tuple[int, ...] | str


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
                cells = _read_csv(path, io.StringIO(text, newline=''))
                counts = cells.observed()
                tally = DropCounts(counts.totals, *(cells.rest[name] for name in REST))
                given = CountedDrops(str(path), counts.groups, tally, cells.what == CLASS)
    check_counts(given)
    return given


def read_observed(path: Path, ids: Sequence[int], part: str = '') -> ObservedCounts:
    """Read counts of parts by symmetry class, in batches, from a log of a feeder or a CSV.

    Parameters
    ----------
    path : Path
    ids : sequence of int
        Numbers of all symmetry classes of the part.
    part : str
        Name of the part, which a log states with the counts; empty: the log has those of one part.

    Raises
    ------
    InvalidValueError
        Names file, line and column, and states what was expected.
    """
    if is_log(path):
        # ROS is imported only for a log.
        from resting_aspects_ros.run_logs.contents import observed_in_logs

        return observed_in_logs(path, part, ids)
    with open_text(path, 'counts file', MAX_BYTES) as file:
        observed = _read_csv(path, file, ids).observed()
    check_parts(observed)
    return observed


def counts_from_array(
    counts: npt.ArrayLike, groups: Groups, what: str = 'counts'
) -> ObservedCounts:
    """Return the counts of an array (b, c): a row for each batch, a column for each group.

    Raises InvalidValueError unless these are integers from 0 to MAX_COUNTED.
    """
    try:
        given = np.asarray(counts)
        with np.errstate(invalid='ignore'):  # the conversion of nan
            rows = given.astype(np.int64)
        fits = bool((rows == given).all() and (rows >= 0).all() and (rows <= MAX_COUNTED).all())
    except (TypeError, ValueError, OverflowError):
        fits, rows = False, np.zeros((0, 0), dtype=np.int64)
    if not fits or rows.ndim != 2 or rows.shape[1] != len(groups):
        raise InvalidValueError(
            f'invalid {what} {shown(counts)}: expected rows of {len(groups)} integers from 0 to '
            f'{MAX_COUNTED}, one for each class'
        )
    observed = ObservedCounts.of_rows(rows, what, groups)
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
    from resting_aspects_ros.run_logs.contents import read_logged_run

    try:
        logged = read_logged_run(path)
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


def _read_csv(path: Path, lines: Iterable[str], ids: Sequence[int] | None = None) -> '_Cells':
    """Read the counts in a CSV; of the classes ``ids`` if they are given."""
    table = CsvTable(path, lines)
    names = table.names
    what = ASPECT if ASPECT in names and ids is None else CLASS
    cells = _Cells(path, what, ids)
    labels = [k for k, name in enumerate(names) if name in LABELS]
    if len(labels) > 1:
        raise table.wrong_header(_EXPECTED)
    label = labels[0] if labels else None
    if what in names:
        _read_rows(cells, table, label)
    # Numbers alone can be the counts of a file without a header.
    elif ids is None and ''.join(names).isdecimal():
        raise table.wrong_header(_EXPECTED)
    else:
        _read_columns(cells, table, label)
    return cells


def _read_rows(cells: '_Cells', table: CsvTable, label: int | None) -> None:
    """Read rows of an aspect or class, with a count or of one part."""
    of_key = table.column(cells.what, _EXPECTED)
    of_count = table.column(COUNT, _EXPECTED) if COUNT in table.names else None
    expected = (
        f'the number of {"a class" if cells.what == CLASS else "an aspect"}'
        + ('' if cells.ids is None else f', one of {", ".join(map(str, cells.ids))}')
        + f', in one group, or {", ".join(REST)}'
    )
    seen: set[_Key] = set()
    for line, row in table.rows():
        if cells.begin('' if label is None else row[label], new=of_count is None):
            seen.clear()
        key = cells.key(row[of_key])
        if key is None:
            raise table.wrong(line, row, of_key, expected)
        if key in seen:
            raise table.wrong(line, row, of_key, f'each {cells.what} once in a batch')
        seen.add(key)
        cells.add(key, 1 if of_count is None else table.count(line, row, of_count))


def _read_columns(cells: '_Cells', table: CsvTable, label: int | None) -> None:
    """Read rows of batches, with a column for each class."""
    named = {k: cells.key(name) for k, name in enumerate(table.names) if k != label}
    keys = {k: key for k, key in named.items() if key is not None}
    if not keys or len(set(keys.values())) < len(named) or cells.missing:
        of_part = '' if cells.ids is None else f'; the classes are {cells.ids}'
        raise table.wrong_header(f'{_EXPECTED}{of_part}')
    for line, row in table.rows():
        cells.begin('' if label is None else row[label], new=True)
        for column, key in keys.items():
            cells.add(key, table.count(line, row, column))


class _Cells:
    """The counts that were read from the cells of a table, by batch.

    rest : number in each of REST; what : 'aspect' or 'class'; ids : the classes, if they are known
    """

    def __init__(self, path: Path, what: str, ids: Sequence[int] | None) -> None:
        self.what, self.ids = what, ids
        self.rest: Counter[str] = Counter()
        self._path = path
        self._labels: list[str] = []
        self._counts: list[tuple[int, int, int]] = []  # batch, index of the group, number
        self._groups: dict[tuple[int, ...], int] = {}
        self._group_of: dict[int, tuple[int, ...]] = {}

    @property
    def missing(self) -> list[int]:
        """The classes in ``ids`` of which no group was read."""
        return [number for number in self.ids or () if number not in self._group_of]

    def key(self, text: str) -> _Key | None:
        """Return what a text names; None for no class, or a class of another group."""
        word = text.strip().lower()
        if word in REST:
            return word
        group = parse_group(word)
        if group is None or (self.ids is not None and not set(group) <= set(self.ids)):
            return None
        if self.what == ASPECT and not word.isdecimal():
            return None
        if any(self._group_of.setdefault(number, group) != group for number in group):
            return None
        self._groups.setdefault(group, len(self._groups))
        return group

    def begin(self, label: str, *, new: bool) -> bool:
        """Begin a batch if it is a new one, or has a new label; returns whether it began."""
        begins = new or not self._labels or label.strip() != self._labels[-1]
        if begins:
            self._labels.append(label.strip())
        return begins

    def add(self, key: _Key, number: int) -> None:
        """Add a number to the last batch."""
        if isinstance(key, str):
            self.rest[key] += number
        else:
            self._counts.append((len(self._labels) - 1, self._groups[key], number))

    def observed(self) -> ObservedCounts:
        """Return all counts; each class in ``ids`` that was never read is a group of its own."""
        groups = sorted([*self._groups, *((number,) for number in self.missing)])
        places = np.array([groups.index(group) for group in self._groups], dtype=np.int64)
        batch, place, count = np.array(self._counts, dtype=np.int64).reshape(-1, 3).T
        return ObservedCounts(
            str(self._path),
            tuple(groups),
            batch,
            places[place],
            count,
            tuple(self._labels) if any(self._labels) else (),
            self.rest.total(),
        )
