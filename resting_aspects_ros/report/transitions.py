"""Tables and documents of transitions: matrices, long run, plans and retention."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.report.document import numbers, plain
from resting_aspects_ros.report.format import (
    aspects_heading,
    aspects_text,
    ids_text,
    interval_text,
    millimetres_text,
    number_text,
    probability_text,
    share_percent_text,
    share_text,
)
from resting_aspects_ros.report.table import NOTHING, Number, Table
from resting_aspects_ros.statistics.intervals import CONFIDENCE, Interval
from resting_aspects_ros.statistics.markov import LongRun, Plan
from resting_aspects_ros.statistics.transitions import (
    LEVELS,
    OUTCOMES,
    RetentionCurve,
    TransitionMatrix,
)

# Headings of the outcomes in no aspect.
OUTCOME_HEADINGS = {
    'unclassified': 'unclas-\nsified',
    'unsettled': 'unset-\ntled',
    'failed': 'failed',
    'lost': 'lost',
}
# Width at which the heading of a class with many aspects is wrapped.
_HEADING_WIDTH = 10

Rows = Sequence[tuple[Aspect, ...]]


def table_rows(aspects: AspectSet, *, by_class: bool) -> list[tuple[Aspect, ...]]:
    """Return the aspects of each row of a table: each aspect, or each symmetry class."""
    return aspects.classes() if by_class else [(aspect,) for aspect in aspects]


def suffix_of(action: str, actions: Sequence[str]) -> str:
    """Return the end of the names of the files of one of several actions, such as '_tap'."""
    return f'_{action}' if len(actions) > 1 else ''


def transition_table(matrix: TransitionMatrix, by_class: bool, title: str = '') -> Table:
    """Return a matrix by aspect in percent, with the interval below each probability.

    It has a row and a column for each aspect or class, however wide it is. Outcomes in no aspect
    have columns if they occurred.
    """
    rows = table_rows(matrix.aspects, by_class=by_class)
    matrix = matrix.by_class() if by_class else matrix
    columns = shown_columns(matrix)
    names = [textwrap.fill(f'to {ids_text(row)}', _HEADING_WIDTH) for row in rows]
    names += [OUTCOME_HEADINGS[OUTCOMES[c - len(rows)]] for c in columns[len(rows) :]]
    caption = f'Below each probability is its {100 * matrix.confidence:g} % interval.'
    headings = ('from', *(f'{name}\n(%)' for name in names), 'actions')
    table = Table(title, headings, caption=caption)
    found = matrix_intervals(matrix)
    for row, of_row, actions in zip(rows, found, matrix.actions.tolist(), strict=True):
        texts = [_with_bounds(of_row[c]) if of_row else NOTHING for c in columns]
        table.add_row(ids_text(row), *texts, str(actions))
    return table


def shown_columns(matrix: TransitionMatrix) -> list[int]:
    """Return the columns of all aspects, and of the outcomes in no aspect that occurred."""
    occurred = matrix.counts.any(axis=0)
    rows = len(matrix.counts)
    return [c for c in range(len(occurred)) if c < rows or occurred[c]]


def matrix_intervals(matrix: TransitionMatrix) -> list[list[Interval]]:
    """Return the probabilities of each row with their bounds; none in a row without actions."""
    lower, upper = matrix.bounds()
    zipped = zip(matrix.probability, lower, upper, matrix.actions, strict=True)
    return [
        [Interval(*map(float, values)) for values in zip(*row, strict=True)] if actions else []
        for *row, actions in zipped
    ]


def _with_bounds(interval: Interval) -> str:
    """Return the probability in percent, and below it its bounds, as '25.1-30.7'."""
    bounds = _bare(interval_text(interval)).replace(' to ', '-')
    values = (interval.probability, interval.lower, interval.upper)
    text = f'{_bare(probability_text(interval))}\n{bounds}'
    return Number(text, *(100 * value for value in values))


def _bare(percentage: str) -> str:
    return percentage.removesuffix(' %')


NEVER, WANTED = 'never', 'wanted'


def long_run_table(
    rows: Rows,
    long_run: LongRun,
    lower: Array,
    upper: Array,
    drop: Array,
    title: str,
    confidence: float = CONFIDENCE,
) -> Table:
    """Return a table of the shares that repeated actions lead to, beside the shares of a drop.

    The long run, the bounds ``lower`` and ``upper`` of its shares, and ``drop``, the probabilities
    after a drop, refer to the rows, (k,).
    """
    interval = f'{100 * confidence:g} % interval'
    table = Table(title, (aspects_heading(rows), 'in the\nlong run', interval, 'in a\ndrop'))
    values = zip(long_run.shares.tolist(), lower.tolist(), upper.tolist(), strict=True)
    for row, value, dropped in zip(rows, values, drop.tolist(), strict=True):
        share = Interval(*value)
        cells = probability_text(share), interval_text(share), share_percent_text(dropped)
        table.add_row(ids_text(row), *cells)
    return table


def actions_table(
    rows: Rows, drop: Array, shares: Mapping[str, Array], wanted: npt.NDArray[np.bool_], title: str
) -> Table:
    """Return a table that compares the shares in a drop with those of several repeated actions.

    The last row is the sum of the ``wanted`` rows (k,), if there are any. ``shares`` are the
    long-run shares (k,) of each action by name.
    """
    table = Table(title, (aspects_heading(rows), 'in a\ndrop', *shares))
    columns = (drop, *shares.values())
    for number, row in enumerate(rows):
        table.add_row(
            ids_text(row), *(share_percent_text(float(column[number])) for column in columns)
        )
    if wanted.any():
        sums = (share_percent_text(float(column[wanted].sum())) for column in columns)
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
    rows: Rows, wanted: npt.NDArray[np.bool_], probability: Array, actions: Array, title: str
) -> Table:
    """Return a table of the way to the wanted aspects from each row.

    Parameters
    ----------
    wanted : (k,) bool
    probability : (k,) float
        Probability to reach a wanted row before the part leaves the aspects.
    actions : (k,) float
        Expected number of actions, given that a wanted row is reached; NaN for never.
    """
    table = Table(title, ('from', 'reaches a\nwanted\naspect', 'expected\nactions,\nif it does'))
    columns = zip(rows, wanted.tolist(), probability.tolist(), actions.tolist(), strict=True)
    for row, is_wanted, reached, number in columns:
        if is_wanted:
            cells = WANTED, '0'
        else:
            cells = share_percent_text(reached), NEVER if np.isnan(number) else number_text(number)
        table.add_row(ids_text(row), *cells)
    return table


def plan_table(rows: Rows, plan: Plan, actions: Sequence[str], title: str) -> Table:
    """Return a table of the best action in each row, and the expected time to a wanted row.

    ``actions`` are the names of the actions of the plan.
    """
    headings = (aspects_heading(rows), 'best action', 'expected\ntime (s)')
    table = Table(title, headings, texts={'best action'})
    for row, action, time in zip(rows, plan.action.tolist(), plan.time.tolist(), strict=True):
        if time == 0:
            cells = WANTED, '0'
        elif np.isinf(time):
            cells = NOTHING, NEVER
        else:
            cells = actions[action], number_text(time)
        table.add_row(ids_text(row), *cells)
    return table


def _names(rows: Rows, indices: Sequence[int]) -> str:
    """Return the ids of all aspects of some rows, as 'aspects 1 and 2'."""
    aspects = sorted((a for k in indices for a in rows[k]), key=lambda aspect: aspect.id)
    return aspects_text(tuple(aspects))


def retention_table(curves: Sequence[RetentionCurve], title: str, gravity: float) -> Table:
    """Return a table of the lift heights in mm at which 1, 10 and 50 % of parts leave an aspect.

    The interval is below each height. The barrier is also shown as the speed with the same energy,
    sqrt(2 g h), for a gravity in m/s2.
    """
    headings = [f'{100 * level:g} % leave\nat (mm)' for level in LEVELS]
    table = Table(title, ('aspect', 'barrier\n(mm)', 'as speed\n(m/s)', *headings))
    for curve in curves:
        barrier = [NOTHING, NOTHING]
        if np.isfinite(curve.barrier):
            speed = number_text(float(np.sqrt(2 * gravity * curve.barrier)))
            barrier = [millimetres_text(curve.barrier), speed]
        levels = (_level_text(curve, level) for level in LEVELS)
        table.add_row(str(curve.aspect), *barrier, *levels)
    return table


def _level_text(curve: RetentionCurve, level: float) -> str:
    """Return the lift height at which a share of the parts leaves, and below it the interval."""
    lift = curve.lift_at(level)
    lower, upper = curve.lift_interval(level)
    limit = f'{1000 * curve.lift[-1]:.4g} mm'
    value = f'not reached\nup to {limit}' if np.isnan(lift) else millimetres_text(lift)
    if np.isnan(lower):
        return value
    if np.isnan(upper):
        return f'{value}\nat least {millimetres_text(lower)}'
    return f'{value}\n{millimetres_text(lower)} to {millimetres_text(upper)}'


def matrix_fields(matrix: TransitionMatrix) -> dict[str, Any]:
    """Return a matrix by aspect, and in ``classes`` by symmetry class, as plain JSON types.

    The keys are described in docs/reference/files.md. The probability is null in a row without
    actions.
    """
    aspects = matrix.aspects
    members = [[aspect.id for aspect in alike] for alike in aspects.classes()]
    by_class = _fields(matrix.by_class(), [a[0].symmetry_class for a in aspects.classes()])
    by_aspect = _fields(matrix, [aspect.id for aspect in aspects])
    return {**by_aspect, 'classes': {'members': members, **by_class}}


def _fields(matrix: TransitionMatrix, numbers_of_rows: Sequence[int]) -> dict[str, object]:
    lower, upper = matrix.bounds()
    return {
        'columns': [*numbers_of_rows, *OUTCOMES],
        'actions': plain(matrix.actions),
        'counts': plain(matrix.counts),
        'probability': plain(matrix.probability),
        'lower': plain(lower),
        'upper': plain(upper),
    }


def long_run_fields(
    long_run: LongRun, lower: Array, upper: Array, aspects: AspectSet
) -> dict[str, object]:
    """Return the shares (k,) that repeated actions lead to, with their bounds, as JSON types.

    The keys are described in docs/reference/files.md.
    """
    ids = [aspect.id for aspect in aspects]
    closed = zip(long_run.closed, long_run.weights.tolist(), long_run.stationary, strict=True)
    return {
        'long_run': numbers(long_run.shares),
        'long_run_lower': numbers(lower),
        'long_run_upper': numbers(upper),
        'closed_classes': [
            {'aspects': [ids[k] for k in members], 'weight': weight, 'shares': numbers(shares)}
            for members, weight, shares in closed
        ],
        'transient': [ids[k] for k in long_run.transient],
        'unreachable': [ids[k] for k in long_run.unreachable],
    }


def retention_fields(curve: RetentionCurve) -> dict[str, object]:
    """Return a retention curve as plain JSON types; see docs/reference/files.md. Lengths in m."""
    lower, upper = curve.bounds()
    levels = []
    for level in LEVELS:
        low, high = curve.lift_interval(level)
        levels.append({'level': level, 'lift': curve.lift_at(level), 'lower': low, 'upper': high})
    return {
        'aspect': curve.aspect,
        'barrier': plain(float(curve.barrier)),
        'lift': numbers(curve.lift),
        'left': plain(curve.left),
        'parts': plain(curve.parts),
        'probability': plain(curve.probability),
        'lower': plain(lower),
        'upper': plain(upper),
        'levels': plain(levels),
    }
