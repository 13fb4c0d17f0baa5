"""Tables, document and picture of a drift test."""

import re

import numpy as np
import pytest

from resting_aspects_ros.report.drift import MAX_CLASSES, MAX_ROWS, drift_figure, window_table
from resting_aspects_ros.statistics.counted_parts import ObservedCounts
from resting_aspects_ros.statistics.drift import find_drift


def drift_of(rows):
    """Test batches by class against 10,000 drops with the same shares as the first."""
    rows = np.array(rows)
    simulated = rows[0] * 10_000 // rows[0].sum()
    groups = tuple((k,) for k in range(1, rows.shape[1] + 1))
    observed = ObservedCounts.of_rows(rows, 'counts', groups, ())
    size = int(rows.sum(axis=1).min())
    return find_drift(observed, simulated, size, np.random.default_rng(1), 0.01)


def test_long_table_has_the_last_windows_and_all_alarms(lines):
    rows = [[50, 50]] * (MAX_ROWS + 20)
    rows[3] = [5, 95]
    text = '\n'.join(lines(window_table(drift_of(rows), 'title')))
    assert re.search('301 to 400 +< 0.0001 ', text)
    assert '201 to 300' not in text
    assert len(re.findall('^ *[0-9]+ to [0-9]+ ', text, re.MULTILINE)) == MAX_ROWS + 1


@pytest.mark.parametrize('classes', [2, MAX_CLASSES + 3])
def test_figure_has_axes_for_the_common_classes(classes):
    rows = [[50] * classes] * 3 + [[150] + [50] * (classes - 1)]
    figure = drift_figure(drift_of(rows))
    assert len(figure.axes) == min(classes, MAX_CLASSES)
    assert figure.axes[0].get_ylabel() == 'class 1'
