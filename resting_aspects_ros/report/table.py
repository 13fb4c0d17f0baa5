"""The table of texts that the terminal and the pages show alike, and its CSV and XLSX files."""

import csv
import re
import textwrap
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.errors import InvalidValueError, shown

if TYPE_CHECKING:  # rich is imported when a table is printed
    import rich.table

# Width that a table should fit, and at which its title and its caption are wrapped, columns.
WIDTH = 80
# Space between two columns, and minimum width of a column that is wrapped.
_GAP, MIN_WRAPPED = 2, 12
# The cell of a value that is not known.
NOTHING = '-'
# Headings of columns with text.
RESTS_ON, DOWN = 'rests on', 'down in part'


class Number(str):
    """The text of a number or of an interval, with the exact values for files.

    values : tuple of float
        In the unit of the text, such as percent: a number, or the bounds of an interval, or both.
    """

    __slots__ = ('values',)
    values: tuple[float, ...]

    def __new__(cls, text: str, *values: float) -> 'Number':  # noqa: PYI034 - Self is newer
        """Return the text, which has the values."""
        number = super().__new__(cls, text)
        number.values = values
        return number


@dataclass(eq=False)
class Table:
    """A table of plain texts: numbers are aligned to the right, texts to the left.

    Attributes
    ----------
    title : str
        Shown above the table in a terminal; a page has headings of its own.
    headings : sequence of str
        Line breaks fit them to a terminal, and '-' before a line break is a hyphen. A page shows
        them in one line.
    texts : collection of str
        Headings of the columns with text. All other columns have numbers, except the first, which
        names its row.
    wrapped : str
        Heading of the column of texts that a terminal wraps so that the table fits WIDTH.
    rows : list of lists of str
        A cell can have several lines; those after the first explain it, such as an interval.
    sections : list of int
        Numbers of rows above which there is a line.
    bold : list of int
        Numbers of rows with totals.
    pictures : dict of (int, int) to str
        Pictures as data URIs by row and column, which only a page shows.
    """

    title: str
    headings: Sequence[str]
    texts: Collection[str] = ()
    caption: str = ''
    wrapped: str = ''
    rows: list[list[str]] = field(default_factory=list)
    sections: list[int] = field(default_factory=list)
    bold: list[int] = field(default_factory=list)
    pictures: dict[tuple[int, int], str] = field(default_factory=dict)
    picture_width: int = 64  # pixels

    def add_row(self, *cells: str, bold: bool = False) -> None:
        """Add a row; cells that are missing at its end are empty."""
        if bold:
            self.bold.append(len(self.rows))
        self.rows.append([*cells, *[''] * (len(self.headings) - len(cells))])

    def add_section(self) -> None:
        """Draw a line above the next row."""
        self.sections.append(len(self.rows))

    @property
    def width(self) -> int:
        """Width of the rows and headings in a terminal, columns."""
        return sum(self._widths) + _GAP * (len(self.headings) - 1)

    @property
    def _widths(self) -> list[int]:
        columns = zip(self.headings, *self.rows, strict=True)
        return [max(len(line) for cell in cells for line in cell.split('\n')) for cells in columns]

    def __rich__(self) -> 'rich.table.Table':
        """Return the table for a terminal, without colours."""
        from rich import box
        from rich.table import Table as RichTable
        from rich.text import Text

        def annotation(text: str, style: str) -> Text:
            # Text is not parsed as markup, and it may be wider than the table.
            return Text(_wrapped(text), style=style, no_wrap=True, overflow='ignore')

        table = RichTable(
            title=annotation(self.title, 'bold') if self.title else None,
            title_justify='left',
            caption=annotation(self.caption, 'table.caption') if self.caption else None,
            caption_justify='left',
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            collapse_padding=True,
            # Intervals below the numbers need a line between the rows.
            leading=int(sum(any('\n' in cell for cell in row) for row in self.rows) > 1),
        )
        excess = max(self.width - WIDTH, 0)
        for heading, width in zip(self.headings, self._widths, strict=True):
            wrapped = heading == self.wrapped
            table.add_column(
                Text(heading),
                justify='left' if heading in self.texts else 'right',
                no_wrap=not wrapped,
                max_width=max(width - excess, MIN_WRAPPED) if wrapped else None,
            )
        for k, row in enumerate(self.rows):
            if k in self.sections:
                table.add_section()
            table.add_row(*map(Text, row), style='bold' if k in self.bold else None)
        return table

    @property
    def page_headings(self) -> list[str]:
        """The headings as a page shows them, in one line."""
        return [each.replace('-\n', '').replace('\n', ' ') for each in self.headings]

    @property
    def page_rows(self) -> list[list[tuple[list[str], str, bool]]]:
        """For each row and column: the lines of the cell, its picture, and whether it is text."""
        return [
            [
                (cell.split('\n'), self.pictures.get((i, j), ''), heading in self.texts)
                for j, (cell, heading) in enumerate(zip(row, self.headings, strict=True))
            ]
            for i, row in enumerate(self.rows)
        ]


def _wrapped(text: str) -> str:
    return '\n'.join(
        textwrap.fill(line, WIDTH, break_long_words=False, break_on_hyphens=False)
        for line in text.split('\n')
    )


# -- Files: numbers as numbers, with their units in the headings ----------------------------------

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
