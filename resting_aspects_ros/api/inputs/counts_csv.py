"""Read counts of newly supplied parts, in the order in which they were counted, from a CSV."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.inputs.count_files import CLASS, COUNT
from resting_aspects_ros.api.inputs.counts import MAX_COUNTED
from resting_aspects_ros.api.inputs.csv_table import CsvTable, open_text
from resting_aspects_ros.api.inputs.observed_counts import ObservedCounts, check_parts
from resting_aspects_ros.core.errors import InvalidValueError, shown

LABELS = ('batch', 'time')
EXPECTED = (
    'a column class and, unless each row is one part, a column count; or one column for each '
    'class, named by its number or as class_1; and optionally one column batch or time'
)
MAX_BYTES = 1 << 26
_CLASS = re.compile(r'(?:class[_ ]?)?0*([1-9]\d{0,8})', re.IGNORECASE)


def read_observed(path: Path, ids: Sequence[int], *, cumulative: bool = False) -> ObservedCounts:
    """Read counts of parts by symmetry class from a CSV in one of two formats.

    * Rows of a class: a column ``class``, and a column ``count``. The rows of a batch follow each
      other and have the same text in the column ``batch`` or ``time``; without this column, all
      rows are one batch. Without a column ``count`` each row is one part.
    * Columns of classes: a row for each batch, and a column for each class.

    Parameters
    ----------
    path : Path
    ids : sequence of int
        Numbers of all symmetry classes of the part.
    cumulative : bool
        Whether each count is the total since the start. A class without a row in a batch keeps
        its total.

    Raises
    ------
    InvalidValueError
        Names file, line and column, and states what was expected.
    """
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
    observed = ObservedCounts(
        str(path),
        np.array(cells.batch, dtype=np.int64),
        np.array(cells.place, dtype=np.int64),
        np.array(cells.count, dtype=np.int64),
        () if columns.label is None else tuple(cells.labels),
    )
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
        wanted = {CLASS, COUNT} if by_row else {name for name in names if _CLASS.fullmatch(name)}
        if len(labels) > 1 or not wanted or set(names) - wanted - set(LABELS):
            raise InvalidValueError(
                f'invalid column names {shown(", ".join(table.header))} in {table.where}: '
                f'expected {EXPECTED}'
            )
        self.label = labels[0] if labels else None
        self.of_class = names.index(CLASS) if by_row else None
        self.of_count = names.index(COUNT) if COUNT in names else None
        self.each_part = by_row and self.of_count is None


class _Cells:
    """The counts in the cells that were read, by batch."""

    def __init__(self, table: CsvTable, ids: Sequence[int], cumulative: bool) -> None:
        self.table = table
        self.ids = list(ids)
        self.labels: list[str] = []
        self.batch: list[int] = []
        self.place: list[int] = []
        self.count: list[int] = []
        self._totals = [0] * len(ids) if cumulative else None

    def place_of(self, text: str) -> int | None:
        """Return the index of the class that a text names; None if there is no such class."""
        match = _CLASS.fullmatch(text.strip())
        return self.ids.index(int(match[1])) if match and int(match[1]) in self.ids else None

    def read(self, line: int, row: list[str], column: int, place: int) -> None:
        """Add the count in a cell to the last batch."""
        text = row[column].strip()
        number = int(text) if re.fullmatch('[0-9]{1,9}', text) else -1
        if not 0 <= number <= MAX_COUNTED:
            raise self.table.wrong(line, row, column, f'an integer from 0 to {MAX_COUNTED}')
        if self._totals is not None:
            before, self._totals[place] = self._totals[place], number
            number -= before
            if number < 0:
                expected = f'{before} or more, because cumulative counts cannot go down'
                raise self.table.wrong(line, row, column, expected)
        self.add(place, number)

    def add(self, place: int, number: int) -> None:
        """Add parts of a class to the last batch."""
        self.batch.append(len(self.labels) - 1)
        self.place.append(place)
        self.count.append(number)


def _read_columns(cells: _Cells, label: int | None) -> None:
    """Read rows of batches, with a column for each class."""
    header = cells.table.header
    columns = [k for k in range(len(header)) if k != label]
    places = {k: place for k in columns if (place := cells.place_of(header[k])) is not None}
    if len(places) < len(columns) or sorted(places.values()) != list(range(len(cells.ids))):
        raise InvalidValueError(
            f'invalid column names {shown(", ".join(header))} in {cells.table.where}: expected '
            f'one column for each class, {_listed(cells.ids)} (a class that was never seen has '
            'count 0)'
        )
    for k, place in places.items():
        header[k] = f'count of class {cells.ids[place]}'  # as messages name it
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
            expected = f'the number of a class, one of {_listed(cells.ids)}'
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


def _listed(ids: Sequence[int]) -> str:
    return ', '.join(map(str, ids))
