"""The items of the pages on transitions and retention have the numbers of the results."""

import re

import numpy as np
import pytest

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.pages import reorientation_page, retention_page
from resting_aspects_ros.api.reorient import PlanResult, ReorientResult
from resting_aspects_ros.api.retention import RetentionResult
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.report.transitions import matrix_fields, retention_fields
from resting_aspects_ros.simulation.actions import Kick, NamedAction
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.markov import Plan
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix

RUN = RunDescription(
    '0' * 16, 'box', 64 * 'a', shipped_surfaces().get(''), 1, 0, 400, 0.0, 'kernel', '1',
    '0', 1e-4, 0,
)  # fmt: skip
LIFT = np.array([0.001, 0.002, 0.005, 0.02])


def items_of(page):
    """Return the items of all sections."""
    return [item for section in page.sections for item in section.items]


def rows_of(page, *first):
    """Return the rows of each table whose first headings are these."""
    tables = [item for item in items_of(page) if isinstance(item, Table)]
    headings = [[' '.join(each.split()) for each in table.headings] for table in tables]
    pairs = zip(tables, headings, strict=True)
    return [table.rows for table, names in pairs if names[: len(first)] == list(first)]


def assert_shown(cell, *values):
    """The numbers in a cell are the values, to half a unit of their last digits."""
    shown = re.findall(r'\d+(?:\.\d+)?', cell)
    assert len(shown) == len(values), cell
    for number, value in zip(shown, values, strict=True):
        half = 0.5001 / 10 ** len(number.partition('.')[2])
        assert float(number) == pytest.approx(value, abs=half), cell


def result_of(part, name, aspects, counts, drops):
    action = NamedAction(name, Kick(speed=0.3), source='Assumed.')
    drop = Distribution(aspects, np.array(drops), 0, 0, 0)
    return ReorientResult(TransitionMatrix(aspects, counts), action, RUN, part, drop, True)


@pytest.fixture(scope='module')
def results(crate):
    """Two actions on a box, the second without long-run shares."""
    aspects = find_aspects(crate)
    generator = np.random.default_rng(7)
    counts = generator.multinomial(400, generator.dirichlet(np.full(10, 0.5), 6))
    counts[:, 6:9] = 0
    few = np.zeros_like(counts)
    few[0, 0] = 5
    drops = [40, 40, 8, 7, 3, 2]
    return [
        result_of(crate, 'tap', aspects, counts, drops),
        result_of(crate, 'toss', aspects, few, drops),
    ]


@pytest.fixture(scope='module')
def page(results):
    plan = Plan(np.array([-1, -1, 0, 1, 0, -1]), np.array([0, 0, 1.25, 2.5, 8, np.inf]))
    return reorientation_page(
        results, wanted=(2, 1), plan=PlanResult(('tap', 'toss'), (1, 2), plan)
    )


def test_matrix_cells_match_the_document(page, results):
    fields = matrix_fields(results[0].matrix)['classes']
    rows, none = rows_of(page, 'from', 'to 1 and 2 (%)')
    assert len(rows) == len(none) == len(fields['counts'])
    k = len(rows)
    columns = [*range(k), k + 3]  # no drop is unclassified, unsettled or failed
    for i, (_, *cells, actions) in enumerate(rows):
        assert int(actions) == fields['actions'][i]
        for cell, j in zip(cells, columns, strict=True):
            values = [100 * fields[name][i][j] for name in ('probability', 'lower', 'upper')]
            assert_shown(cell, *values)
    assert [row[1] for row in none[1:]] == ['-'] * (k - 1)  # the second action: no simulation


def test_page_has_the_way_and_the_plan(page, results):
    (rows,) = rows_of(page, 'from', 'reaches a wanted aspect')
    assert rows[0] == ['1 and 2', 'wanted', '0']
    probability, actions = results[0].by_class().reach((1,))
    for (_, *cells), p, n in zip(rows[1:], probability[1:], actions[1:], strict=True):
        assert_shown(cells[0], 100 * p)
        assert_shown(cells[1], n)
    (rows,) = rows_of(page, 'aspect', 'best action')
    assert [row[1:] for row in rows] == [
        ['wanted', '0'], ['wanted', '0'], ['tap', '1.25'], ['toss', '2.50'], ['tap', '8.00'],
        ['-', 'never'],
    ]  # fmt: skip


def test_retention_matches_the_document(crate, results):
    aspects = results[0].matrix.aspects
    curves = [
        RetentionCurve(a.id, a.min_barrier, LIFT, np.array([0, 3, 50, 90]), np.full(4, 100), 0.95)
        for a in aspects
    ]
    # No other aspect can be reached from the last one, and half of its parts never leave.
    curves[-1] = RetentionCurve(6, np.inf, LIFT, np.array([0, 3, 4, 20]), np.full(4, 100), 0.95)
    page = retention_page(RetentionResult(tuple(curves), aspects, RUN, crate, True))
    (levels,) = rows_of(page, 'aspect', 'barrier (mm)')
    for k, curve in enumerate(curves):
        fields = retention_fields(curve)
        assert int(levels[k][0]) == curve.aspect
        if fields['barrier'] is None:
            assert levels[k][1] == '-'
        else:
            assert float(levels[k][1]) == pytest.approx(1000 * fields['barrier'], rel=0.005)
        for cell, each in zip(levels[k][3:], fields['levels'], strict=True):
            if each['lift'] is None:
                assert 'not reached' in cell
            else:
                assert float(cell.split()[0]) == pytest.approx(1000 * each['lift'], rel=0.005)
