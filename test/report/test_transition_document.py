"""The fields of transitions are JSON, complete, and not rounded."""

import json

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.transitions import long_run_fields, matrix_fields, retention_fields
from resting_aspects_ros.statistics.markov import long_run
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix

OUTCOMES = ['unclassified', 'unsettled', 'failed', 'lost']


@pytest.fixture(scope='module')
def box(part):
    return find_aspects(part('box_10x20x30'))


@pytest.fixture(scope='module')
def matrix(box):
    counts = np.random.default_rng(8).multinomial(700, np.full(10, 0.1), size=6)
    counts[4] = 0
    return TransitionMatrix(box, counts, confidence=0.9)


def written(fields):
    """The fields after a round trip through JSON, which must not change them."""
    read = json.loads(json.dumps(fields, allow_nan=False))
    assert read == fields
    return read


def test_matrix_has_exact_numbers_for_each_aspect(matrix):
    fields = written(matrix_fields(matrix))
    assert fields['columns'] == [1, 2, 3, 4, 5, 6, *OUTCOMES]
    assert fields['counts'] == matrix.counts.tolist()
    assert fields['actions'] == [sum(row) for row in fields['counts']]
    lower, upper = matrix.bounds()
    assert (fields['lower'], fields['upper']) == (lower.tolist(), upper.tolist())
    assert fields['probability'][0] == [n / 700 for n in fields['counts'][0]]
    assert (fields['actions'][4], fields['probability'][4]) == (0, [None] * 10)
    assert (fields['lower'][4], fields['upper'][4]) == ([0.0] * 10, [1.0] * 10)


def test_classes_sum_rows_and_columns_of_their_members(matrix):
    classes = written(matrix_fields(matrix))['classes']
    assert classes['columns'] == [1, 2, 3, *OUTCOMES]
    assert classes['members'] == [[1, 2], [3, 4], [5, 6]]
    pairs = np.kron(np.eye(3, dtype=int), [1, 1])  # sums the two aspects of each class
    ends = pairs @ matrix.counts[:, :6] @ pairs.T
    assert classes['counts'] == np.hstack([ends, pairs @ matrix.counts[:, 6:]]).tolist()


def test_long_run_of_two_closed_classes_has_ids_and_weights(box):
    transitions = np.zeros((6, 6))
    transitions[[0, 1, 2, 3, 3, 4, 5], [1, 0, 2, 1, 2, 5, 5]] = [1, 1, 1, 0.25, 0.75, 1, 1]
    found = long_run(transitions, np.zeros(6), np.array([0.0, 0, 0, 1, 0, 0]))
    shares = found.shares
    fields = written(long_run_fields(found, shares / 2, shares, box))
    assert fields['long_run'] == pytest.approx([0.125, 0.125, 0.75, 0, 0, 0])
    assert fields['long_run_lower'] == (shares / 2).tolist()
    assert fields['long_run_upper'] == shares.tolist()
    assert [each['aspects'] for each in fields['closed_classes']] == [[1, 2], [3], [6]]
    assert [each['weight'] for each in fields['closed_classes']] == pytest.approx([0.25, 0.75, 0])
    assert fields['closed_classes'][0]['shares'] == pytest.approx([0.5, 0.5, 0, 0, 0, 0])
    assert (fields['transient'], fields['unreachable']) == ([4, 5], [5, 6])


def test_retention_curve_has_levels_with_bounds():
    lift = np.array([0.001, 0.002, 0.004, 0.008])
    curve = RetentionCurve(3, 0.0015, lift, np.array([0, 20, 40, 80]), np.full(4, 400), 0.95)
    fields = written(retention_fields(curve))
    assert (fields['aspect'], fields['barrier']) == (3, 0.0015)
    assert fields['lift'] == lift.tolist()
    assert fields['probability'] == [0.0, 0.05, 0.1, 0.2]
    assert [each['level'] for each in fields['levels']] == [0.01, 0.1, 0.5]
    assert fields['levels'][0]['lift'] == pytest.approx(0.0012)
    assert fields['levels'][1]['lift'] == pytest.approx(0.004)
    assert fields['levels'][1]['lower'] < 0.004 < fields['levels'][1]['upper']
    assert fields['levels'][2] == {'level': 0.5, 'lift': None, 'lower': None, 'upper': None}
