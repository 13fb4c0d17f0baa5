"""Two distributions side by side, in 80 columns and in JSON, are what was compared."""

import json
import re
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from scipy.stats import binomtest, chi2_contingency

from resting_aspects_ros.report.comparison import (
    ComparedResults,
    comparison_document,
    comparison_table,
    measures_text,
    verdict,
)
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.statistics.comparison import Comparison, DropCounts, compare

# Shares .5 .3 .2 and .4 .2 .4, of the drops in an aspect.
ONE = DropCounts(np.array([50, 30, 20]), 60, 30, 10)
OTHER = DropCounts(np.array([80, 40, 80]), 0, 50, 0)
DOWN = np.array([[0, 0, -1.0], [0.6, -0.8, -0.0], [np.nan] * 3])


def compared(a, b, down=None, ids=None, confidence=0.95):
    sides = ComparedResults(ids or tuple(range(1, len(a.counts) + 1)), down, a, b)
    return compare(a, b, np.random.default_rng(1), confidence), sides


def lines(comparison, sides, title='title'):
    console = Console(width=80, force_terminal=False)
    with console.capture() as captured:
        console.print(comparison_table(comparison, sides, title))
    return captured.get().splitlines()


def cells(shown):
    return [re.split(r' {2,}', line.strip()) for line in shown]


def test_table_has_a_row_for_each_aspect_and_outcome():
    shown = cells(lines(*compared(ONE, OTHER, DOWN, ids=(1, 3, 7)), '[A]\n[B]'))
    assert shown[:2] == [['[A]'], ['[B]']]
    # Intervals of 50, 30 and 20 of 100 are Wilson's.
    wilson = [binomtest(k, 100).proportion_ci(method='wilson') for k in (50, 30, 20)]
    texts = [f'{100 * each.low:.0f} to {100 * each.high:.0f}' for each in wilson]
    assert [row[:5] for row in shown[5:8]] == [
        ['1', '0.00', '0.00 -1.00', '50.0', texts[0]],
        ['3', '+0.60 -0.80', '0.00', '30.0', texts[1]],
        ['7', 'rolls', '20.0', texts[2], '40.0'],
    ]
    assert [row[-2] for row in shown[5:8]] == ['+10.0', '+10.0', '-20.0']
    assert [row[:2] for row in shown[9:12]] == [
        ['unclassified', '30'],
        ['unsettled', '15.0'],
        ['failed', '5.0'],
    ]
    assert [row[-1] for row in shown[9:12]] == ['0', '20.0', '0']
    assert len(shown) == 12


def test_measures_match_manual_values():
    comparison, sides = compared(ONE, OTHER, ids=(1, 3, 7))
    text = measures_text(comparison, sides)
    assert max(map(len, text.splitlines())) <= 80
    assert re.search(r'^total variation +20 %$', text, re.MULTILINE)
    assert re.search(
        r'^largest deviation +-20 % in aspect 7 \(-\d+ to -\d %\)$', text, re.MULTILINE
    )
    assert re.search(r'^mean absolute deviation +13.3 % over aspects$', text, re.MULTILINE)
    p = chi2_contingency([[50, 30, 20], [80, 40, 80]], correction=False).pvalue
    assert re.search(rf'^p value +{p:.2g} by chi-square$', text, re.MULTILINE)
    assert re.search(r'^drops in aspects +A 100 of 200, B 200 of 250$', text, re.MULTILINE)
    assert 'others: of all drops' in text


@given(st.data(), st.sampled_from([30, 1000, 10**6]))
def test_shown_difference_is_that_of_the_shown_shares(data, most):
    row = st.lists(st.integers(0, most), min_size=3, max_size=3).filter(any).map(np.array)
    shown = lines(*compared(DropCounts(data.draw(row)), DropCounts(data.draw(row)), DOWN))
    pattern = r'^ +\d .*? ([\d.]+)  +[\d.]+ to [\d.]+ +([\d.]+) +([+-][\d.]+) +[+-]'
    found = [match.groups() for line in shown if (match := re.match(pattern, line))]
    assert len(found) == 3
    for first, second, difference in found:
        assert Decimal(first) - Decimal(second) == Decimal(difference)


def test_equal_counts_have_no_deviation():
    comparison, sides = compared(ONE, ONE)
    assert all(row[-2] == '+0.0' for row in cells(lines(comparison, sides))[4:7])
    text = measures_text(comparison, sides)
    assert re.search(r'total variation +0 %', text)
    assert re.search(r'largest deviation +\+0 % in aspect 1 ', text)
    assert re.search(r'p value +1 by chi-square', text)


