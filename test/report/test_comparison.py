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
)
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.statistics.comparison import DropCounts, compare

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
