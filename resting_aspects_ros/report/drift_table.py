"""The result of a drift test as terminal tables and a JSON document."""

from rich.table import Table

from resting_aspects_ros.core.statistics.drift import Deviation
from resting_aspects_ros.core.statistics.g_test import EXCEEDANCES
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.report.document import numbers
from resting_aspects_ros.report.drift_text import DriftWindows, drift_sentence
from resting_aspects_ros.report.rounding import (
    decimals_of,
    interval_text,
    points_text,
    probability_text,
    shown_difference,
)
from resting_aspects_ros.report.transition_table import titled_table

# Windows of a longer table are left out, except the last ones and those with an alarm.
MAX_ROWS = 40


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
            tested.names[found.index],
            f'{100 * found.share:.{decimals}f}',
            f'{100 * found.expected:.{decimals}f}',
            points_text(
                shown_difference(found.share, found.expected, decimals), found.lower, found.upper
            ),
            'alarm' if k in alarms else '',
        )
    return table


def _p_text(p_value: float, level: float) -> str:
    smallest = level / EXCEEDANCES
    return f'{p_value:.2g}' if p_value > smallest else f'< {smallest:.1g}'


def live_table(tested: DriftWindows) -> Table:
    """Return a table with the shares of all classes: simulated, counted, and both together."""
    live, confidence = tested.live, tested.confidence
    title = (
        f'Shares of all {live.parts} parts, with the simulation as the prior '
        f'(weight {live.prior_weight:g})'
    )
    percent = f'{100 * confidence:.10g} %\ninterval'
    table = titled_table(title, 'class', 'counted', 'simulated', 'share', percent)
    for k, interval in enumerate(live.intervals(confidence)):
        table.add_row(
            tested.names[k],
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
        'scatter': None if test.scatter is None else test.scatter.factor,
        'run_length': tested.run_length,
        'detectable_shift': shift,
        'power': tested.power,
        'confidence': tested.confidence,
        'parts': live.parts,
        'untested': tested.untested,
        'unclassified': tested.unclassified,
        'drift': None
        if found is None
        else {
            'first_part': int(tested.ends[test.drifted.start]) + 1,
            'last_part': int(tested.ends[test.drifted.stop]),
            **_deviation_fields(found, tested),
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
                **_deviation_fields(test.deviation(range(k, k + 1), tested.confidence), tested),
            }
            for k, row in enumerate(test.windows)
        ],
        'prior_weight': live.prior_weight,
        'classes': [
            {
                'symmetry_class': live.ids[k],
                'symmetry_classes': tested.classes[k],
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


def _deviation_fields(found: Deviation, tested: DriftWindows) -> dict[str, object]:
    return {
        'symmetry_class': tested.live.ids[found.index],
        'symmetry_classes': tested.classes[found.index],
        'share': found.share,
        'simulated_share': found.expected,
        'difference': found.difference,
        'lower': found.lower,
        'upper': found.upper,
        'residual': found.residual,
    }
