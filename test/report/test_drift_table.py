"""Tables, document and picture of a drift test."""

import dataclasses
import re

import numpy as np
import pytest
from rich.console import Console

from resting_aspects_ros.core.statistics.drift import find_drift
from resting_aspects_ros.core.statistics.live_counts import LiveCounts
from resting_aspects_ros.report.drift_figure import MAX_CLASSES, drift_figure
from resting_aspects_ros.report.drift_table import MAX_ROWS, live_table, window_table
from resting_aspects_ros.report.drift_text import (
    DriftWindows,
    drift_sentence,
    power_sentences,
    unclassified_text,
)


@pytest.fixture
def tested():
    """Test windows of counts by class against 10,000 drops with the same shares as the first."""

    def make(rows, labels=(), level=0.01, simulated=None, **fields):
        rows = np.array(rows)
        if simulated is None:
            simulated = rows[0] * 10_000 // rows[0].sum()
        test = find_drift(rows, simulated, np.random.default_rng(1), level)
        live = LiveCounts(tuple(range(1, len(simulated) + 1)), simulated, rows.sum(axis=0))
        ends = np.concatenate([[0], rows.sum(axis=1).cumsum()])
        return DriftWindows(test, live, ends, labels, 0.95, 0.8, **fields)

    return make


def text_of(table):
    console = Console(width=200)
    with console.capture() as captured:
        console.print(table)
    return captured.get()


def test_sizes_of_windows_are_stated(tested):
    assert drift_sentence(tested([[50, 50]])) == 'No drift in 1 window of 100 parts.'
    found = drift_sentence(tested([[50, 50], [60, 60]]))
    assert found == 'No drift in 2 windows of about 110 parts.'


def test_time_of_the_drift_is_stated(tested):
    rows, labels = (
        [[50, 50]] * 3 + [[20, 80]] * 3,
        ['8:00', '8:10', '8:20', '8:30', '8:40', '9:00'],
    )
    found = tested(rows, labels)
    assert drift_sentence(found).endswith(' since part 301 (8:30).')
    assert drift_sentence(found).startswith('Class 1 is seen in 20 % instead of 50 % (-30 points')
    assert '8:30' in text_of(window_table(found, 'title'))


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ([[500, 500]], 'No drift in 1 window of 1000 parts.'),
        ([[500, 500], [20, 80], [20, 80]], ' since part 1001.'),
        ([[20, 80], [20, 80]], ' in all 2 windows, parts 1 to 200.'),
        ([[20, 80]], ' in the only window, parts 1 to 100.'),
        ([[20, 80]] * 2 + [[50, 50]] * 5, 'seen in 20 % instead of 50 % (-30 points, 95 %'),
        ([[20, 80]] * 2 + [[50, 50]] * 5, ' in parts 1 to 200, but not in the later parts'),
        ([[20, 80]] * 4 + [[500, 500]] + [[35, 65]], ' There is another alarm in parts '),
        ([[30, 70]] * 4 + [[500, 500]] + [[32, 68], [50, 50]] * 2, ' There are alarms in 4 other'),
    ],
)
def test_sentence_states_when_the_shares_are_off(tested, rows, message):
    assert message in drift_sentence(tested(rows, simulated=np.array([5000, 5000])))


def test_parts_that_are_not_tested_are_stated(tested):
    found = tested([[50, 50]], unclassified=1, groups=((1, 2), (3,)))
    left = dataclasses.replace(
        found, live=dataclasses.replace(found.live, observed=np.array([52, 55]))
    )
    assert drift_sentence(left).endswith(
        'No drift in 1 window of 100 parts. The last 7 parts are not tested: they do not fill a '
        'window.'
    )
    assert (
        unclassified_text(left)
        == '1 unclassified part is not tested: 0.93 % of the counted parts.'
    )
    assert '1+2' in text_of(live_table(left))
    assert drift_figure(left).axes[0].get_ylabel() == 'class 1+2'


def test_detectable_shift_and_run_length_are_stated(tested):
    text = power_sentences(tested([[50, 50]], level=0.05))
    # (1.96 + 0.84) standard errors of 0.05, a little less because the variance decreases.
    assert 'A window of 100 parts finds a class that deviates by 13.9 points' in text
    assert '5 % of windows raise an alarm: one in 2000 parts.' in text
    assert 'does not find a class that deviates by 40 points' in power_sentences(tested([[2, 2]]))


def test_long_table_has_the_last_windows_and_all_alarms(tested):
    rows = [[50, 50]] * (MAX_ROWS + 20)
    rows[3] = [5, 95]
    text = text_of(window_table(tested(rows), 'title'))
    assert re.search('301 to 400 +< 0.0001 ', text)
    assert '201 to 300' not in text
    assert len(re.findall('^ *[0-9]+ to [0-9]+ ', text, re.MULTILINE)) == MAX_ROWS + 1


@pytest.mark.parametrize('classes', [2, MAX_CLASSES + 3])
def test_figure_has_axes_for_the_common_classes(tested, classes):
    rows = [[50] * classes] * 3 + [[150] + [50] * (classes - 1)]
    figure = drift_figure(tested(rows))
    assert len(figure.axes) == min(classes, MAX_CLASSES)
    assert figure.axes[0].get_ylabel() == 'class 1'
