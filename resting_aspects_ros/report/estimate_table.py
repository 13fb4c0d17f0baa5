"""What methods predict for a part, side by side, as a table in a terminal."""

from collections.abc import Mapping, Sequence

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.aspect_set import Aspect
from resting_aspects_ros.core.comparison import Comparison, Tally
from resting_aspects_ros.core.estimators.estimate import METHODS
from resting_aspects_ros.core.intervals import Array, intervals
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.resting_on import resting_on
from resting_aspects_ros.report.rounding import interval_text, share_text
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import NOTHING, plain_table

# In two lines, so that all methods fit 80 columns; of one alone it is the name.
_HEADINGS = {
    'solid_angle': 'solid\nangle',
    'stability': 'stab-\nility',
    'energy_barrier': 'energy\nbarr.',
    'quasi_static': 'quasi\nstatic',
    'rolling': 'roll-\ning',
}
# Longer words on what a part rests on are continued in another line.
_REST_WIDTH = 20


def estimate_table(
    part: Part,
    rows: Sequence[tuple[Aspect, ...]],
    shares: Mapping[str, Array | None],
    title: str,
    recommended: str = '',
    against: Tally | None = None,
    deviations: Mapping[str, Comparison] | None = None,
) -> Table:
    """A row for each aspect or class, a column for each method, in percent; cells are ASCII.

    Of most parts it fits 80 columns. With drops to hold them against these come first, as shares
    of the drops that are in an aspect, with their interval, and each method's deviations below.

    Parameters
    ----------
    rows : sequence of tuples of Aspect
        Aspects of which the shares are sums.
    shares : mapping
        (k,) of the rows, by the method's name; None where it is not defined.
    title : str
        Plain text, shown above.
    recommended : str
        The method that is marked; empty for none.
    against : Tally, optional
        Counts of the rows.
    deviations : mapping
        Of the drops from each method that is defined.
    """
    table = plain_table(title)
    # A title is not broken because there is but one method.
    table.min_width = min(80, max(map(len, title.splitlines())))
    several = any(len(row) > 1 for row in rows)
    table.add_column('aspects' if several else 'aspect', justify='right', no_wrap=True)
    if against is None:
        table.add_column('rests on', max_width=_REST_WIDTH)
        first = [[resting_on(part, row[0])] for row in rows]
    else:
        table.add_column('drops', justify='right', no_wrap=True)
        table.add_column('95 %\ninterval', justify='right', no_wrap=True)
        found = intervals(against.counts, int(against.counts.sum()))
        first = [
            [share_text(each.probability), interval_text(each).removesuffix(' %')]
            for each in found
        ]
    for method in shares:
        heading = method if len(shares) == 1 else _HEADINGS.get(method, method)
        mark = '*' if method == recommended else ''
        table.add_column(heading + mark, justify='right', no_wrap=True)
    columns = [_texts(each, len(first)) for each in shares.values()]
    for k, cells in enumerate(first):
        table.add_row(ids_text(rows[k]), *cells, *(column[k] for column in columns))
    if deviations:
        table.add_section()
        for name, of in (
            ('mean dev.', lambda c: c.mean_deviation),
            ('largest', lambda c: float(np.abs(c.deviation).max())),
        ):
            cells = [share_text(of(deviations[m])) if m in deviations else NOTHING for m in shares]
            table.add_row('', '', name, *cells)
        p_values = [_p_text(deviations[m]) if m in deviations else NOTHING for m in shares]
        table.add_row('', '', 'p value', *p_values)
    return table


def legend(methods: Sequence[str], recommended: str) -> list[str]:
    """A line for each method: its name as a flag takes it, and what it weighs aspects by."""
    return [
        f'{name + "*" * (name == recommended):<16}{METHODS[name].label}: {METHODS[name].meaning}'
        for name in methods
    ]


def _texts(shares: Array | None, count: int) -> list[str]:
    if shares is None:
        return [NOTHING] * count
    return [share_text(float(p)) for p in shares]


def _p_text(found: Comparison) -> str:
    """How often chance alone makes drops deviate so much from a method that is right."""
    return '< 0.001' if found.p_value < 0.001 else f'{found.p_value:.2g}'
