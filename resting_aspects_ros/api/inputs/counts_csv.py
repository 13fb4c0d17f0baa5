"""Read counts of newly supplied parts, in the order in which they were counted, from a CSV."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.class_groups import group_name, parse_group
from resting_aspects_ros.api.inputs.count_files import ASPECT, CLASS, COUNT
from resting_aspects_ros.api.inputs.csv_table import CsvTable, open_text
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.schema import MAX_COUNTED
from resting_aspects_ros.core.statistics.counted_parts import Groups, ObservedCounts
from resting_aspects_ros.logs.message_reader import is_log

LABELS = ('batch', 'time')
EXPECTED = (
    'a column class and, unless each row is one part, a column count; or one column for each '
    'class, named by its number, as class_1, or as 3+4 for classes that are counted together; '
    'and optionally one column batch or time; separated by , or ;'
)
MAX_BYTES = 1 << 26
# Name of the parts that are in no class, and their group.
UNCLASSIFIED = 'unclassified'
_NO_CLASS: tuple[int, ...] = ()


def read_observed(
    path: Path, ids: Sequence[int], *, cumulative: bool = False, part: str = ''
) -> ObservedCounts:
    """Read counts of parts by symmetry class from a log of a feeder, or from a CSV.

    The CSV has one of two formats:

    * Rows of a class: a column ``class``, and a column ``count``. The rows of a batch follow each
      other and have the same text in the column ``batch`` or ``time``; without this column, all
      rows are one batch. Without a column ``count`` each row is one part.
    * Columns of classes: a row for each batch, and a column for each class.

    Classes that a camera confuses can be counted together, such as '3+4'. Parts in the row or
    column 'unclassified' are in no class.

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
        from resting_aspects_ros.run_logs.feeder_contents import observed_in_logs

        return observed_in_logs(path, part, ids)
    with open_text(path, 'counts file', MAX_BYTES) as file:
        table = CsvTable(path, file)
        columns = _Columns(table)
        if cumulative and columns.each_part:
            raise InvalidValueError(
                f'invalid column names {shown(", ".join(table.header))} in {table.where}: '
                'expected counts that can be cumulative, but each row is one part'
            )
        cells = _Cells(table, ids, cumulative)
        if columns.of_class is None:
            _read_columns(cells, columns.label)
        else:
            _read_rows(cells, columns, columns.of_class)
    observed = cells.counts(str(path), labelled=columns.label is not None)
    check_parts(observed)
    return observed


class _Columns:
    """The indices of the columns of a table; raises InvalidValueError for any other header.

    of_class is None if each class has a column, and each_part is whether each row is one part.
    """

    def __init__(self, table: CsvTable) -> None:
        names = [name.lower() for name in table.header]
        labels = [k for k, name in enumerate(names) if name in LABELS]
        by_row = names.count(CLASS) == 1 and names.count(COUNT) <= 1
        of_classes = {name for name in names if parse_group(name)}
        wanted = {CLASS, COUNT} if by_row else of_classes | {UNCLASSIFIED} if of_classes else set()
        if len(labels) > 1 or not wanted or set(names) - wanted - set(LABELS):
            found = ' (this file counts aspects instead of classes)' if ASPECT in names else ''
            raise InvalidValueError(
                f'invalid column names {shown(", ".join(table.header))} in {table.where}: '
                f'expected {EXPECTED}{found}'
            )
        self.label = labels[0] if labels else None
        self.of_class = names.index(CLASS) if by_row else None
        self.of_count = names.index(COUNT) if COUNT in names else None
        self.each_part = by_row and self.of_count is None


