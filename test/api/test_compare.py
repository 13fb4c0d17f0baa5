"""Counts of parts and of transitions from files and arrays, beside simulated ones."""

import dataclasses
import json

import numpy as np
import pytest

from resting_aspects_ros.api.compare import machine_transitions, watch_drift
from resting_aspects_ros.api.count_files import counts_from_array, read_observed
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsWarning
from resting_aspects_ros.report.drift import MAX_ROWS, window_table
from resting_aspects_ros.statistics.drift import parts_needed
from resting_aspects_ros.statistics.transitions import no_actions

SIMULATED = np.array([2700, 2800, 2400, 1300, 800])
GOOD, BAD = [54, 56, 48, 26, 16], [40, 90, 40, 20, 10]
CLASSES = ((1,), (2,), (3,))


@pytest.fixture
def expected(tmp_path):
    path = tmp_path / 'expected.csv'
    rows = [f'{k},{n}' for k, n in enumerate(SIMULATED, 1)]
    path.write_text('\n'.join(['class,count', *rows]))
    return path


@pytest.fixture
def observed(tmp_path):
    """Write a CSV and read it as counts of three classes."""

    def read(*lines):
        path = tmp_path / 'counted.csv'
        path.write_text('\n'.join(lines), encoding='utf-8')
        return read_observed(path, (1, 2, 3))

    return read


def windows(counts, size=1):
    return counts.windows(size)[0].tolist()


@pytest.mark.parametrize(
    'lines',
    [
        ('Class;Batch;COUNT', '3;a;3', 'class_2;a;2', 'CLASS 1;a;1', '', '3;b;6', '1;b;4'),
        ('class,count,batch', '1,1,a', '2,2,a', '3,3,a', '1,4,b', '3,6,b'),
        ('time,count,class', '8:00,3,class_3', '8:00,1,1', '8:00,2,2', '8:01,6,3', '8:01,4,1'),
    ],
)
def test_formats_have_the_same_counts(observed, lines):
    assert windows(observed(*lines)) == [[1, 2, 3], [4, 0, 6]]


def test_rows_without_counts_are_parts(observed):
    found = observed('time,class', '8:00,1', '8:00,3', '8:01,1', '8:02,2')
    counts, ends, labels = found.windows(2)
    assert counts.tolist() == [[1, 0, 1], [1, 1, 0]]
    assert ends.tolist() == [0, 2, 4]
    assert labels == ['8:00', '8:01']


def test_classes_can_be_counted_together(observed):
    lines = ['a,1,1', 'a,3 + 2,5', 'a,Unclassified,4', 'b,2+3,6', 'b,1,4']
    found = observed('batch,class,count', *lines)
    assert found.groups == ((1,), (2, 3))
    assert (windows(found), found.parts, found.unclassified) == ([[1, 5], [4, 6]], 16, 4)


@pytest.mark.parametrize(
    ('lines', 'message'),
    [
        (('aspect,count', '1,2'), 'expected one column class; columns aspect or class and'),
        (('class,number', '1,2'), "column names 'class, number' .* unless each row is one"),
        (('class,count', '1,0'), 'invalid number of counted parts 0'),
        (('class', '1', '4'), "invalid class '4' .* line 3: expected .* one of 1, 2, 3"),
        (('batch,class,count', 'a,1,2', 'a,1,3'), 'each class once in a batch'),
        (('batch,class,count', 'a,1,2', 'b,1,3', 'a,2,3'), 'rows of a batch together'),
        (('class,count', '2+3,5', '3,4'), "class '3' .* one of 1, 2, 3, each in one group only"),
    ],
)
def test_wrong_files_are_named(observed, lines, message):
    with pytest.raises(InvalidValueError, match=message):
        observed(*lines)


@pytest.mark.parametrize('rows', [[[1, 1.5, 1]], [[1, np.nan, 1]], [[1, 1]], [['a', 1, 1]]])
def test_wrong_arrays_are_named(rows):
    with pytest.raises(InvalidValueError, match=r'invalid counts .* expected rows of 3 integers'):
        counts_from_array(rows, CLASSES)


def test_drift_is_found_and_named(expected):
    rows = [GOOD] * (MAX_ROWS + 20) + [BAD] * 3
    result = watch_drift(expected, rows, window=200)
    assert result.verdict == (
        'Class 2 is seen in 45 % instead of 28 % (+17 points, 95 % interval +12 to +22) since '
        'part 12001.'
    )
    document = json.loads(result.to_json())
    assert document['message'] == result.verdict
    assert (document['level'], document['shift'], document['parts']) == (0.01, 0.05, 12600)
    assert document['parts_needed'] == result.needed
    drift = document['drift']
    assert (drift['symmetry_class'], drift['first_part'], drift['last_part']) == (2, 12001, 12600)
    assert [row['alarm'] for row in document['windows']] == [False] * 60 + [True] * 3
    assert [row['counts'] for row in document['windows']] == rows
    assert sum(row['probability'] for row in document['classes']) == pytest.approx(1)


