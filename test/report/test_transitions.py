"""The table of a transition matrix says what the matrix is, in 80 columns."""

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.transitions import (
    long_run_text,
    table_rows,
    transition_table,
    wanted_table,
)
from resting_aspects_ros.statistics.markov import long_run, reach
from resting_aspects_ros.statistics.transitions import TransitionMatrix


@pytest.fixture(scope='module')
def bracket(part):
    return find_aspects(part('l_bracket'))


def body(found):
    """The lines between the rule below the headings and the caption."""
    rule = next(k for k, line in enumerate(found) if set(line.strip()) == {'─'})
    end = next(k for k, line in enumerate(found) if 'Below each' in line)
    assert all(line.isascii() for line in found[rule + 1 :])
    return [line.split() for line in found[rule + 1 : end] if line]


def test_intervals_are_below_the_probabilities(bracket, lines):
    counts = np.full((5, 9), 0)
    counts[:, :5] = [[600, 200, 100, 100, 0]]
    lower, upper = TransitionMatrix(bracket, counts).bounds()
    found = body(lines(transition_table(TransitionMatrix(bracket, counts), False, '')))
    assert found[0] == ['1', '60.0', '20.0', '10.0', '10.0', '0', '1000']
    ends = zip(lower[0, :5].tolist(), upper[0, :5].tolist(), strict=True)
    for text, (low, high) in zip(found[1], ends, strict=True):
        first, last = map(float, text.split('-'))
        assert first == pytest.approx(100 * low, abs=0.051)
        assert last == pytest.approx(100 * high, abs=0.051)


def test_closed_classes_and_unreached_aspects_are_named(bracket):
    rows = table_rows(bracket, by_class=False)
    transitions = np.zeros((5, 5))
    transitions[[0, 1, 2, 2, 3, 4], [1, 0, 2, 2, 2, 3]] = 1
    transitions[3] = [0.25, 0, 0.75, 0, 0]
    found = long_run(transitions, np.zeros(5), np.array([0.0, 0, 0, 1, 0]))
    text = long_run_text(rows, found).splitlines()
    assert text[2:] == [
        '  1: aspects 1 and 2, in which 25.0 % of parts end',
        '  2: aspect 3, in which 75.0 % of parts end',
        'Estimated as 0, because no simulated action led back there: aspect 4.',
        'No simulated drop and no action led to aspect 5.',
    ]


def test_way_to_wanted_aspects_has_never_and_certainty(bracket):
    rows = table_rows(bracket, by_class=False)
    transitions = np.zeros((5, 5))
    transitions[0, 0] = 1
    transitions[1, [0, 1]] = 0.5
    transitions[2, [0, 3]] = 0.25, 0.75
    transitions[3, 3] = 1
    transitions[4, [0, 1]] = 0.0001, 0.9899
    wanted = np.arange(5) == 0
    table = wanted_table(rows, wanted, *reach(transitions, wanted), 't')
    assert [' '.join(row) for row in table.rows] == [
        '1 wanted 0',
        '2 100.0 % 2.00',
        '3 25.0 % 1.00',
        '4 0.0 % never',
        '5 99.0 % 3.00',
    ]
