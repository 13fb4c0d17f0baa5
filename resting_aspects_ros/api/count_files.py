"""Read counts of drops, of newly supplied parts or of transitions, from a log, JSON or a CSV.

A CSV of counts has one of two forms:

* Rows of an aspect or class: a column ``aspect`` or ``class``, and a column ``count``. The rows of
  a batch follow each other and have the same text in the column ``batch`` or ``time``; without
  this column, all rows are one batch. Without a column ``count`` each row is one drop or part.
* Columns of classes: a row for each batch, and a column for each class.

Classes that a camera confuses can be counted together, such as '3+4'. What is in no aspect is
counted as 'unclassified', 'unsettled' or 'failed'.
"""

import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.counts import (
    DESIGNS,
    MAX_BYTES,
    CountedDrops,
    check_counts,
    counts_of_run,
    group_name,
    parse_group,
)
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.errors import InvalidValueError, LogError, shown
from resting_aspects_ros.input_files import MAX_COUNTED, CsvTable, open_text
from resting_aspects_ros.logs.bag import is_log
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE
from resting_aspects_ros.part.loading import FILE_FORMATS
from resting_aspects_ros.statistics.comparison import REST, DropCounts
from resting_aspects_ros.statistics.counted_parts import Groups, ObservedCounts

ASPECT, CLASS, COUNT = 'aspect', 'class', 'count'
LABELS = ('batch', 'time')
# Columns of a file of transitions.
TRANSITION_COLUMNS = ('from', 'to', 'count')
COUNTS_FILES = (
    'a log (the folder of a run, or its .mcap file), a JSON document of drop or request, or a CSV '
    'of counts'
)
_EXPECTED = (
    'a column aspect or class and, unless each row is one, a column count; or one column for each '
    'class, named by its number, as class_1, or as 3+4 for classes that are counted together; '
    'and optionally one column batch or time; separated by , or ;'
)
# A group of classes that are counted together, the id of an aspect, or a name in REST.
_Key = tuple[int, ...] | str


def counted_drops(given: DropResult | CountedDrops | str | Path) -> CountedDrops:
    """Return the counts of a result or of a file; raises InvalidValueError."""
    if isinstance(given, CountedDrops):
        return given
    if not isinstance(given, DropResult):
        if not isinstance(given, str | Path):
            raise InvalidValueError(
                f'invalid result {shown(given)}: expected a result of drop, or a file'
            )
        return read_counts(Path(given))
    counted = counts_of_run(
        f'run {given.run.run_id}', given.distribution, given.run, complete=given.complete
    )
    check_counts(counted)
    return counted


def read_counts(path: Path) -> CountedDrops:
    """Read a file of counts of any kind, all batches together; raises InvalidValueError."""
    if path.suffix in ('.yaml', '.yml'):
        raise InvalidValueError(
            f'invalid counts file {shown(str(path))}: expected {COUNTS_FILES}; counts in YAML, on '
            'a surface, are for `calibrate`'
        )
    if path.suffix.lower()[1:] in FILE_FORMATS:
        raise InvalidValueError(
            f'invalid counts file {shown(str(path))}, a mesh: expected {COUNTS_FILES}. {DESIGNS}'
        )
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
                counts = cells.counts()
                tally = DropCounts(counts.totals, *(cells.rest[name] for name in REST))
                given = CountedDrops(str(path), counts.groups, tally, cells.by_class)
    check_counts(given)
    return given


