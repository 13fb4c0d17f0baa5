"""Tables of a page, with the same texts as the tables of a terminal."""

from collections.abc import Sequence
from dataclasses import dataclass

from resting_aspects_ros.report.table import Table


@dataclass(frozen=True)
class PageTable:
    """A table as text; the first cell of each row is its name.

    rows : sequence of sequences of cells
        A cell is a sequence of lines.
    caption : str
        Shown below the table; may be empty.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[Sequence[str]]]
    caption: str = ''


def page_table(table: Table) -> PageTable:
    """Return a terminal table as a table of a page, without its title."""
    rows = [[cell.split('\n') for cell in row] for row in table.rows]
    return PageTable(table.page_headings, rows, table.caption)


def text_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> PageTable:
    """Return a table of texts; line breaks separate the lines of a cell."""
    return PageTable(headings, [[cell.split('\n') for cell in row] for row in rows])
