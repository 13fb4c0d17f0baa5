"""A CSV of counts, as a person keeps it who drops a part by hand.

It has a line for each aspect; or for each symmetry class, as aspects that are alike look the same.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from resting_aspects_ros.commands.csv_file import CsvTable
from resting_aspects_ros.commands.given_counts import MOST_COUNTED, GivenCounts
from resting_aspects_ros.core.comparison import REST, Tally
from resting_aspects_ros.core.errors import InvalidValueError, shown

ASPECT, CLASS, COUNT = 'aspect', 'class', 'count'


def read_csv(path: Path, lines: Iterable[str], otherwise: str) -> GivenCounts:
    """Read the columns ``aspect`` or ``class``, and ``count``, wherever they are.

    Parameters
    ----------
    path : Path
    lines : iterable of str
        Of the file.
    otherwise : str
        What else the file may be, for messages.

    Raises
    ------
    InvalidValueError
        With file, line, column, value and what is allowed.
    """
    table = CsvTable(path, lines)
    names = [name.lower() for name in table.header]
    by_class = CLASS in names and ASPECT not in names
    what = CLASS if by_class else ASPECT
    if [names.count(column) for column in (what, COUNT)] != [1, 1]:
        names_shown = shown(', '.join(table.header))
        raise InvalidValueError(
            f'{table.where} should name the columns and is {names_shown}, allowed are one aspect '
            f'or class and one count, in columns parted by , or ;. A file may be {otherwise}'
        )
    aspect, count = names.index(what), names.index(COUNT)
    found: dict[int | str, int] = {}
    for line, row in table.rows():
        key = _key(row[aspect])
        if key is None:
            allowed = (
                f'the number of {"a class" if by_class else "an aspect"} or {", ".join(REST)}'
            )
            raise table.wrong(line, row, aspect, allowed)
        if key in found:
            raise table.wrong(line, row, aspect, f'each {what} once')
        number = _whole(row[count])
        if number is None:
            allowed = f'a whole number from 0 to {MOST_COUNTED}'
            raise table.wrong(line, row, count, allowed)
        found[key] = number
    rest = [found.pop(name, 0) for name in REST]
    ids = sorted(key for key in found if isinstance(key, int))
    tally = Tally(np.array([found[k] for k in ids], dtype=np.int64), *rest)
    return GivenCounts(path, tuple(ids), tally, by_class=by_class)


def _key(text: str) -> int | str | None:
    word = text.strip().lower()
    return word if word in REST else _whole(word) or None


def _whole(text: str) -> int | None:
    """A whole number that is not too large to be meant."""
    digits = text.strip()
    plain = digits.isascii() and digits.isdecimal() and len(digits) <= len(str(MOST_COUNTED))
    return int(digits) if plain and int(digits) <= MOST_COUNTED else None