def test_past_drift_is_a_window(expected):
    rows = [GOOD] * 4 + [BAD] + [GOOD] * (MAX_ROWS + 5)
    result = watch_drift(expected, rows, window=200)
    assert 'in parts 801 to 1000, but not in the later windows.' in result.verdict
    assert not watch_drift(expected, rows[:4], window=200).drift
    # A long table has the last windows, and all with an alarm.
    parts = [row[0] for row in window_table(result.test, '').rows]
    assert parts[:2] == ['801 to 1000', '2001 to 2200']
    assert len(parts) == MAX_ROWS + 1


def test_default_window_finds_the_shift(expected):
    needed = parts_needed(SIMULATED, 0.1)
    few = watch_drift(expected, [GOOD, [1, 1, 1, 1, 1]])
    assert few.test.ends.tolist() == [0, 205]
    result = watch_drift(expected, [GOOD] * 20, shift=0.1)
    assert result.needed == needed * max(result.test.scatter.factor, 1)
    # A batch has 200 parts.
    assert set(np.diff(result.test.ends)) == {200 * -(-needed // 200)}


def test_grouped_classes_are_compared_with_the_sum(expected, tmp_path):
    (tmp_path / 'c.csv').write_text('class,count\n1,54\n2+3,104\n4,26\n5,16\nunclassified,2\n')
    result = watch_drift(expected, tmp_path / 'c.csv')
    assert result.live.simulated.tolist() == [2700, 5200, 1300, 800]
    assert (result.drift, result.test.names) == (False, ['1', '2+3', '4', '5'])
    assert json.loads(result.to_json())['unclassified'] == 2
    # Counts that a camera made while the machine ran well have groups of their own.
    (tmp_path / 'e.csv').write_text('class,count\n1,2700\n2,2800\n3+4,3700\n5,800\n')
    result = watch_drift(tmp_path / 'e.csv', tmp_path / 'c.csv')
    assert result.test.names == ['1', '2+3+4', '5']
    (tmp_path / 'all.csv').write_text('class,count\n1+2+3+4+5,54\n')
    with pytest.raises(InvalidValueError, match='two or more classes'):
        watch_drift(expected, tmp_path / 'all.csv')


def test_few_drops_give_a_warning(tmp_path):
    path = tmp_path / 'few.csv'
    path.write_text('class,count\n1,60\n2,40\n')
    with pytest.warns(RestingAspectsWarning, match='100 simulated drops are too few'):
        result = watch_drift(path, [[6, 4]] * 30)
    assert result.test.ends.tolist() == [0, 100, 200, 300]


def test_wrong_arguments_are_named(expected):
    with pytest.raises(InvalidValueError, match='invalid window 0: expected an integer'):
        watch_drift(expected, [GOOD], window=0)
    with pytest.raises(InvalidValueError, match=r'invalid classes \[1, 2, 3, 4, 5\] in '):
        watch_drift(expected, counts_from_array([[1, 2, 3]], CLASSES))


@pytest.fixture
def simulated(part):
    """Give a matrix without actions of the nut: eight aspects in two classes."""
    return no_actions(find_aspects(part('hex_nut')))


def test_matrix_of_the_machine_is_beside_the_simulated_one(simulated):
    counts = np.zeros_like(simulated.counts)
    counts[0, [0, -1]] = 48, 32
    moved = [[56, 14], [0, 0]]
    found = machine_transitions(moved, dataclasses.replace(simulated, counts=counts))
    assert found.machine.counts.tolist() == [[56, 14, 0, 0, 0, 0], [0] * 6]
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10.
    assert found.difference[0, 0] == pytest.approx(56 / 70 - 48 / 80)
    bounds = found.lower[0, 0], found.upper[0, 0]
    assert bounds == pytest.approx((0.0524, 0.3339), abs=5e-5)
    assert np.isnan(machine_transitions(moved, simulated).difference).all()


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ([[1, 2]], 'expected 2 rows'),
        ([[1, 2, 3]], 'invalid transitions .* rows of 2 integers'),
        ([[0, 0], [0, 0]], 'invalid number of counted parts 0'),
    ],
)
def test_wrong_transitions_are_named(simulated, given, message):
    with pytest.raises(InvalidValueError, match=message):
        machine_transitions(given, simulated)
