"""Transitions and retention as tables, documents and figures have the numbers of the results."""

import json

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.transitions import (
    long_run_fields,
    long_run_text,
    matrix_fields,
    plan_table,
    retention_fields,
    retention_figure,
    retention_lines,
    retention_table,
    table_rows,
    transition_figure,
    transition_table,
    wanted_table,
)
from resting_aspects_ros.statistics.markov import Plan, long_run, reach
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix

OUTCOMES = ['unclassified', 'unsettled', 'failed', 'lost']


@pytest.fixture(scope='module')
def bracket(part):
    return find_aspects(part('l_bracket'))


@pytest.fixture(scope='module')
def box(part):
    return find_aspects(part('box_10x20x30'))


@pytest.fixture(scope='module')
def matrix(box):
    counts = np.random.default_rng(8).multinomial(700, np.full(10, 0.1), size=6)
    counts[4] = 0
    return TransitionMatrix(box, counts, confidence=0.9)


# -- Tables ---------------------------------------------------------------------------------------


def test_probabilities_and_their_intervals_are_in_the_cells(bracket, lines):
    counts = np.full((5, 9), 0)
    counts[0, :5] = 600, 200, 100, 100, 0
    matrix = TransitionMatrix(bracket, counts)
    table = transition_table(matrix, False, '')
    lines(table)  # fits 80 columns
    first, second, *_ = table.rows
    assert [cell.split('\n')[0] for cell in first] == [
        '1',
        '60.0',
        '20.0',
        '10.0',
        '10.0',
        '0',
        '1000',
    ]
    assert second == ['2', *['-'] * 5, '0']
    ends = zip(*(each[0, :5].tolist() for each in matrix.bounds()), strict=True)
    for cell, (low, high) in zip(first[1:-1], ends, strict=True):
        shown = map(float, cell.split('\n')[1].split('-'))
        assert list(shown) == pytest.approx([100 * low, 100 * high], abs=0.051)


def test_closed_classes_and_unreached_aspects_are_named(bracket):
    transitions = np.zeros((5, 5))
    transitions[[0, 1, 2, 4], [1, 0, 2, 3]] = 1
    transitions[3] = [0.25, 0, 0.75, 0, 0]
    found = long_run(transitions, np.zeros(5), np.array([0.0, 0, 0, 1, 0]))
    text = long_run_text(table_rows(bracket, by_class=False), found).splitlines()
    assert text[2:] == [
        '  1: aspects 1 and 2, in which 25.0 % of parts end',
        '  2: aspect 3, in which 75.0 % of parts end',
        'Estimated as 0, because no simulated action led back there: aspect 4.',
        'No simulated drop and no action led to aspect 5.',
    ]


def test_way_to_wanted_aspects_has_never_and_certainty(bracket):
    transitions = np.zeros((5, 5))
    transitions[0, 0] = 1
    transitions[1, [0, 1]] = 0.5
    transitions[2, [0, 3]] = 0.25, 0.75
    transitions[3, 3] = 1
    transitions[4, [0, 1]] = 0.0001, 0.9899
    rows, wanted = table_rows(bracket, by_class=False), np.arange(5) == 0
    table = wanted_table(rows, wanted, *reach(transitions, wanted), 't')
    assert [' '.join(row) for row in table.rows] == [
        '1 wanted 0',
        '2 100.0 % 2.00',
        '3 25.0 % 1.00',
        '4 0.0 % never',
        '5 99.0 % 3.00',
    ]


def test_plan_has_an_action_and_a_time_for_each_aspect(bracket):
    plan = Plan(np.array([-1, 0, 1, 0, -1]), np.array([0, 1.25, 2.5, 8, np.inf]))
    table = plan_table(table_rows(bracket, by_class=False), plan, ('tap', 'toss'), 't')
    assert [' '.join(row) for row in table.rows] == [
        '1 wanted 0',
        '2 tap 1.25',
        '3 toss 2.50',
        '4 tap 8.00',
        '5 - never',
    ]


def curve_of(left, barrier=0.0015, aspect=3):
    """The curve of 400 parts at each of four lift heights."""
    lift = np.array([0.001, 0.002, 0.004, 0.008])
    return RetentionCurve(aspect, barrier, lift, np.array(left), np.full(4, 400), 0.95)


def test_retention_has_the_barrier_and_the_levels():
    curves = [curve_of([0, 20, 40, 80]), curve_of([0, 0, 0, 0], np.inf)]
    first, never = retention_table(curves, 't', 9.81).rows
    assert first[:3] == ['3', '1.50', '0.172']  # sqrt(2 g h)
    assert [cell.split('\n')[0] for cell in first[3:]] == ['1.20', '4.00', 'not reached']
    assert never[1:3] == ['-', '-']


