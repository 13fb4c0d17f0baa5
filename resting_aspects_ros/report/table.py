"""The table of texts that the terminal and the pages show alike."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # rich is imported when a table is printed
    import rich.table

# Width that a table should fit, and at which its title and its caption are wrapped, columns.
WIDTH = 80
# Space between two columns.
_GAP = 2
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
    texts : mapping of str to int or None
        Headings of the columns with text, and the width at which a terminal wraps it; None if it
        is not wrapped. All other columns have numbers, except the first, which names its row.
    caption : str
        Shown below the table.
    rows : list of lists of str
        A cell can have several lines; those after the first explain it, such as an interval.
    sections : list of int
        Numbers of rows above which there is a line.
    bold : list of int
        Numbers of rows with totals.
    pictures : dict of (int, int) to str
        Pictures as data URIs by row and column, which only a page shows.
    picture_width : int
        Of the pictures, pixels.
    """

    title: str
    headings: Sequence[str]
    texts: Mapping[str, int | None] = field(default_factory=dict)
    caption: str = ''
    rows: list[list[str]] = field(default_factory=list)
    sections: list[int] = field(default_factory=list)
    bold: list[int] = field(default_factory=list)
    pictures: dict[tuple[int, int], str] = field(default_factory=dict)
    picture_width: int = 64

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
        columns = zip(self.headings, *self.rows, strict=True)
        lines = [[line for cell in column for line in cell.split('\n')] for column in columns]
        return sum(max(map(len, each)) for each in lines) + _GAP * (len(lines) - 1)

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
        for heading in self.headings:
            width = self.texts.get(heading)
            table.add_column(
                Text(heading),
                justify='left' if heading in self.texts else 'right',
                no_wrap=width is None,
                max_width=width,
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
    """Return a text in lines of at most WIDTH characters."""
    return '\n'.join(
        textwrap.fill(line, WIDTH, break_long_words=False, break_on_hyphens=False)
        for line in text.split('\n')
    )
