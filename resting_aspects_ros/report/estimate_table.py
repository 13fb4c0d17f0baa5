"""What methods predict for a part, side by side, as a table in a terminal."""

from collections.abc import Mapping

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.comparison import Comparison, Tally
from resting_aspects_ros.core.intervals import Array, intervals
from resting_aspects_ros.report.rounding import interval_text, share_text
from resting_aspects_ros.report.table import NOTHING, down_text, plain_table

# In two lines, so that all methods fit 80 columns; of one alone it is the name.
_HEADINGS = {
    'solid_angle': 'solid\nangle',
    'stability': 'stab-\nility',
    'energy_barrier': 'energy\nbarr.',
    'quasi_static': 'quasi\nstatic',
    'rolling': 'roll-\ning',
}


def estimate_table(
    aspects: AspectSet,
    shares: Mapping[str, Array | None],
    title: str,
    against: Tally | None = None,
    deviations: Mapping[str, Comparison] | None = None,
    *,
    by_class: bool = False,
) -> Table:
    """A row for each aspect or class, a column for each method, in percent; cells are ASCII.

    Of most parts it fits 80 columns. With drops to hold them against these come first, as shares
    of the drops that are in an aspect, with their interval, and each method's deviations below.

    Parameters
    ----------
    shares : mapping
        (k,) of the aspects, or of the symmetry classes, by the method's name; None where it is not
        defined.
    title : str
        Plain text, shown above.
    deviations : mapping
        Of the drops from each method that is defined.
    by_class : bool
        What was counted, and is shown, are classes.
    """
    table = plain_table(title)
    # A title is not broken because there is but one method.
    table.min_width = min(80, max(map(len, title.splitlines())))
    table.add_column('class' if by_class else 'aspect', justify='right', no_wrap=True)
    if against is None:
        table.add_column('down in part', no_wrap=True)
        first = [[down_text(aspect)] for aspect in aspects.aspects]
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
        table.add_column(heading, justify='right', no_wrap=True)
    columns = [_texts(each, len(first)) for each in shares.values()]
    for k, cells in enumerate(first):
        table.add_row(str(k + 1), *cells, *(column[k] for column in columns))
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


def _texts(shares: Array | None, count: int) -> list[str]:
    if shares is None:
        return [NOTHING] * count
    return [share_text(float(p)) for p in shares]


def _p_text(found: Comparison) -> str:
    """How often chance alone makes drops deviate so much from a method that is right."""
    return '< 0.001' if found.p_value < 0.001 else f'{found.p_value:.2g}'
