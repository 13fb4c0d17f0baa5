"""What methods predict for a part, side by side, as a table in a terminal."""

from collections.abc import Mapping

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.comparison import Comparison, Tally
from resting_aspects_ros.core.estimators.estimate import Estimate
from resting_aspects_ros.core.intervals import intervals
from resting_aspects_ros.report.rounding import interval_text, share_text
from resting_aspects_ros.report.table import NOTHING, down_text, plain_table

# In two lines, so that all methods fit 80 columns.
_HEADINGS = {
    'solid_angle': 'solid\nangle',
    'stability': 'stab-\nility',
    'energy_barrier': 'energy\nbarr.',
    'quasi_static': 'quasi\nstatic',
    'rolling': 'roll-\ning',
}


def estimate_table(
    aspects: AspectSet,
    estimates: Mapping[str, Estimate | None],
    title: str,
    against: Tally | None = None,
    deviations: Mapping[str, Comparison] | None = None,
) -> Table:
    """A row for each aspect, a column for each method, in percent; cells are ASCII.

    It fits 80 columns. With drops to hold them against these come first, as shares of the drops
    that are in an aspect, with their interval, and each method's deviations below.

    Parameters
    ----------
    estimates : mapping
        By the method's name; None where it is not defined.
    title : str
        Plain text, shown above.
    deviations : mapping
        Of the drops from each method that is defined.
    """
    table = plain_table(title)
    # A title is not broken because there is but one method.
    table.min_width = min(80, max(map(len, title.splitlines())))
    table.add_column('aspect', justify='right', no_wrap=True)
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
    for method in estimates:
        table.add_column(_HEADINGS.get(method, method), justify='right', no_wrap=True)
    columns = [_texts(each, len(aspects)) for each in estimates.values()]
    for k, aspect in enumerate(aspects.aspects):
        table.add_row(str(aspect.id), *first[k], *(column[k] for column in columns))
    if deviations:
        table.add_section()
        for name, of in (
            ('mean deviation', lambda c: c.mean_deviation),
            ('largest', lambda c: float(np.abs(c.deviation).max())),
        ):
            cells = [
                share_text(of(deviations[m])) if m in deviations else NOTHING for m in estimates
            ]
            table.add_row('', '', name, *cells)
    return table


def _texts(estimate: Estimate | None, count: int) -> list[str]:
    if estimate is None:
        return [NOTHING] * count
    return [share_text(float(p)) for p in estimate.probabilities]