def read_observed(
    path: Path, ids: Sequence[int], *, cumulative: bool = False, part: str = ''
) -> ObservedCounts:
    """Read counts of parts by symmetry class, in batches, from a log of a feeder or a CSV.

    Parameters
    ----------
    path : Path
    ids : sequence of int
        Numbers of all symmetry classes of the part.
    cumulative : bool
        Whether each count is the total since the start. A class without a row in a batch keeps
        its total.
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
        observed = _read_csv(path, file, ids, cumulative=cumulative).counts()
    check_parts(observed)
    return observed


def counts_from_array(counts: npt.ArrayLike, groups: Groups) -> ObservedCounts:
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
            f'invalid counts {shown(counts)}: expected rows of {len(groups)} integers from 0 to '
            f'{MAX_COUNTED}, one for each class'
        )
    observed = ObservedCounts.of_rows(rows, 'counts', groups)
    check_parts(observed)
    return observed


def check_parts(counts: ObservedCounts) -> None:
    """Raise InvalidValueError if no part was counted, or too many."""
    if not 1 <= counts.parts <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of counted parts {counts.parts} in {counts.source!r}: expected 1 to '
            f'{MAX_COUNTED}'
        )


def read_transitions(path: Path) -> list[tuple[int, int, int]]:
    """Read the class before an action, the class after it and the number of parts of each row."""
    with open_text(path, 'file of transitions', MAX_BYTES) as file:
        table = CsvTable(path, file)
        names = [name.lower() for name in table.header]
        if sorted(names) != sorted(TRANSITION_COLUMNS):
            raise InvalidValueError(
                f'invalid column names {shown(", ".join(table.header))} in {table.where}: '
                f'expected {", ".join(TRANSITION_COLUMNS)}'
            )
        places = [names.index(name) for name in TRANSITION_COLUMNS]
        rows = []
        for line, row in table.rows():
            for place in places:
                text = row[place].strip()
                if not (text.isascii() and text.isdecimal() and len(text) <= 9):
                    raise table.wrong(line, row, place, f'an integer from 0 to {MAX_COUNTED}')
            before, after, count = (int(row[place]) for place in places)
            rows.append((before, after, count))
    return rows


def _last_of_log(path: Path) -> CountedDrops:
    """Read the last distribution in a log."""
    # This import takes a second, and other files do not need it.
    from resting_aspects_ros.run_logs.contents import LoggedRun

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
    path: Path, lines: Iterable[str], ids: Sequence[int] | None = None, *, cumulative: bool = False
) -> '_Cells':
    """Read the counts in a CSV; of the classes ``ids`` if they are given."""
    table = CsvTable(path, lines)
    names = [name.lower() for name in table.header]
    labels = [k for k, name in enumerate(names) if name in LABELS]
    label = labels[0] if labels else None
    what = ASPECT if ASPECT in names and ids is None else CLASS
    cells = _Cells(path, table, what, ids, cumulative=cumulative)
    if names.count(what) == 1 and names.count(COUNT) == 1 and len(labels) <= 1:
        _read_rows(cells, names.index(what), names.index(COUNT), label)
    elif sorted(names) == sorted([what, *(names[k] for k in labels[:1])]):
        if cumulative:
            raise _wrong_header(table, 'counts that can be cumulative, but each row is one part')
        for line, row in table.rows():
            cells.begin('' if label is None else row[label])
            cells.add(cells.key(line, row, names.index(what)), 1)
    # Numbers alone can be the counts of a file without a header.
    elif (
        len(labels) <= 1
        and any(map(parse_group, names))
        and (ids is not None or not ''.join(names).isdecimal())
    ):
        _read_columns(cells, label)
    else:
        aspects = ' (this file counts aspects instead of classes)' if ASPECT in names else ''
        other = f' (a counts file can be {COUNTS_FILES})' if ids is None else aspects
        raise _wrong_header(table, _EXPECTED + other)
    return cells


def _read_rows(cells: '_Cells', of_key: int, of_count: int, label: int | None) -> None:
    """Read rows with the count of an aspect or class."""
    seen: dict[str, set[_Key]] = {}
    newest = None
    for line, row in cells.table.rows():
        key = cells.key(line, row, of_key)
        batch = '' if label is None else row[label].strip()
        if batch not in seen:
            seen[batch] = set()
            cells.begin(batch)
        elif batch != newest and label is not None:
            raise cells.table.wrong(line, row, label, 'the rows of a batch together')
        newest = batch
        if key in seen[batch]:
            expected = f'each {cells.what} once in a batch; a column batch or time separates them'
            raise cells.table.wrong(line, row, of_key, expected)
        seen[batch].add(key)
        cells.add(key, cells.number(line, row, of_count, key))


def _read_columns(cells: '_Cells', label: int | None) -> None:
    """Read rows of batches, with a column for each class."""
    header = cells.table.header
    keys = {k: cells.known(name) for k, name in enumerate(header) if k != label}
    if None in keys.values() or len(set(keys.values())) < len(keys) or cells.missing:
        classes = '' if cells.ids is None else f', {", ".join(map(str, cells.ids))}'
        raise _wrong_header(
            cells.table,
            f'one column for each class{classes} (a class that was never seen has count 0; the '
            'column of classes that are counted together is named 3+4)',
        )
    for k, key in keys.items():  # as messages name them
        name = f'{key} parts' if isinstance(key, str) else f'class {group_name(key or ())}'
        header[k] = f'count of {name}'
    for line, row in cells.table.rows():
        cells.begin('' if label is None else row[label].strip())
        for column, key in keys.items():
            assert key is not None
            cells.add(key, cells.number(line, row, column, key))


class _Cells:
    """The counts that were read from the cells of a table, by batch.

    rest : number in each of REST; what : 'aspect' or 'class'; ids : the classes, if they are known
    """

    def __init__(
        self,
        path: Path,
        table: CsvTable,
        what: str,
        ids: Sequence[int] | None,
        *,
        cumulative: bool,
    ) -> None:
        self.table = table
        self.what = what
        self.ids = ids
        self.rest: Counter[str] = Counter()
        self._path = path
        self._labels: list[str] = []
        self._counts: list[tuple[int, int, int]] = []  # batch, index of the group, number
        self._groups: dict[tuple[int, ...], int] = {}
        self._group_of: dict[int, tuple[int, ...]] = {}
        self._keys: dict[str, _Key | None] = {}  # by text
        self._totals: Counter[_Key] | None = Counter() if cumulative else None

    @property
    def by_class(self) -> bool:
        """Whether the counts are by symmetry class."""
        return self.what == CLASS

    @property
    def missing(self) -> list[int]:
        """The classes in ``ids`` of which no group was read."""
        return [number for number in self.ids or () if number not in self._group_of]

    def key(self, line: int, row: list[str], column: int) -> _Key:
        """Return what a cell names; raises InvalidValueError."""
        if (found := self.known(row[column])) is not None:
            return found
        together = [group_name(group) for group in self._groups if len(group) > 1]
        raise self.table.wrong(
            line,
            row,
            column,
            f'the number of {"a class" if self.by_class else "an aspect"}'
            + ('' if self.ids is None else f', one of {", ".join(map(str, self.ids))},')
            + f' or {", ".join(REST)}'
            + (f'; the file counts {", ".join(together)} together' if together else ''),
        )

    def known(self, text: str) -> _Key | None:
        """Return what a text names; None for no class, or a class of another group."""
        if text not in self._keys:
            self._keys[text] = self._parsed(text.strip().lower())
        return self._keys[text]

    def _parsed(self, word: str) -> _Key | None:
        if word in REST:
            return word
        group = parse_group(word)
        if group is None or (self.ids is not None and not set(group) <= set(self.ids)):
            return None
        if not self.by_class and not word.isdecimal():
            return None
        if any(self._group_of.setdefault(number, group) != group for number in group):
            return None
        self._groups.setdefault(group, len(self._groups))
        return group

    def number(self, line: int, row: list[str], column: int, key: _Key) -> int:
        """Return the count in a cell, without those before it if counts are cumulative."""
        text = row[column].strip()
        number = int(text) if re.fullmatch('[0-9]{1,9}', text) else -1
        if not 0 <= number <= MAX_COUNTED:
            raise self.table.wrong(line, row, column, f'an integer from 0 to {MAX_COUNTED}')
        if self._totals is None:
            return number
        before, self._totals[key] = self._totals[key], number
        if number < before:
            expected = f'{before} or more, because cumulative counts cannot go down'
            raise self.table.wrong(line, row, column, expected)
        return number - before

    def begin(self, label: str) -> None:
        """Begin a batch."""
        self._labels.append(label.strip())

    def add(self, key: _Key, number: int) -> None:
        """Add a number to the last batch."""
        if isinstance(key, str):
            self.rest[key] += number
        else:
            self._counts.append((len(self._labels) - 1, self._groups[key], number))

    def counts(self) -> ObservedCounts:
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


def _wrong_header(table: CsvTable, expected: str) -> InvalidValueError:
    names = shown(', '.join(table.header))
    return InvalidValueError(f'invalid column names {names} in {table.where}: expected {expected}')
