"""Terminal tables of retention curves."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from resting_aspects_ros.report.rounding import interval_text, number_text, probability_text
from resting_aspects_ros.report.table import NOTHING
from resting_aspects_ros.report.transition_table import titled_table
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import LEVELS, RetentionCurve


def retention_table(curves: Sequence[RetentionCurve], title: str, gravity: float) -> Table:
    """Return a table of the lift heights in mm at which 1, 10 and 50 % of parts leave an aspect.

    The interval is below each height. The barrier is also shown as the speed with the same energy,
    sqrt(2 g h), for a gravity in m/s2.
    """
    headings = [f'{100 * level:g} % leave\nat (mm)' for level in LEVELS]
    table = titled_table(title, 'aspect', 'barrier\n(mm)', 'as speed\n(m/s)', *headings)
    for curve in curves:
        barrier = [NOTHING, NOTHING]
        if np.isfinite(curve.barrier):
            speed = number_text(float(np.sqrt(2 * gravity * curve.barrier)))
            barrier = [millimetres_text(curve.barrier), speed]
        levels = (_level_text(curve, level) for level in LEVELS)
        table.add_row(str(curve.aspect), *barrier, *levels)
    return table


def retention_counts_table(curves: Sequence[RetentionCurve], title: str) -> Table:
    """Return a table of how many parts left each aspect at each lift height."""
    headings = ['lift\nheight\n(mm)', 'parts', 'left', 'probability', 'interval']
    table = titled_table(title, 'aspect', *headings)
    for curve in curves:
        columns = (curve.lift, curve.parts, curve.left, curve.probability, *curve.bounds())
        for lift, parts, left, *values in zip(*(each.tolist() for each in columns), strict=True):
            chance = Interval(*values)
            table.add_row(
                str(curve.aspect),
                millimetres_text(lift),
                str(parts),
                str(left),
                probability_text(chance),
                interval_text(chance),
            )
    return table


def millimetres_text(length: float) -> str:
    """Return a length, m, in mm with three significant digits."""
    return number_text(1000 * length) if length else '0'


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
