"""Tables as CSV and XLSX files: numbers as numbers, with their units in the header."""

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.report.table import NOTHING, Number, Table

ENDINGS = ('.csv', '.xlsx')
Value = str | float | None

_NUMBER, _UNIT = r'([+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?)', r'(?: (?P<unit>%|[a-zA-Z][a-zA-Z/0-9]*))?'
# A number, an interval, a number with its interval in parentheses or below it.
_PATTERNS = [
    re.compile(each.replace('N', _NUMBER).replace('U', _UNIT))
    for each in ('NU', 'N to NU', r'N \(N to N\)', 'N\nN(?: to |-)NU', 'N(?: %)\nN to NU')
]
_WITH_UNIT = re.compile(f'.*[0-9)]{_UNIT}', re.DOTALL)
# Ends of the headings of the columns of a cell with two and with three numbers.
_ENDS = {1: ('',), 2: (' lower', ' upper'), 3: ('', ' lower', ' upper')}
# What Excel does not accept in the name of a sheet, and its maximum length.
_NOT_IN_NAMES, _MAX_NAME = re.compile(r'[\[\]:*?/\\]'), 31
_MAX_WIDTH = 40  # of a column of a sheet, characters


def check_ending(flag: str, path: Path) -> None:
    """Raise InvalidValueError unless the name of a file ends with one of ENDINGS."""
    if path.suffix.lower() not in ENDINGS:
        raise InvalidValueError(
            f'invalid {flag} {shown(str(path))}: expected a file with the ending '
            f'{" or ".join(ENDINGS)}'
        )


def table_values(table: Table) -> tuple[list[str], list[list[Value]]]:
    """Return the headings, with units, and the rows of a table as values.

    A number is not rounded where the table has it exactly. A column of numbers with intervals
    becomes three columns, and one of intervals two. Cells without a value are None.
    """
    headings: list[str] = []
    columns: list[list[Value]] = []
    for k, heading, cells in _columns(table):
        if table.headings[k] in table.texts:
            headings.append(heading)
            columns.append([_text(cell) for cell in cells])
            continue
        units, numbers = zip(*map(_parsed, cells), strict=True) if cells else ((), ())
        present = {unit for unit, values in zip(units, numbers, strict=True) if values}
        if len(present) > 1:  # of several units, those with a unit stay texts
            numbers = tuple(() if unit else v for unit, v in zip(units, numbers, strict=True))
        count = max((len(each) for each in numbers), default=0) or 1
        name, unit = _without_unit(heading)
        if not unit and len(present) == 1 and (found := present.pop()):
            unit = f' ({found})'
        for j, end in enumerate(_ENDS[count]):
            headings.append(f'{name}{end}{unit}')
            columns.append(
                [
                    each[j] if len(each) > j else (None if each or j else _text(cell))
                    for each, cell in zip(numbers, cells, strict=True)
                ]
            )
    return headings, [list(row) for row in zip(*columns, strict=True)]


def _columns(table: Table) -> Iterator[tuple[int, str, list[str]]]:
    """Yield index, heading and cells of each column; one of two values per cell becomes two."""
    for k, heading in enumerate(table.page_headings):
        cells = [row[k] for row in table.rows]
        names = table.headings[k].split(',\n')
        if len(names) == 1:
            yield k, heading, cells
            continue
        for j, name in enumerate(names):
            yield k, name, [[*each.split('\n'), ''][j] for each in cells]


def _without_unit(heading: str) -> tuple[str, str]:
    """Return the name and the unit of a heading: 'barrier (mm)' is 'barrier' and ' (mm)'."""
    match = re.fullmatch(r'(.+?)( \([^()]+\))', heading)
    return (match[1], match[2]) if match else (heading, '')


def _parsed(cell: str) -> tuple[str, tuple[float, ...]]:
    """Return unit and numbers of a cell; none if it is a text, such as the ids '1 to 6'."""
    if isinstance(cell, Number):
        match = _WITH_UNIT.fullmatch(cell)
        # Without the last digits of a float, in which 0.702 is 70.19999999999999 %.
        values = (x if isinstance(x, int) else float(f'{x:.15g}') for x in cell.values)
        return (match and match['unit']) or '', tuple(values)
    for pattern in _PATTERNS:
        match = pattern.fullmatch(cell)
        if match is None:
            continue
        unit = match.groupdict().get('unit') or ''
        texts = [x for x in match.groups() if x is not None and x != unit]
        if len(texts) != 2 or unit or '.' in cell:
            return unit, tuple(float(x) if set(x) & set('.e') else int(x) for x in texts)
    return '', ()


def _text(cell: str) -> str | None:
    return None if cell in ('', NOTHING) else ' '.join(cell.split())


def save_csv(table: Table, path: Path) -> None:
    """Write a table as CSV in UTF-8, with the headings in its first line."""
    headings, rows = table_values(table)
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(headings)
        writer.writerows(rows)


def save_xlsx(tables: Sequence[Table], path: Path) -> None:
    """Write a workbook with a sheet for each table, whose headings are in its first row."""
    # This import is slow, and only needed for this format.
    from openpyxl import Workbook
    from openpyxl.styles import Alignment, Font
    from openpyxl.utils import get_column_letter

    book = Workbook()
    book.remove(book.active)
    for number, table in enumerate(tables, start=1):
        headings, rows = table_values(table)
        sheet = book.create_sheet(_sheet_name(table.title, number))
        sheet.append(headings)
        for row in rows:
            sheet.append(row)
        for cell in sheet[1]:
            cell.font, cell.alignment = Font(bold=True), Alignment(wrap_text=True)
        sheet.freeze_panes = 'A2'
        for k, column in enumerate(zip(headings, *rows, strict=True), start=1):
            width = max(len(str(each)) if isinstance(each, str) else 8 for each in column)
            sheet.column_dimensions[get_column_letter(k)].width = min(width + 2, _MAX_WIDTH)
    book.save(path)


def _sheet_name(title: str, number: int) -> str:
    """Return a name that is unique because of its number."""
    name = f'{number} {_NOT_IN_NAMES.sub("", " ".join(title.split()))}'
    return name[:_MAX_NAME].strip()