class _Cells:
    """The counts in the cells that were read, by batch, and the groups of classes in them."""

    def __init__(self, table: CsvTable, ids: Sequence[int], cumulative: bool) -> None:
        self.table = table
        self.ids = list(ids)
        self.labels: list[str] = []
        self._rows: list[tuple[int, int, int]] = []
        # Index of each group in the order in which they were read, and the group of each class.
        self._places: dict[tuple[int, ...], int] = {_NO_CLASS: 0}
        self._group_of: dict[int, tuple[int, ...]] = {}
        self._place_of_text: dict[str, int] = {}
        self._totals: dict[int, int] | None = {} if cumulative else None

    def place_of(self, text: str) -> int | None:
        """Return the index of the group that a text names, 0 for no class; None if unknown.

        A class of another group is also unknown.
        """
        if text in self._place_of_text:
            return self._place_of_text[text]
        group = _NO_CLASS if text.strip().lower() == UNCLASSIFIED else parse_group(text)
        if group is None or not set(group) <= set(self.ids):
            return None
        if any(self._group_of.setdefault(number, group) != group for number in group):
            return None
        place = self._places.setdefault(group, len(self._places))
        self._place_of_text[text] = place
        return place

    @property
    def missing(self) -> list[int]:
        """The classes of which no group was read."""
        return [number for number in self.ids if number not in self._group_of]

    def name(self, place: int) -> str:
        """Return the name of a group for messages."""
        group = list(self._places)[place]
        return f'class {group_name(group)}' if group else 'unclassified parts'

    def expected(self) -> str:
        """Return which classes a text may name."""
        together = [group_name(group) for group in self._places if len(group) > 1]
        others = f'; the file counts {", ".join(together)} together' if together else ''
        return f'{", ".join(map(str, self.ids))}, or unclassified{others}'

    def counts(self, source: str, *, labelled: bool) -> ObservedCounts:
        """Return all counts; each class that was never read is a group of its own."""
        groups = sorted([*self._places, *((number,) for number in self.missing)])
        places = [groups.index(group) for group in self._places]
        rows = np.array(self._rows, dtype=np.int64).reshape(-1, 3)
        # The empty group is the first one.
        outside = rows[:, 1] == 0
        batch, place, count = rows[~outside].T
        return ObservedCounts(
            source,
            tuple(groups[1:]),
            batch,
            np.array(places, dtype=np.int64)[place] - 1,
            count,
            tuple(self.labels) if labelled else (),
            int(rows[outside, 2].sum()),
        )

    def read(self, line: int, row: list[str], column: int, place: int) -> None:
        """Add the count in a cell to the last batch."""
        text = row[column].strip()
        number = int(text) if re.fullmatch('[0-9]{1,9}', text) else -1
        if not 0 <= number <= MAX_COUNTED:
            raise self.table.wrong(line, row, column, f'an integer from 0 to {MAX_COUNTED}')
        if self._totals is not None:
            before, self._totals[place] = self._totals.get(place, 0), number
            number -= before
            if number < 0:
                expected = f'{before} or more, because cumulative counts cannot go down'
                raise self.table.wrong(line, row, column, expected)
        self.add(place, number)

    def add(self, place: int, number: int) -> None:
        """Add parts of a group to the last batch."""
        self._rows.append((len(self.labels) - 1, place, number))


def _read_columns(cells: _Cells, label: int | None) -> None:
    """Read rows of batches, with a column for each class."""
    header = cells.table.header
    columns = [k for k in range(len(header)) if k != label]
    places = {k: place for k in columns if (place := cells.place_of(header[k])) is not None}
    distinct = len(set(places.values())) == len(columns)
    if not distinct or cells.missing:
        raise InvalidValueError(
            f'invalid column names {shown(", ".join(header))} in {cells.table.where}: expected '
            f'one column for each class, {", ".join(map(str, cells.ids))} (a class that was never '
            'seen has count 0; the column of classes that are counted together is named 3+4)'
        )
    for k, place in places.items():
        header[k] = f'count of {cells.name(place)}'  # as messages name it
    for line, row in cells.table.rows():
        cells.labels.append('' if label is None else row[label].strip())
        for column, place in places.items():
            cells.read(line, row, column, place)


def _read_rows(cells: _Cells, columns: _Columns, of_class: int) -> None:
    """Read rows of a class with a count, or rows of one part."""
    batches: dict[str, set[int]] = {}
    for line, row in cells.table.rows():
        place = cells.place_of(row[of_class])
        if place is None:
            expected = f'the number of a class, one of {cells.expected()}'
            raise cells.table.wrong(line, row, of_class, expected)
        label = '' if columns.label is None else row[columns.label].strip()
        if columns.of_count is None:
            cells.labels.append(label)
            cells.add(place, 1)
            continue
        if label not in batches:
            batches[label] = set()
            cells.labels.append(label)
        elif label != cells.labels[-1] and columns.label is not None:
            raise cells.table.wrong(line, row, columns.label, 'the rows of a batch together')
        if place in batches[label]:
            expected = 'each class once in a batch; the column batch or time separates batches'
            raise cells.table.wrong(line, row, of_class, expected)
        batches[label].add(place)
        cells.read(line, row, columns.of_count, place)


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