def test_missing_directions_have_no_heading():
    shown = lines(*compared(ONE, OTHER))
    assert not any('down in part' in line for line in shown)
    assert cells(shown)[4][:2] == ['1', '50.0']


@pytest.mark.parametrize('factor', [1, 1000, 50_000])
@pytest.mark.parametrize('confidence', [0.95, 0.9999])
def test_table_fits_80_columns_for_any_number_of_drops(factor, confidence):
    one = DropCounts(factor * np.array([900, 12, 3, *[1] * 17]), factor, factor, factor)
    other = DropCounts(factor * np.array([300, 612, 4, *[1] * 17]), factor, factor, factor)
    down = np.tile([-0.55, -0.83, -0.1], (20, 1))
    comparison, sides = compared(one, other, down, confidence=confidence)
    shown = lines(comparison, sides)
    text = measures_text(comparison, sides).splitlines()
    assert max(map(len, [*shown, *text])) <= 80
    assert '…' not in ''.join(shown)
    rows = [line for line in shown if re.match(r' *\d+  -0.55', line)]
    assert len(rows) == 20
    assert all(row.isascii() for row in rows)


def test_share_of_100_percent_fits_80_columns():
    one, other = DropCounts(np.array([2_000_000, 0])), DropCounts(np.array([1_000_000, 1_000_000]))
    down = np.tile([-0.55, -0.83, -0.1], (2, 1))
    shown = lines(*compared(one, other, down))
    assert max(map(len, shown)) <= 80
    assert '100.00  100.0 to 100.0  50.00  +50.00' in re.sub(r' {2,}', '  ', shown[4])


def test_document_is_complete_and_not_rounded():
    comparison, sides = compared(ONE, OTHER, DOWN, ids=(1, 3, 7))
    document = comparison_document(comparison, sides, {'a': {'file': 'x'}, 'b': {'file': 'y'}})
    assert json.loads(to_json(document)) == document
    assert document['a'] == {'file': 'x', 'unclassified': 60, 'unsettled': 30, 'failed': 10}
    assert document['b'] == {'file': 'y', 'unclassified': 0, 'unsettled': 50, 'failed': 0}
    aspects = document['aspects']
    assert [aspect['id'] for aspect in aspects] == [1, 3, 7]
    assert [aspect['down_in_part'] for aspect in aspects] == [[0, 0, -1], [0.6, -0.8, 0], None]
    assert [aspect['a']['count'] for aspect in aspects] == [50, 30, 20]
    assert [aspect['b']['share'] for aspect in aspects] == [0.4, 0.2, 0.4]
    for k, aspect in enumerate(aspects):
        assert aspect['deviation'] == comparison.deviation[k]
        assert aspect['deviation_lower'] == comparison.lower[k]
        assert aspect['deviation_upper'] == comparison.upper[k]
        ours = aspect['a']['lower'], aspect['a']['upper']
        theirs = binomtest(int(ONE.counts[k]), 100).proportion_ci(method='wilson')
        assert ours == pytest.approx((theirs.low, theirs.high))
    assert document['largest_deviation'] == {
        'aspect': 7,
        'deviation': comparison.largest_deviation,
        'lower': comparison.lower[2],
        'upper': comparison.upper[2],
    }
    assert document['total_variation'] == pytest.approx(0.2)
    assert document['mean_deviation'] == pytest.approx(0.4 / 3)
    assert (document['p_value'], document['p_by']) == (comparison.p_value, 'chi-square')


@pytest.mark.parametrize(
    ('deviation', 'margin', 'expected'),
    [
        (
            [0.1, -0.06, -0.04],
            0.05,
            'They differ by 10 points in class 1 (95 % interval 5 to 15; p = 0.01).',
        ),
        # The class with the largest difference is named only if its interval does not contain 0.
        ([0.1, -0.06, -0.04], [0.2, 0.05, 0.05], 'They differ by 6 points in class 2 (95 %'),
        ([0.1, -0.06, -0.04], 0.12, 'They differ significantly (p = 0.01), but no single class'),
    ],
)
def test_verdict_names_a_class_that_differs(deviation, margin, expected):
    deviation, margin = np.array(deviation), np.array(margin)
    first = np.array([0.5, 0.3, 0.2])
    found = Comparison(
        first, first - deviation, deviation - margin, deviation + margin, 0.95, 0.01, 'chi-square'
    )
    text = verdict(found, ['class 1', 'class 2', 'class 3'])
    assert text.startswith(expected)
