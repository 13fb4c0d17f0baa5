"""A drift test in sentences, as tables and as a document."""

import numpy as np

from resting_aspects_ros.report.document import numbers
from resting_aspects_ros.report.format import (
    decimals_of,
    interval_text,
    points,
    points_text,
    probability_text,
    share_text,
    shown_difference,
)
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.statistics.comparison import EXCEEDANCES
from resting_aspects_ros.statistics.counted_parts import LiveCounts
from resting_aspects_ros.statistics.drift import POWER, Deviation, DriftTest
from resting_aspects_ros.statistics.intervals import Interval

# Windows of a longer table are left out, except the last ones and those with an alarm.
MAX_ROWS = 40


def drift_sentence(test: DriftTest) -> str:
    """Return whether there is drift, which class deviates, by how much and when, and what is open.

    It also states how many parts at the end were not tested.
    """
    untested = ''
    if test.untested:
        parts, do = ('part is', 'it does') if test.untested == 1 else ('parts are', 'they do')
        untested = f'The last {test.untested} {parts} not tested: {do} not fill a window.'
    return f'{_result(test)} {untested}'.rstrip()


def _result(test: DriftTest) -> str:
    found = test.deviation
    if found is None:
        windows = len(test.windows)
        many = f'{windows} window{"s" if windows > 1 else ""}'
        sizes = set(np.diff(test.ends).tolist())
        of = f'{test.size} parts' if len(sizes) == 1 else f'about {test.size} parts'
        return f'No drift in {many} of {of}.'
    share, expected, shown, decimals = _percents(found)
    difference, low, high = (points(x, decimals) for x in (shown, found.lower, found.upper))
    seen = f'lass {test.names[found.index]} is seen in {share} % instead of {expected} %'
    bounds_text = f'{100 * found.confidence:.10g} % interval {low} to {high}'
    deviation = f'({difference} points, {bounds_text})'
    if found.lower <= 0 <= found.upper:
        return (
            f'The shares deviate {_when(test)}, but no single class does significantly: '
            f'c{seen} {deviation}.'
        )
    return f'C{seen} {deviation} {_when(test)}.'


def _percents(found: Deviation) -> tuple[str, str, float, int]:
    """Return both shares as texts in percent, the difference that these show, and the decimals."""
    decimals = decimals_of(Interval(found.difference, found.lower, found.upper))
    share, expected = (f'{100 * x:.{decimals}f}' for x in (found.share, found.expected))
    return share, expected, shown_difference(found.share, found.expected, decimals), decimals


def _when(test: DriftTest) -> str:
    drifted = test.drifted
    first, last = int(test.ends[drifted.start]) + 1, int(test.ends[drifted.stop])
    label = f' ({test.labels[drifted.start]})' if test.labels else ''
    if drifted.stop < len(test.windows):
        return f'in parts {first} to {last}{label}, but not in the later windows'
    return f'since part {first}{label}'


def drift_notes(test: DriftTest, shift: float, needed: int | None) -> str:
    """Return how batches scatter, what a window finds, and how often there is a false alarm.

    needed : number of parts that finds ``shift`` with a probability of POWER; None if none does
    """
    finds = (
        f'A deviation of {100 * shift:g} points in any class is '
        + ('not found with any number of parts' if needed is None else f'found in {needed} parts')
        + f' with a probability of {100 * POWER:g} %.'
    )
    alarms = (
        f'Without drift, at most {100 * test.level:.3g} % of windows raise an alarm: one in '
        f'{test.size / test.level:.0f} parts.'
    )
    sentences = [_scatter_sentence(test), finds, alarms]
    if number := test.observed.unclassified:
        share = share_text(number / (number + test.observed.parts))
        parts = 'part is' if number == 1 else 'parts are'
        sentences.append(
            f'{number} unclassified {parts} not tested: {share} % of the counted parts.'
        )
    return ' '.join(sentences)


def _scatter_sentence(test: DriftTest) -> str:
    scatter = test.scatter
    if scatter is None:
        return 'There are too few batches to tell whether they scatter more than by chance.'
    if scatter.factor <= 1:
        return 'Successive batches scatter as by chance.'
    return (
        f'Successive batches scatter with {scatter.factor:.2g} times the variance of chance, '
        'which the test allows for.'
    )


