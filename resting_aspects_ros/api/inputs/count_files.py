"""Read counts over aspects from a log, a JSON document or a CSV.

A CSV of manual counts has a line for each aspect, or for each symmetry class, because the aspects
of a class look the same.
"""

import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.inputs.class_groups import parse_group
from resting_aspects_ros.api.inputs.counts import (
    CountedDrops,
    check_counts,
    counts_of_run,
)
from resting_aspects_ros.api.inputs.csv_table import CsvTable, open_text
from resting_aspects_ros.core.errors import InvalidValueError, LogError, shown
from resting_aspects_ros.core.schema import MAX_COUNTED
from resting_aspects_ros.core.statistics.comparison import REST, DropCounts
from resting_aspects_ros.logs.message_reader import is_log
from resting_aspects_ros.logs.topic_metadata import DISTRIBUTION_TYPE

MAX_BYTES = 1 << 26
ASPECT, CLASS, COUNT = 'aspect', 'class', 'count'
COUNTS_FILES = (
    'a log (the folder of a run, or its .mcap file), a JSON document of drop or request, or a CSV '
    'with columns aspect (or class) and count'
)


def read_counts(path: Path) -> CountedDrops:
    """Read a file of counts of any kind; raises InvalidValueError."""
    if is_log(path):
        given = _read_log(path)
    else:
        with open_text(path, 'counts file', MAX_BYTES) as file:
            text = file.read()
            if path.suffix == '.json' or text.lstrip().startswith('{'):
                # This imports pydantic, which other files do not need.
                from resting_aspects_ros.api.inputs.result_json import counts_of, read_document

                given = counts_of(path, read_document(path, text))
            else:
                given = _read_csv(path, io.StringIO(text, newline=''))
    check_counts(given)
    return given


def _read_log(path: Path) -> CountedDrops:
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


def _read_csv(path: Path, lines: Iterable[str]) -> CountedDrops:
    """Read the columns ``aspect`` or ``class``, and ``count``, in any order."""
    table = CsvTable(path, lines)
    names = [name.lower() for name in table.header]
    by_class = CLASS in names and ASPECT not in names
    what = CLASS if by_class else ASPECT
    if [names.count(column) for column in (what, COUNT)] != [1, 1]:
        names_shown = shown(', '.join(table.header))
        raise InvalidValueError(
            f'invalid column names {names_shown} in {table.where}: expected one aspect or class '
            f'and one count, separated by , or ; (a counts file can be {COUNTS_FILES})'
        )
    aspect, count = names.index(what), names.index(COUNT)
    found: dict[tuple[int, ...], int] = {}
    rest: dict[str, int] = {}
    counted: set[int | str] = set()
    for line, row in table.rows():
        key = _key(row[aspect], by_class)
        if key is None:
            one = 'a class, classes that were counted together such as 3+4,'
            expected = f'the number of {one if by_class else "an aspect"} or {", ".join(REST)}'
            raise table.wrong(line, row, aspect, expected)
        members = (key,) if isinstance(key, str) else key
        if not counted.isdisjoint(members):
            raise table.wrong(line, row, aspect, f'each {what} once')
        counted.update(members)
        number = _integer(row[count])
        if number is None:
            expected = f'an integer from 0 to {MAX_COUNTED}'
            raise table.wrong(line, row, count, expected)
        if isinstance(key, str):
            rest[key] = number
        else:
            found[key] = number
    groups = tuple(sorted(found))
    tally = DropCounts(
        np.array([found[k] for k in groups], dtype=np.int64), *(rest.get(k, 0) for k in REST)
    )
    together = groups if any(len(group) > 1 for group in groups) else ()
    ids = tuple(group[0] for group in groups)
    return CountedDrops(str(path), ids, tally, by_class=by_class, groups=together)


def _key(text: str, by_class: bool) -> tuple[int, ...] | str | None:
    word = text.strip().lower()
    if word in REST:
        return word
    if by_class:
        return parse_group(word)
    number = _integer(word)
    return (number,) if number else None


def _integer(text: str) -> int | None:
    """Return the integer, or None if the text is not one or it is above MAX_COUNTED."""
    digits = text.strip()
    plain = digits.isascii() and digits.isdecimal() and len(digits) <= len(str(MAX_COUNTED))
    return int(digits) if plain and int(digits) <= MAX_COUNTED else None
