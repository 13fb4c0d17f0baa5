"""Complete outputs, compared with files: tables of fixed counts, and the words of a page.

After an intended change, run the test with UPDATE_GOLDEN=1 and read the difference.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from resting_aspects_ros.api.outlines import outlines
from resting_aspects_ros.aspects.estimate import METHODS, RestingShape, estimate_each
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.comparison import (
    ComparedResults,
    comparison_table,
    measures_text,
    verdict,
)
from resting_aspects_ros.report.drift import drift_notes, drift_sentence, live_table, window_table
from resting_aspects_ros.report.drops import (
    aspect_table,
    distribution_table,
    estimate_table,
    legend,
    never_seen_text,
)
from resting_aspects_ros.report.outlines import confused_class_texts, outline_table
from resting_aspects_ros.report.transitions import (
    actions_table,
    long_run_table,
    long_run_text,
    plan_table,
    retention_counts_table,
    retention_table,
    table_rows,
    transition_table,
    wanted_table,
)
from resting_aspects_ros.statistics.comparison import DropCounts, compare
from resting_aspects_ros.statistics.counted_parts import LiveCounts, ObservedCounts
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.drift import find_drift
from resting_aspects_ros.statistics.markov import best_plan, long_run, reach, with_replacement
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix

GOLDEN = Path(__file__).parent / 'golden'


def check(name, *parts):
    """Compare what a terminal of 80 columns shows of tables and sentences with a file."""
    console = Console(width=80, force_terminal=False, color_system=None)
    with console.capture() as captured:
        for part in parts:
            console.print(part, markup=False, highlight=False)
    text = '\n'.join(line.rstrip() for line in captured.get().splitlines()) + '\n'
    path = GOLDEN / name
    if os.environ.get('UPDATE_GOLDEN'):
        path.write_text(text, encoding='utf-8')
    assert text == path.read_text(encoding='utf-8')


@pytest.fixture(scope='module')
def nut(part):
    return find_aspects(part('hex_nut'))


def test_distribution(part, nut):
    found = Distribution(nut, np.array([390, 401, 40, 30, 29, 41, 35, 0]), 20, 9, 5)
    check(
        'distribution.txt',
        distribution_table(found, 'hex_nut, 1000 drops', part('hex_nut')),
        distribution_table(found, 'hex_nut, 1000 drops', part('hex_nut'), each=True),
        never_seen_text(found, each=True),
        aspect_table(nut, part('hex_nut'), 'hex_nut'),
        aspect_table(nut, part('hex_nut'), 'hex_nut', each=True),
    )


def test_estimates(part):
    bracket = part('l_bracket')
    aspects = find_aspects(bracket)
    estimates, _ = estimate_each(RestingShape(bracket, aspects), METHODS)
    rows = [(aspect,) for aspect in aspects]
    shares = {name: each.probabilities for name, each in estimates.items()}
    tally = DropCounts(np.array([300, 260, 200, 130, 90]), 20, 0, 0)
    rng = np.random.default_rng(1)
    deviations = {
        name: compare(tally, DropCounts(np.round(1e5 * p).astype(int)), rng)
        for name, p in shares.items()
    }
    check(
        'estimates.txt',
        estimate_table(bracket, rows, shares, 'l_bracket'),
        estimate_table(bracket, rows, shares, 'against drops', tally, deviations),
        '\n'.join(legend(METHODS)),
    )


def test_comparison():
    one = DropCounts(np.array([500, 300, 200]), 60, 30, 10)
    other = DropCounts(np.array([80, 40, 80]), 0, 50, 0)
    down = np.array([[0, 0, -1.0], [0.6, -0.8, 0.0], [np.nan] * 3])
    sides = ComparedResults((1, 3, 7), down, one, other)
    found = compare(one, other, np.random.default_rng(1))
    check(
        'comparison.txt',
        comparison_table(found, sides, 'A: one\nB: other'),
        measures_text(found, sides),
        verdict(found, ['aspect 1', 'aspect 3', 'aspect 7']),
    )


def test_drift():
    rows = np.array([[50, 30, 20]] * 4 + [[25, 45, 30]] * 3)
    groups = ((1,), (2,), (3, 4))
    observed = ObservedCounts.of_rows(rows, 'counts', groups, ())
    found = find_drift(observed, np.array([500, 300, 200]), 100, np.random.default_rng(1), 0.01)
    live = LiveCounts((1, 2, 3), np.array([500, 300, 200]), rows.sum(axis=0))
    check(
        'drift.txt',
        drift_sentence(found),
        window_table(found, '700 parts'),
        live_table(found, live),
        drift_notes(found, 0.05, 280),
    )


def test_transitions(nut):
    generator = np.random.default_rng(7)
    weights = 0.3 + 2 * np.eye(8, 12)
    counts = np.array([generator.multinomial(200, generator.dirichlet(row)) for row in weights])
    matrix = TransitionMatrix(nut, counts)
    rows = table_rows(nut, by_class=False)
    drop = np.array([0.39, 0.4, 0.04, 0.03, 0.03, 0.04, 0.04, 0.03])
    found = long_run(matrix.transitions, matrix.left, drop)
    wanted = np.arange(8) < 2
    chain = with_replacement(matrix.transitions, matrix.left, drop)
    plan = best_plan(chain[None], np.array([0.5]), wanted)
    bounds = 0.9 * found.shares, 1.1 * found.shares
    lift = np.array([0.001, 0.002, 0.005, 0.02])
    curves = [
        RetentionCurve(k, barrier, lift, np.array(left), np.full(4, 100), 0.95)
        for k, barrier, left in ((1, 0.004, [0, 3, 50, 90]), (2, np.inf, [0, 0, 0, 2]))
    ]
    check(
        'transitions.txt',
        transition_table(matrix, False, 'by aspect'),
        transition_table(matrix, True, 'by class'),
        long_run_table(rows, found, *bounds, drop, 'repeated'),
        long_run_text(rows, found),
        wanted_table(rows, wanted, *reach(matrix.transitions, wanted), 'the way'),
        actions_table(rows, drop, {'tap': found.shares}, wanted, 'by action'),
        plan_table(rows, plan, ['tap'], 'best plan'),
        retention_table(curves, 'retention', 9.81),
        retention_counts_table(curves, 'counts'),
    )


@pytest.mark.slow
def test_outlines(part):
    found = outlines(part('l_bracket'))
    check(
        'outlines.txt',
        outline_table(found.outlines, found.look_alikes, found.aspects, 'l_bracket'),
        *confused_class_texts(found.outlines, found.look_alikes),
    )
