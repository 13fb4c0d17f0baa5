"""The result of a drift test as sentences, terminal tables and a JSON document."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.statistics.drift import Deviation, DriftTest
from resting_aspects_ros.core.statistics.drift_power import MAX_SHIFT, detectable_shift
from resting_aspects_ros.core.statistics.g_test import EXCEEDANCES
from resting_aspects_ros.core.statistics.intervals import Counts, Interval
from resting_aspects_ros.core.statistics.live_counts import LiveCounts
from resting_aspects_ros.report.document import numbers
from resting_aspects_ros.report.rounding import (
    decimals_of,
    interval_text,
    points,
    points_text,
    probability_text,
)
from resting_aspects_ros.report.transition_table import titled_table

# Windows of a longer table are left out, except the last ones and those with an alarm.
MAX_ROWS = 40


@dataclass(frozen=True, eq=False)
class DriftWindows:
    """The windows of a drift test, as reports show them.

    live : LiveCounts
        All counted parts, with the numbers of the classes.
    ends : (w + 1,) int
        Number of parts before the first window, 0, and up to the end of each window.
    labels : sequence of str
        Batch or time of the begin of each window; empty if not known.
    confidence : float
        Confidence of the intervals of deviations, for all classes together.
    power : float
        Probability with which `detectable` is found.
    """

    test: DriftTest
    live: LiveCounts
    ends: Counts
    labels: Sequence[str]
    confidence: float
    power: float

    @property
    def parts(self) -> int:
        """Mean number of parts in a window, rounded."""
        return round(int(self.ends[-1]) / len(self.test.windows))

    @property
    def detectable(self) -> float:
        """Shift that a window of `parts` finds with `power`; nan if it finds none."""
        return detectable_shift(self.test.simulated, self.parts, self.test.level, self.power)

    @property
    def run_length(self) -> float:
        """Mean number of parts between false alarms."""
        return self.parts / self.test.level

    @property
    def deviation(self) -> Deviation | None:
        """Deviation of the drifted windows; None without an alarm."""
        drifted = self.test.drifted
        return self.test.deviation(drifted, self.confidence) if drifted else None


def drift_sentence(tested: DriftWindows) -> str:
    """Return whether there is drift, and if so which class is off, by how much and since when."""
    windows = len(tested.test.windows)
    many = f'{windows} window{"s" if windows > 1 else ""}'
    sizes = set(np.diff(tested.ends).tolist())
    of = f'{sizes.pop()} parts' if len(sizes) == 1 else f'about {tested.parts} parts'
    found = tested.deviation
    if found is None:
        return f'No drift in {many} of {of}.'
    drifted = tested.test.drifted
    first, last = int(tested.ends[drifted.start]) + 1, int(tested.ends[drifted.stop])
    label = f' ({tested.labels[drifted.start]})' if tested.labels else ''
    when = f'since part {first}{label}'
    if drifted.stop < windows:
        when = f'in parts {first} to {last}{label}, but not in the later parts together'
    interval = Interval(found.difference, found.lower, found.upper)
    decimals = decimals_of(interval)
    share, expected = (f'{100 * x:.{decimals}f} %' for x in (found.share, found.expected))
    difference, low, high = (
        points(x, decimals) for x in (found.difference, found.lower, found.upper)
    )
    return (
        f'Class {tested.live.ids[found.index]} is seen in {share} instead of {expected} '
        f'({difference} points, {100 * found.confidence:.10g} % interval {low} to {high}) {when}.'
    )


def power_sentences(tested: DriftWindows) -> str:
    """Return which shift a window finds, and how often there is a false alarm."""
    shift, level = tested.detectable, tested.test.level
    size = f'A window of {tested.parts} parts'
    if np.isnan(shift):
        finds = (
            f'{size} does not find a class that is off by {100 * MAX_SHIFT:g} points with a '
            f'probability of {100 * tested.power:g} %.'
        )
    else:
        finds = (
            f'{size} finds a class that is off by {100 * shift:.1f} points with a probability of '
            f'{100 * tested.power:g} %.'
        )
    return (
        f'{finds} Without drift, {100 * level:.3g} % of windows are alarms: one in '
        f'{tested.run_length:.0f} parts.'
    )


def window_table(tested: DriftWindows, title: str) -> Table:
    """Return a table with a row for each window: its parts, p value and largest deviation."""
    test = tested.test
    labels = ['from'] if tested.labels else []
    table = titled_table(
        title,
        'parts',
        *labels,
        'p',
        'class',
        'share\n(%)',
        'simulated\n(%)',
        'difference\n(points)',
        '',
    )
    alarms = set(test.alarms.tolist())
    count = len(test.windows)
    for k in range(count):
        if count - k > MAX_ROWS and k not in alarms:
            continue
        found = test.deviation(range(k, k + 1), tested.confidence)
        interval = Interval(found.difference, found.lower, found.upper)
        decimals = decimals_of(interval)
        table.add_row(
            f'{tested.ends[k] + 1} to {tested.ends[k + 1]}',
            *([tested.labels[k]] if labels else []),
            _p_text(float(test.p_values[k]), test.level),
            str(tested.live.ids[found.index]),
            f'{100 * found.share:.{decimals}f}',
            f'{100 * found.expected:.{decimals}f}',
            points_text(found.difference, found.lower, found.upper),
            'alarm' if k in alarms else '',
        )
    return table


def _p_text(p_value: float, level: float) -> str:
    smallest = level / EXCEEDANCES
    return f'{p_value:.2g}' if p_value > smallest else f'< {smallest:.1g}'


def live_table(live: LiveCounts, confidence: float) -> Table:
    """Return a table with the shares of all classes: simulated, counted, and both together."""
    title = (
        f'Shares of all {live.parts} parts, with the simulation as the prior '
        f'(weight {live.prior_weight:g})'
    )
    percent = f'{100 * confidence:.10g} %\ninterval'
    table = titled_table(title, 'class', 'counted', 'simulated', 'share', percent)
    for k, interval in enumerate(live.intervals(confidence)):
        table.add_row(
            str(live.ids[k]),
            str(live.observed[k]),
            str(live.simulated[k]),
            probability_text(interval),
            interval_text(interval),
        )
    return table


def drift_fields(tested: DriftWindows) -> dict[str, object]:
    """Return the fields of the JSON document; shares are from 0 to 1, and not rounded."""
    test, live = tested.test, tested.live
    shift = tested.detectable
    alarms = set(test.alarms.tolist())
    found = tested.deviation
    return {
        'message': drift_sentence(tested),
        'level': test.level,
        'run_length': tested.run_length,
        'detectable_shift': shift,
        'power': tested.power,
        'confidence': tested.confidence,
        'parts': live.parts,
        'drift': None
        if found is None
        else {
            'first_part': int(tested.ends[test.drifted.start]) + 1,
            'last_part': int(tested.ends[test.drifted.stop]),
            **_deviation_fields(found, live),
        },
        'windows': [
            {
                'first_part': int(tested.ends[k]) + 1,
                'last_part': int(tested.ends[k + 1]),
                'label': tested.labels[k] if tested.labels else None,
                'counts': row.tolist(),
                'g': float(test.g[k]),
                'p_value': float(test.p_values[k]),
                'alarm': k in alarms,
                **_deviation_fields(test.deviation(range(k, k + 1), tested.confidence), live),
            }
            for k, row in enumerate(test.windows)
        ],
        'prior_weight': live.prior_weight,
        'classes': [
            {
                'symmetry_class': live.ids[k],
                'simulated': int(live.simulated[k]),
                'observed': int(live.observed[k]),
                'concentration': concentration,
                'probability': interval.probability,
                'lower': interval.lower,
                'upper': interval.upper,
            }
            for k, (interval, concentration) in enumerate(
                zip(live.intervals(tested.confidence), numbers(live.concentration), strict=True)
            )
        ],
    }


def _deviation_fields(found: Deviation, live: LiveCounts) -> dict[str, object]:
    return {
        'symmetry_class': live.ids[found.index],
        'share': found.share,
        'simulated_share': found.expected,
        'difference': found.difference,
        'lower': found.lower,
        'upper': found.upper,
        'residual': found.residual,
    }