def window_table(test: DriftTest, title: str) -> Table:
    """Return a table with a row for each window: its parts, p value and largest deviation."""
    labels = ['from'] if test.labels else []
    shares = 'share\n(%)', 'simulated\n(%)', 'difference\n(points)', ''
    table = Table(title, ('parts', *labels, 'p', 'class', *shares))
    alarms = set(test.alarms.tolist())
    count = len(test.windows)
    for k in range(count):
        if count - k > MAX_ROWS and k not in alarms:
            continue
        found = test.deviation_in(range(k, k + 1))
        share, expected, difference, _ = _percents(found)
        table.add_row(
            f'{test.ends[k] + 1} to {test.ends[k + 1]}',
            *([test.labels[k]] if labels else []),
            _p_text(float(test.p_values[k]), test.level),
            test.names[found.index],
            share,
            expected,
            points_text(difference, found.lower, found.upper),
            'alarm' if k in alarms else '',
        )
    return table


def _p_text(p_value: float, level: float) -> str:
    smallest = level / EXCEEDANCES
    return f'{p_value:.2g}' if p_value > smallest else f'< {smallest:.1g}'


def live_table(test: DriftTest, live: LiveCounts) -> Table:
    """Return a table with the shares of all classes: simulated, counted, and both together."""
    title = (
        f'Shares of all {live.parts} parts, with the simulation as the prior '
        f'(weight {live.prior_weight:g})'
    )
    percent = f'{100 * test.confidence:.10g} %\ninterval'
    table = Table(title, ('class', 'counted', 'simulated', 'share', percent))
    for k, interval in enumerate(live.intervals(test.confidence)):
        table.add_row(
            test.names[k],
            str(live.observed[k]),
            str(live.simulated[k]),
            probability_text(interval),
            interval_text(interval),
        )
    return table


def drift_fields(test: DriftTest, live: LiveCounts) -> dict[str, object]:
    """Return the fields of the JSON document; shares are from 0 to 1, and not rounded."""
    alarms = set(test.alarms.tolist())
    found = test.deviation
    return {
        'message': drift_sentence(test),
        'level': test.level,
        'scatter': None if test.scatter is None else test.scatter.factor,
        'confidence': test.confidence,
        'parts': live.parts,
        'untested': test.untested,
        'unclassified': test.observed.unclassified,
        'drift': None
        if found is None
        else {
            'first_part': int(test.ends[test.drifted.start]) + 1,
            'last_part': int(test.ends[test.drifted.stop]),
            **_deviation_fields(found, test),
        },
        'windows': [
            {
                'first_part': int(test.ends[k]) + 1,
                'last_part': int(test.ends[k + 1]),
                'label': test.labels[k] if test.labels else None,
                'counts': row.tolist(),
                'g': float(test.g[k]),
                'p_value': float(test.p_values[k]),
                'alarm': k in alarms,
                **_deviation_fields(test.deviation_in(range(k, k + 1)), test),
            }
            for k, row in enumerate(test.windows)
        ],
        'prior_weight': live.prior_weight,
        'classes': [
            {
                'symmetry_class': live.ids[k],
                'symmetry_classes': test.observed.groups[k],
                'simulated': int(live.simulated[k]),
                'observed': int(live.observed[k]),
                'concentration': concentration,
                'probability': interval.probability,
                'lower': interval.lower,
                'upper': interval.upper,
            }
            for k, (interval, concentration) in enumerate(
                zip(live.intervals(test.confidence), numbers(live.concentration), strict=True)
            )
        ],
    }


def _deviation_fields(found: Deviation, test: DriftTest) -> dict[str, object]:
    return {
        'symmetry_class': test.observed.groups[found.index][0],
        'symmetry_classes': test.observed.groups[found.index],
        'share': found.share,
        'simulated_share': found.expected,
        'difference': found.difference,
        'lower': found.lower,
        'upper': found.upper,
        'residual': found.residual,
    }
