"""Two distributions side by side, as a table and as a document, are what was compared."""

import dataclasses
import json
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.report.comparison import (
    ComparedResults,
    comparison_document,
    comparison_table,
)
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.statistics.comparison import DropCounts, compare
from resting_aspects_ros.statistics.model_range import ModelRange

# Shares .5 .3 .2 and .4 .2 .4, of the drops in an aspect.
ONE = DropCounts(np.array([50, 30, 20]), 60, 30, 10)
OTHER = DropCounts(np.array([80, 40, 80]), 0, 50, 0)


def compared(a, b, ids=None):
    ids = ids or tuple(range(1, len(a.counts) + 1))
    sides = ComparedResults(ids, tuple(map(str, ids)), a, b)
    return compare(a, b, np.random.default_rng(1), 0.95), sides


@given(st.data(), st.sampled_from([30, 1000, 10**6]))
def test_shown_difference_is_that_of_the_shown_shares(data, most):
    row = st.lists(st.integers(0, most), min_size=3, max_size=3).filter(any).map(np.array)
    both = compared(DropCounts(data.draw(row)), DropCounts(data.draw(row)))
    found = [row for row in comparison_table(*both, 'title').rows if row[0] in '123']
    assert len(found) == 3
    for _, first, _, second, difference, _ in found:
        assert Decimal(first) - Decimal(second) == Decimal(difference)


def test_document_is_not_rounded():
    comparison, sides = compared(ONE, OTHER, ids=(1, 3, 7))
    document = comparison_document(comparison, sides, {'a': {'file': 'x'}, 'b': {'file': 'y'}})
    assert json.loads(to_json(document)) == document
    rest = {'unclassified': 60, 'unsettled': 30, 'failed': 10}
    assert document['a'] == {'file': 'x', **rest, 'model_uncertain': None}
    aspects = document['aspects']
    assert [aspect['id'] for aspect in aspects] == [1, 3, 7]
    assert [aspect['b']['share'] for aspect in aspects] == [0.4, 0.2, 0.4]
    for field, values in (
        ('deviation', comparison.deviation),
        ('deviation_lower', comparison.lower),
        ('deviation_upper', comparison.upper),
    ):
        assert [aspect[field] for aspect in aspects] == values.tolist()
    assert document['largest_deviation']['aspect'] == 7
    assert document['total_variation'] == pytest.approx(0.2)
    assert document['mean_deviation'] == pytest.approx(0.4 / 3)


def test_model_ranges_of_one_side_are_shown_in_80_columns(lines):
    comparison, sides = compared(ONE, OTHER)
    bounds = np.array([[0.123, 0.567], [0.0, 1.0], [0.004, 0.095]])
    models = (None, ModelRange(bounds, bounds, ('friction',)))
    sides = dataclasses.replace(sides, models=models)
    shown = '\n'.join(lines(comparison_table(comparison, sides, 'title')))
    for text in ('12 to 57', '0 to 100', '0.4 to 9.5'):
        assert shown.count(text) == 1
    document = comparison_document(comparison, sides, {'a': {}, 'b': {}})
    assert [document[name]['model_uncertain'] for name in 'ab'] == [None, ['friction']]
    for row, expected in zip(document['aspects'], bounds.tolist(), strict=True):
        assert [row['b']['model_lower'], row['b']['model_upper']] == expected
        assert row['a']['model_lower'] is None