# -- Documents ------------------------------------------------------------------------------------


def written(fields):
    """The fields after a round trip through JSON, which must not change them."""
    read = json.loads(json.dumps(fields, allow_nan=False))
    assert read == fields
    return read


def test_matrix_has_exact_numbers_for_aspects_and_classes(matrix):
    fields = written(matrix_fields(matrix))
    assert fields['columns'] == [1, 2, 3, 4, 5, 6, *OUTCOMES]
    assert fields['counts'] == matrix.counts.tolist()
    lower, upper = matrix.bounds()
    assert (fields['lower'], fields['upper']) == (lower.tolist(), upper.tolist())
    assert fields['probability'][0] == [n / 700 for n in fields['counts'][0]]
    assert (fields['actions'][4], fields['probability'][4]) == (0, [None] * 10)
    classes = fields['classes']
    assert classes['columns'] == [1, 2, 3, *OUTCOMES]
    assert classes['members'] == [[1, 2], [3, 4], [5, 6]]
    pairs = np.kron(np.eye(3, dtype=int), [1, 1])  # sums the two aspects of each class
    ends = pairs @ matrix.counts[:, :6] @ pairs.T
    assert classes['counts'] == np.hstack([ends, pairs @ matrix.counts[:, 6:]]).tolist()


def test_long_run_of_two_closed_classes_has_ids_and_weights(box):
    transitions = np.zeros((6, 6))
    transitions[[0, 1, 2, 3, 3, 4, 5], [1, 0, 2, 1, 2, 5, 5]] = [1, 1, 1, 0.25, 0.75, 1, 1]
    found = long_run(transitions, np.zeros(6), np.array([0.0, 0, 0, 1, 0, 0]))
    fields = written(long_run_fields(found, found.shares / 2, found.shares, box))
    assert fields['long_run'] == pytest.approx([0.125, 0.125, 0.75, 0, 0, 0])
    assert fields['long_run_lower'] == (found.shares / 2).tolist()
    assert [each['aspects'] for each in fields['closed_classes']] == [[1, 2], [3], [6]]
    assert [each['weight'] for each in fields['closed_classes']] == pytest.approx([0.25, 0.75, 0])
    assert fields['closed_classes'][0]['shares'] == pytest.approx([0.5, 0.5, 0, 0, 0, 0])
    assert (fields['transient'], fields['unreachable']) == ([4, 5], [5, 6])


def test_retention_curve_has_levels_with_bounds():
    fields = written(retention_fields(curve_of([0, 20, 40, 80])))
    assert (fields['aspect'], fields['barrier']) == (3, 0.0015)
    assert fields['probability'] == [0.0, 0.05, 0.1, 0.2]
    low, middle, high = fields['levels']
    assert (low['level'], low['lift']) == (0.01, pytest.approx(0.0012))
    assert middle['lift'] == pytest.approx(0.004)
    assert middle['lower'] < 0.004 < middle['upper']
    assert high == {'level': 0.5, 'lift': None, 'lower': None, 'upper': None}


# -- Figures --------------------------------------------------------------------------------------


def test_heat_map_writes_each_probability(bracket, part, texts):
    rows = np.random.default_rng(5).dirichlet(np.full(5, 0.4), 5)
    counts = np.zeros((5, 9), dtype=np.int64)
    counts[:, :5] = np.random.default_rng(5).multinomial(1000, rows)
    matrix = TransitionMatrix(bracket, counts)
    found = texts(transition_figure(matrix, part('l_bracket'), 'a kick'))
    numbers = [
        float(words) for words in found if '.' in words and words.replace('.', '').isdigit()
    ]
    shares = matrix.transitions[matrix.transitions > 0]
    assert sorted(numbers) == pytest.approx(sorted(100 * shares), abs=0.051)
    assert sum('–' in words for words in found) == 5 * 5


def test_curves_of_a_class_are_added_up_in_one_line(box, part, texts):
    curves = [curve_of([0, 20, 40, 80 + k], aspect=k) for k in range(1, 7)]
    lines = retention_lines(curves, box)
    assert [[aspect.id for aspect in members] for _, members in lines] == [[1, 2], [3, 4], [5, 6]]
    assert lines[0][0].probability.tolist() == [0, 0.05, 0.1, (81 + 82) / 800]
    found = texts(retention_figure(curves, box, part('box_10x20x30'), 'a kick'))
    assert {'aspects 1 and 2', 'barrier 1.50 mm'} <= set(found)


@pytest.mark.filterwarnings('error')
def test_curve_without_a_barrier_or_any_loss(bracket, texts):
    curve = curve_of([0, 0, 0, 0], np.inf)
    assert 'no barrier' in texts(retention_figure([curve], bracket, None, 't'))
