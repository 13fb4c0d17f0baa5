"""CSV files in UTF-8 with a header, separated by , or ; or tabs."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TextIO

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.input_file import named, read_input


@contextmanager
def open_text(path: Path, what: str, max_bytes: int) -> Iterator[TextIO]:
    """Open a text file; errors of decoding and CSV inside the `with` become InvalidValueError.

    what : str
        Kind of the file, for messages.
    """
    file = io.BytesIO(read_input(path, max_bytes, what))
    try:
        yield io.TextIOWrapper(file, encoding='utf-8-sig', newline='')
    except UnicodeDecodeError:
        raise InvalidValueError(f'{named(what, path)} is not text in UTF-8') from None
    except csv.Error as error:
        raise InvalidValueError(f'{named(what, path)} is not a CSV: {error}') from None


class CsvTable:
    """Header and rows of a CSV.

    header : list of str
        Names of the columns, without space around them.
    where : str
        File and line of the header, for messages.
    """

    def __init__(self, path: Path, lines: Iterable[str]) -> None:
        self._path = path
        lines = iter(lines)
        first = next(lines, '')
        delimiter = next((each for each in ';,\t' if each in first), ',')
        self._reader = csv.reader(chain([first], lines), delimiter=delimiter)
        line, names = next(self._filled(), (1, []))
        self.header = [name.strip() for name in names]
        self.where = f'{str(path)!r} line {line}'

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the rows that are not empty, with line numbers; each is as long as the header."""
        for line, row in self._filled():
            if len(row) != len(self.header):
                raise InvalidValueError(
                    f'invalid number of columns {len(row)} in {str(self._path)!r} line {line}: '
                    f'expected {len(self.header)}, as in the header'
                )
            yield line, row

    def wrong(
        self, line: int, row: Sequence[str], column: int, expected: str
    ) -> InvalidValueError:
        """Return the error for a cell."""
        return InvalidValueError(
            f'invalid {self.header[column]} {shown(row[column])} in {str(self._path)!r} '
            f'line {line}: expected {expected}'
        )

    def _filled(self) -> Iterator[tuple[int, list[str]]]:
        return (
            (self._reader.line_num, row)
            for row in self._reader
            if any(cell.strip() for cell in row)
        )
