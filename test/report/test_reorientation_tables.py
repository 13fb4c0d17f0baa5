"""Tables of long-run shares, wanted aspects, plans and retention, in 80 columns."""

import numpy as np
import pytest
from rich.console import Console

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.transitions import (
    long_run_table,
    long_run_text,
    plan_table,
    retention_table,
    table_rows,
    wanted_table,
)
from resting_aspects_ros.statistics.markov import Plan, long_run, reach
from resting_aspects_ros.statistics.transitions import RetentionCurve

DROP = np.array([0.5, 0.25, 0.125, 0.1, 0.025])


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


def test_long_run_shares_are_beside_those_of_a_drop(rows):
    transitions = np.roll(np.eye(5), 1, axis=1)
    found = long_run(transitions, np.zeros(5), DROP)
    shares = found.shares
    first, *_, last = body(long_run_table(rows, found, shares - 0.02, shares + 0.01, DROP, 't'))
    assert ' '.join(first) == '1 20.0 % 18.0 to 21.0 % 50.0 %'
    assert ' '.join(last) == '5 20.0 % 18.0 to 21.0 % 2.5 %'
    assert long_run_text(rows, found) == ''


def test_long_run_rows_can_be_classes(part):
    aspects = find_aspects(part('box_10x20x30'))
    classes = table_rows(aspects, by_class=True)
    found = long_run(np.full((3, 3), 1 / 3), np.zeros(3), DROP[:3])
    text = body(long_run_table(classes, found, np.zeros(3), np.ones(3), DROP[:3], 't'))
    assert [' '.join(row[:3]) for row in text] == ['1 and 2', '3 and 4', '5 and 6']


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


@pytest.mark.parametrize(
    ('probability', 'text'), [(1 - 1e-12, '100 %'), (0.9999, '> 99.9 %'), (0.0004, '0.04 %')]
)
def test_only_certainty_is_100_percent(rows, probability, text):
    row = np.full(1, probability)
    (cells,) = body(wanted_table(rows[:1], row < 0, row, np.array([1234.5]), 't'))
    assert ' '.join(cells[1:]) == f'{text} 1234'


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


def curve(aspect=1, barrier=0.0015, left=(0, 20, 40, 80), parts=400):
    lift = np.array([0.001, 0.002, 0.004, 0.02])
    return RetentionCurve(aspect, barrier, lift, np.array(left), np.full(4, parts), 0.95)


def test_retention_has_lift_heights_with_intervals():
    value, interval, *_ = body(retention_table([curve()], 't', 9.81))
    assert value[:5] == ['1', '1.50', '0.172', '1.20', '4.00']
    low, high = (1000 * end for end in curve().lift_interval(0.01))
    assert interval[:3] == [f'{low:#.3g}', 'to', f'{high:#.3g}']


def test_level_that_is_not_reached_is_stated():
    value, limit, *_ = body(retention_table([curve()], 't', 9.81))
    assert value[-2:] == ['not', 'reached']
    assert limit[-4:] == ['up', 'to', '20', 'mm']


def test_interval_without_an_end_has_its_lower_bound():
    rows_of_cell = body(retention_table([curve(left=(0, 10, 50, 195))], 't', 9.81))
    lower, upper = curve(left=(0, 10, 50, 195)).lift_interval(0.5)
    assert np.isnan(upper)
    assert rows_of_cell[1][-4:] == ['up', 'to', '20', 'mm']
    assert rows_of_cell[2][-3:] == ['at', 'least', f'{1000 * lower:#.3g}']


def test_only_aspect_has_no_barrier_in_the_table():
    many = [curve(k, np.inf if k == 1 else 0.00811 * k) for k in range(1, 31)]
    found = [row for row in body(retention_table(many, 't', 9.81)) if row[0].isdigit()]
    assert [row[:2] for row in found[:1] + found[-1:]] == [['1', '-'], ['30', '243']]
