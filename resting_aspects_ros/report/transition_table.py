"""Terminal tables of transition matrices: from each aspect or symmetry class to each other."""

import textwrap
from collections.abc import Callable, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.report.rounding import decimals_of, interval_text, probability_text
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import NOTHING, plain_table
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

WIDTH = 80  # of a table, columns
MIN_LISTED = 0.01  # smaller probabilities of a row of many are listed together
# Headings of the outcomes in no aspect.
OUTCOME_HEADINGS = {
    'unclassified': 'unclas-\nsified',
    'unsettled': 'unset-\ntled',
    'failed': 'failed',
    'lost': 'lost',
}
# Width at which the heading of a class with many aspects is wrapped.
_HEADING_WIDTH = 10
# Keeps a name and its percentage in one line: textwrap does not break here.
_NO_BREAK = '\N{NO-BREAK SPACE}'

Rows = Sequence[tuple[Aspect, ...]]


def table_rows(aspects: AspectSet, *, by_class: bool) -> list[tuple[Aspect, ...]]:
    """Return the aspects of each row of a table: each aspect, or each symmetry class."""
    return aspects.classes() if by_class else [(aspect,) for aspect in aspects.aspects]


def transition_table(matrix: TransitionMatrix, by_class: bool, title: str) -> Table:
    """Return a table with a row from each aspect or class; it fits 80 columns, in ASCII.

    Probabilities are in percent. If there is room, each has its interval below it; otherwise each
    row has the half width of its widest interval; and if there are too many columns, each row is
    a list of the probabilities above 1 %. Outcomes in no aspect have columns if they occurred.

    Parameters
    ----------
    matrix : TransitionMatrix
        By aspect.
    by_class : bool
        Whether the table has a row and a column for each symmetry class instead of each aspect.
    title : str
        Plain text, shown above the table.
    """
    cells = _cells(matrix, by_class)
    layouts: tuple[Callable[[_Cells, str], Table], ...] = (_with_intervals, _with_widest)
    for layout in layouts:
        table = layout(cells, title)
        if _width(table) <= WIDTH:
            return table
    return _listed(cells, title)


def interval_table(matrix: TransitionMatrix, by_class: bool) -> Table:
    """Return the table that has the interval below each probability, however wide; no title."""
    return _with_intervals(_cells(matrix, by_class), '')


def titled_table(title: str, *headings: str, caption: str = '') -> Table:
    """Return a table without rows, as wide as its title and its caption if they fit."""
    table = plain_table(title, *headings)
    if caption:
        caption = textwrap.fill(caption, WIDTH)
        table.caption, table.caption_justify = Text(caption), 'left'
    lines = [*title.splitlines(), *caption.splitlines()]
    table.min_width = min(max(map(len, lines), default=0), WIDTH)
    return table


class _Cells:
    """The numbers of a matrix, as intervals, and the names of its rows and columns."""

    def __init__(self, matrix: TransitionMatrix, rows: Rows) -> None:
        self.rows = [ids_text(row) for row in rows]
        self.actions = [str(n) for n in matrix.actions.tolist()]
        self.confidence = f'{100 * matrix.confidence:g} %'
        self.several = any(len(row) > 1 for row in rows)
        counts = matrix.counts.sum(axis=0)
        occurred = [k for k in range(len(OUTCOMES)) if counts[len(rows) + k]]
        # The columns of a table: the aspects, and the outcomes that occurred.
        self.columns = [*range(len(rows)), *(len(rows) + k for k in occurred)]
        names = [textwrap.fill(f'to {name}', _HEADING_WIDTH) for name in self.rows]
        names += [OUTCOME_HEADINGS[OUTCOMES[k]] for k in occurred]
        self.headings = [f'{name}\n(%)' for name in names]
        lower, upper = matrix.bounds()
        probability = np.where(np.isnan(matrix.probability), 0.0, matrix.probability)
        self._intervals = [
            [Interval(*values) for values in zip(*row, strict=True)]
            for row in zip(probability.tolist(), lower.tolist(), upper.tolist(), strict=True)
        ]

    def of_row(self, row: int) -> list[Interval]:
        """Return the probabilities of a row; empty if it has no actions."""
        return self._intervals[row] if self.actions[row] != '0' else []

    def widest(self, row: int) -> Interval:
        """Return the widest interval of a row."""
        return max(self._intervals[row], key=lambda each: each.upper - each.lower)


