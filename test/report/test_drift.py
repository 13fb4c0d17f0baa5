"""Tables of a drift test."""

import re

import numpy as np

from resting_aspects_ros.report.drift import MAX_ROWS, window_table
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
