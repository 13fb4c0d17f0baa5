"""Tables of long-run shares, wanted aspects, plans and retention, in 80 columns."""

import numpy as np
import pytest
from rich.console import Console

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.transitions import (
    long_run_table,
    long_run_text,
    plan_table,
    table_rows,
    wanted_table,
)
from resting_aspects_ros.statistics.markov import Plan, long_run, reach


@pytest.fixture(scope='module')
def rows(part):
    return table_rows(find_aspects(part('l_bracket')), by_class=False)


def body(table):
    """The rows below the headings, as lists of words; no line is longer than 80."""
    console = Console(width=1000, force_terminal=False)
    with console.capture() as captured:
        console.print(table)
    found = captured.get().splitlines()
    assert max(len(line.rstrip()) for line in found) <= 80
    rule = next(k for k, line in enumerate(found) if set(line.strip()) == {'─'})
    assert all(line.isascii() for line in found[rule + 1 :])
    return [line.split() for line in found[rule + 1 :] if line.strip()]


def test_closed_classes_and_unreached_aspects_are_marked(rows):
    transitions = np.zeros((5, 5))
    transitions[[0, 1, 2, 2, 3, 4], [1, 0, 2, 2, 2, 3]] = 1
    transitions[3] = [0.25, 0, 0.75, 0, 0]
    found = long_run(transitions, np.zeros(5), np.array([0.0, 0, 0, 1, 0]))
    table = long_run_table(rows, found, np.zeros(5), np.ones(5), found.shares, 't')
    marks = [' '.join(row[9:]) for row in body(table)]
    assert marks == ['1', '1', '2', 'none', 'not reached']
    text = long_run_text(rows, found).splitlines()
    assert text[2:] == [
        '  1: aspects 1 and 2, in which 25.0 % of parts end',
        '  2: aspect 3, in which 75.0 % of parts end',
        'Estimated as 0, because no simulated action led back there: aspect 4.',
        'No simulated drop and no action led to aspect 5.',
    ]


def test_way_to_wanted_aspects_has_never_and_certainty(rows):
    transitions = np.zeros((5, 5))
    transitions[0, 0] = 1
    transitions[1, [0, 1]] = 0.5
    transitions[2, [0, 3]] = 0.25, 0.75
    transitions[3, 3] = 1
    transitions[4, [0, 1]] = 0.0001, 0.9899
    wanted = np.arange(5) == 0
    table = wanted_table(rows, wanted, *reach(transitions, wanted), 't')
    assert [' '.join(row) for row in body(table)] == [
        '1 wanted 0',
        '2 100 % 2.00',
        '3 25.0 % 1.00',
        '4 0 % never',
        '5 99.0 % 3.00',
    ]


def test_plan_names_the_action_of_each_aspect(rows):
    plan = Plan(np.array([-1, 1, 0, -1, 1]), np.array([0, 1.5, 0.25, np.inf, 120.4]))
    found = body(plan_table(rows, plan, ['tap', 'shake hard'], 'a long title ' * 6))
    assert [' '.join(row) for row in found] == [
        '1 wanted 0',
        '2 shake hard 1.50',
        '3 tap 0.250',
        '4 - never',
        '5 shake hard 120',
    ]