def _cells(matrix: TransitionMatrix, by_class: bool) -> _Cells:
    rows = table_rows(matrix.aspects, by_class=by_class)
    return _Cells(matrix.by_class() if by_class else matrix, rows)


def _with_intervals(cells: _Cells, title: str) -> Table:
    """Return the table that has the interval below each probability."""
    table = titled_table(
        title,
        'from',
        *cells.headings,
        'actions',
        caption=f'Below each probability is its {cells.confidence} interval.',
    )
    table.leading = 1
    for k, name in enumerate(cells.rows):
        found = cells.of_row(k)
        texts = [
            f'{_bare(probability_text(found[c]))}\n{_bounds(found[c])}' if found else NOTHING
            for c in cells.columns
        ]
        table.add_row(name, *texts, cells.actions[k])
    return table


def _with_widest(cells: _Cells, title: str) -> Table:
    """Return the table that has the widest interval of each row in a column."""
    headings = ['from', *cells.headings, '+-\n(%)', 'actions']
    table = titled_table(title, *headings, caption=_widest(cells))
    for k, name in enumerate(cells.rows):
        found = cells.of_row(k)
        texts = [_row_text(found[c], cells.widest(k)) if found else NOTHING for c in cells.columns]
        table.add_row(name, *texts, _half_width(cells, k), cells.actions[k])
    return table


def _listed(cells: _Cells, title: str) -> Table:
    """Return the table that lists the aspects that the part goes to from each row."""
    texts = [_list_text(cells, k) for k in range(len(cells.rows))]
    # The lists are as wide as the other columns permit.
    room = WIDTH - _width(_list_table(cells, '', [''] * len(texts), '')) + len('to')
    wrapped = [textwrap.fill(text, room).replace(_NO_BREAK, ' ') for text in texts]
    caption = f'Probabilities of at most {100 * MIN_LISTED:g} % are summed as others. '
    return _list_table(cells, title, wrapped, caption + _widest(cells))


def _list_table(cells: _Cells, title: str, lists: Sequence[str], caption: str) -> Table:
    outcomes = cells.headings[len(cells.rows) :]
    headings = ['from', 'to', *outcomes, '+-\n(%)', 'actions']
    table = titled_table(title, *headings, caption=caption)
    table.columns[1].justify = 'left'
    for k, (name, text) in enumerate(zip(cells.rows, lists, strict=True)):
        found = cells.of_row(k)
        outside = [
            _row_text(found[c], cells.widest(k)) if found else NOTHING
            for c in cells.columns[len(cells.rows) :]
        ]
        table.add_row(name, text, *outside, _half_width(cells, k), cells.actions[k])
    return table


def _list_text(cells: _Cells, row: int) -> str:
    """Return the probabilities of the aspects above MIN_LISTED in descending order, as a list."""
    if not (found := cells.of_row(row)[: len(cells.rows)]):
        return NOTHING
    order = sorted(range(len(found)), key=lambda c: -found[c].probability)
    shown = [c for c in order if found[c].probability > MIN_LISTED]
    entries = [(cells.rows[c], found[c]) for c in shown]
    if rest := sum(found[c].probability for c in order[len(shown) :]):
        entries.append(('others', Interval(rest, 0.0, 1.0)))
    separator = '; ' if cells.several else ', '  # the names of classes contain commas
    return separator.join(
        f'{name}: {_row_text(each, cells.widest(row))} %'.replace(' ', _NO_BREAK)
        for name, each in entries
    )


def _row_text(interval: Interval, widest: Interval) -> str:
    """Return a probability in percent with the decimals of the widest interval of its row."""
    percent = 100 * interval.probability
    return f'{percent:.{decimals_of(widest)}f}' if percent else '0'


def _half_width(cells: _Cells, row: int) -> str:
    """Return half the width of the widest interval of a row, in percent."""
    widest = cells.widest(row)
    half = Interval((widest.upper - widest.lower) / 2, widest.lower, widest.upper)
    return _bare(probability_text(half)) if cells.of_row(row) else NOTHING


def _widest(cells: _Cells) -> str:
    return f'+-: half of the widest {cells.confidence} interval of the row.'


def _bounds(interval: Interval) -> str:
    """Return both bounds in percent, as '25.1-30.7': narrower than interval_text."""
    return _bare(interval_text(interval)).replace(' to ', '-')


def _bare(percentage: str) -> str:
    return percentage.removesuffix(' %')


def _width(table: Table) -> int:
    """Return the width that a table needs, without its title, columns."""
    console = Console(width=1000)
    return console.measure(table).maximum
