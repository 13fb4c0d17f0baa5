"""Terminal tables of what follows from actions: long-run shares, wanted aspects, plans."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from rich.table import Table

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.report.rounding import (
    interval_text,
    number_text,
    probability_text,
    share_text,
)
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import NOTHING
from resting_aspects_ros.report.transition_table import Rows, titled_table
from resting_aspects_ros.statistics.intervals import CONFIDENCE, Interval
from resting_aspects_ros.statistics.markov import LongRun, Plan

NEVER, WANTED = 'never', 'wanted'
# Probabilities closer to 1 differ from it by rounding errors only.
_CERTAIN = 1 - 1e-9


def long_run_table(
    rows: Rows,
    long_run: LongRun,
    lower: Array,
    upper: Array,
    drop: Array,
    title: str,
    confidence: float = CONFIDENCE,
    after: Array | None = None,
) -> Table:
    """Return a table of the shares that repeated actions lead to, beside the shares of a drop.

    Aspects in no closed class, or in one of several, are marked as groups; see long_run_text.

    Parameters
    ----------
    rows : sequence of tuples of Aspect
        The aspects of each row: single aspects or symmetry classes; see table_rows.
    long_run : LongRun
        Its shares and indices refer to the rows.
    lower, upper : (k,) float
        Bounds of its shares.
    drop : (k,) float
        Probabilities of the rows after a drop.
    title : str
        Plain text, shown above the table.
    confidence : float
        Of the bounds.
    after : (k,) float, optional
        Shares after one action on dropped parts.
    """
    marks = _marks(long_run, len(rows))
    table = titled_table(
        title,
        _heading(rows),
        'in the\nlong run',
        f'{100 * confidence:g} % interval',
        *([] if after is None else ['after one\naction']),
        'in a\ndrop',
        *(['group'] if any(marks) else []),
    )
    values = zip(long_run.shares.tolist(), lower.tolist(), upper.tolist(), strict=True)
    once = [[]] * len(rows) if after is None else [[f'{share_text(x)} %'] for x in after.tolist()]
    columns = zip(rows, values, once, drop.tolist(), marks, strict=True)
    for row, value, one, dropped, mark in columns:
        interval = Interval(*value)
        table.add_row(
            ids_text(row),
            probability_text(interval),
            interval_text(interval),
            *one,
            f'{share_text(dropped)} %',
            *([mark] if any(marks) else []),
        )
    return table


def actions_table(
    rows: Rows, drop: Array, shares: Mapping[str, Array], wanted: npt.NDArray[np.bool_], title: str
) -> Table:
    """Return a table that compares the shares in a drop with those of several repeated actions.

    Parameters
    ----------
    rows : sequence of tuples of Aspect
        The aspects of each row: single aspects or symmetry classes; see table_rows.
    drop : (k,) float
        Probabilities of the rows after a drop.
    shares : mapping of str to (k,) float
        Long-run shares of each action by name.
    wanted : (k,) bool
        The wanted rows, whose sum is the last row of the table; none: no such row.
    title : str
        Plain text, shown above the table.
    """
    table = titled_table(title, _heading(rows), 'in a\ndrop', *shares)
    columns = (drop, *shares.values())
    for number, row in enumerate(rows):
        table.add_row(ids_text(row), *(f'{share_text(column[number])} %' for column in columns))
    if wanted.any():
        sums = (f'{share_text(float(column[wanted].sum()))} %' for column in columns)
        table.add_row(WANTED, *sums)
    return table


def long_run_text(rows: Rows, long_run: LongRun) -> str:
    """Return lines that describe several closed classes, and aspects outside of them.

    The text is empty if all aspects are in one closed class.
    """
    lines = []
    if len(long_run.closed) > 1:
        lines.append(
            'No simulated action led out of any of these groups of aspects, so the long run\n'
            'depends on the start. Rare ways out show with more actions:'
        )
        lines += [
            f'  {number}: {_names(rows, members)}, in which {share_text(weight)} % of parts end'
            for number, (members, weight) in enumerate(
                zip(long_run.closed, long_run.weights.tolist(), strict=True), start=1
            )
        ]
    unreachable = set(long_run.unreachable)
    if transient := [k for k in long_run.transient if k not in unreachable]:
        names = _names(rows, transient)
        lines.append(f'Estimated as 0, because no simulated action led back there: {names}.')
    if unreachable:
        lines.append(
            f'No simulated drop and no action led to {_names(rows, sorted(unreachable))}.'
        )
    return '\n'.join(lines)


def wanted_table(
    rows: Rows,
    wanted: npt.NDArray[np.bool_],
    probability: Array,
    actions: Array,
    title: str,
) -> Table:
    """Return a table of the way to the wanted aspects from each row.

    Parameters
    ----------
    rows : sequence of tuples of Aspect
        See long_run_table.
    wanted : (k,) bool
        Whether the row is wanted.
    probability : (k,) float
        Probability to reach a wanted row before the part leaves the aspects.
    actions : (k,) float
        Expected number of actions, given that a wanted row is reached; NaN for never.
    title : str
        Plain text, shown above the table.
    """
    table = titled_table(
        title, 'from', 'reaches a\nwanted\naspect', 'expected\nactions,\nif it does'
    )
    columns = zip(rows, wanted.tolist(), probability.tolist(), actions.tolist(), strict=True)
    for row, is_wanted, reached, number in columns:
        if is_wanted:
            cells = WANTED, '0'
        else:
            cells = _chance_text(reached), NEVER if np.isnan(number) else number_text(number)
        table.add_row(ids_text(row), *cells)
    return table


def plan_table(rows: Rows, plan: Plan, actions: Sequence[str], title: str) -> Table:
    """Return a table of the best action in each row, and the expected time to a wanted row.

    Parameters
    ----------
    rows : sequence of tuples of Aspect
        See long_run_table.
    plan : Plan
    actions : sequence of str
        Names of the actions of the plan.
    title : str
        Plain text, shown above the table.
    """
    table = titled_table(title, _heading(rows), 'best action', 'expected\ntime (s)')
    table.columns[1].justify = 'left'
    for row, action, time in zip(rows, plan.action.tolist(), plan.time.tolist(), strict=True):
        if time == 0:
            cells = WANTED, '0'
        elif np.isinf(time):
            cells = NOTHING, NEVER
        else:
            cells = actions[action], number_text(time)
        table.add_row(ids_text(row), *cells)
    return table


def _marks(long_run: LongRun, count: int) -> list[str]:
    """Return the number of the closed class of each row, if there are several, or why none."""
    marks = [''] * count
    if len(long_run.closed) > 1:
        for number, members in enumerate(long_run.closed, start=1):
            for k in members:
                marks[k] = str(number)
    for k in long_run.transient:
        marks[k] = 'none'
    for k in long_run.unreachable:
        marks[k] = 'not reached'
    return marks


def _names(rows: Rows, indices: Sequence[int]) -> str:
    """Return the ids of all aspects of some rows, as 'aspects 1 and 2'."""
    aspects = sorted((a for k in indices for a in rows[k]), key=lambda aspect: aspect.id)
    return f'aspect{"s" * (len(aspects) > 1)} {ids_text(tuple(aspects))}'


def _heading(rows: Rows) -> str:
    return 'aspects' if any(len(row) > 1 for row in rows) else 'aspect'


def _chance_text(probability: float) -> str:
    """Return a probability in percent; only certainty is 100 %."""
    if not 0 < probability <= _CERTAIN:
        return '100 %' if probability else '0 %'
    text = share_text(probability)
    return '> 99.9 %' if text == '100.0' else f'{text} %'
