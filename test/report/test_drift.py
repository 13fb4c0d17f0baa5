"""Tables, document and picture of a drift test."""

import dataclasses
import re

import numpy as np
import pytest
from rich.console import Console

from resting_aspects_ros.report.drift import (
    MAX_CLASSES,
    MAX_ROWS,
    drift_figure,
    drift_notes,
    drift_sentence,
    live_table,
    window_table,
)
from resting_aspects_ros.statistics.counted_parts import LiveCounts, ObservedCounts
from resting_aspects_ros.statistics.drift import find_drift


def drift_of(rows, labels=(), level=0.01, simulated=None, window=None):
    """Test batches by class against 10,000 drops with the same shares as the first.

    Each batch is a window, unless ``window`` is given.
    """
    rows = np.array(rows)
    if simulated is None:
        simulated = rows[0] * 10_000 // rows[0].sum()
    groups = tuple((k,) for k in range(1, rows.shape[1] + 1))
    observed = ObservedCounts.of_rows(rows, 'counts', groups, labels)
    rng = np.random.default_rng(1)
    size = int(rows.sum(axis=1).min()) if window is None else window
    return find_drift(observed, simulated, size, rng, level)


def text_of(table):
    console = Console(width=200)
    with console.capture() as captured:
        console.print(table)
    return captured.get()


def test_time_of_the_drift_is_stated():
    rows, labels = (
        [[50, 50]] * 3 + [[20, 80]] * 3,
        ['8:00', '8:10', '8:20', '8:30', '8:40', '9:00'],
    )
    found = drift_of(rows, labels)
    assert drift_sentence(found).endswith(' since part 301 (8:30).')
    assert drift_sentence(found).startswith('Class 1 is seen in 20 % instead of 50 % (-30 points')
    assert '8:30' in text_of(window_table(found, 'title'))


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ([[500, 500]], 'No drift in 1 window of 1000 parts.'),
        ([[50, 50]] * 10 + [[20, 80], [20, 80]], ' since part 1001.'),
        ([[20, 80]] * 6, ' since part 1.'),
        ([[20, 80]] * 2 + [[50, 50]] * 8, 'seen in 20 % instead of 50 % (-30 points, 95 %'),
        ([[20, 80]] * 2 + [[50, 50]] * 8, ' in parts 1 to 200, but not in the later parts'),
    ],
)
def test_sentence_states_when_the_shares_are_off(rows, message):
    assert message in drift_sentence(drift_of(rows, simulated=np.array([5000, 5000])))


def test_parts_that_are_not_tested_are_stated():
    found = drift_of([[50, 50], [2, 5]], window=100)
    assert drift_sentence(found) == (
        'No drift in 1 window of 100 parts. The last 7 parts are not tested: they do not fill a '
        'window.'
    )
    found = dataclasses.replace(found, unclassified=1, groups=((1, 2), (3,)))
    notes = drift_notes(found, 0.05, 1000)
    assert '1 unclassified part is not tested: 0.93 % of the counted parts.' in notes
    live = LiveCounts((1, 3), np.array([5000, 5000]), np.array([52, 55]))
    assert '1+2' in text_of(live_table(found, live))
    assert drift_figure(found).axes[0].get_ylabel() == 'class 1+2'


def test_long_table_has_the_last_windows_and_all_alarms():
    rows = [[50, 50]] * (MAX_ROWS + 20)
    rows[3] = [5, 95]
    text = text_of(window_table(drift_of(rows), 'title'))
    assert re.search('301 to 400 +< 0.0001 ', text)
    assert '201 to 300' not in text
    assert len(re.findall('^ *[0-9]+ to [0-9]+ ', text, re.MULTILINE)) == MAX_ROWS + 1


@pytest.mark.parametrize('classes', [2, MAX_CLASSES + 3])
def test_figure_has_axes_for_the_common_classes(classes):
    rows = [[50] * classes] * 3 + [[150] + [50] * (classes - 1)]
    figure = drift_figure(drift_of(rows))
    assert len(figure.axes) == min(classes, MAX_CLASSES)
    assert figure.axes[0].get_ylabel() == 'class 1'
