"""Two distributions side by side, and clusters of poses, as tables and as documents."""

import dataclasses
import json
from decimal import Decimal

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.clusters import Clusters
from resting_aspects_ros.report.comparison import (
    ComparedResults,
    cluster_table,
    comparison_document,
    comparison_table,
)
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.statistics.comparison import DropCounts, compare
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.model_range import ModelRange

# Shares .5 .3 .2 and .4 .2 .4, of the drops in an aspect.
ONE = DropCounts(np.array([50, 30, 20]), 60, 30, 10)
OTHER = DropCounts(np.array([80, 40, 80]), 0, 50, 0)


def compared(a, b):
    found = compare(a, b, np.random.default_rng(1), 0.95)
    return ComparedResults((1, 3, 7), ('1', '3', '7'), a, b, found)


@given(st.data(), st.sampled_from([30, 1000, 10**6]))
def test_shown_difference_is_that_of_the_shown_shares(data, most):
    row = st.lists(st.integers(0, most), min_size=3, max_size=3).filter(any).map(np.array)
    both = compared(DropCounts(data.draw(row)), DropCounts(data.draw(row)))
    found = comparison_table(both, 'title').rows
    assert len(found) == 3
    for _, first, _, second, difference, _ in found:
        assert Decimal(first) - Decimal(second) == Decimal(difference)


def test_document_is_not_rounded_and_ranges_are_shown_in_80_columns(lines):
    bounds = np.array([[0.123, 0.567], [0.0, 1.0], [0.004, 0.095]])
    models = (None, ModelRange(bounds, bounds, ('friction',)))
    sides = dataclasses.replace(compared(ONE, OTHER), models=models)
    comparison = sides.comparison
    shown = '\n'.join(lines(comparison_table(sides, 'title')))
    for text in ('12 to 57', '0 to 100', '0.4 to 9.5'):
        assert shown.count(text) == 1
    document = comparison_document(sides, {'a': {'file': 'x'}, 'b': {}})
    assert json.loads(to_json(document)) == document
    rest = {'unclassified': 60, 'unsettled': 30, 'failed': 10}
    assert document['a'] == {'file': 'x', **rest, 'model_uncertain': None}
    assert document['b']['model_uncertain'] == ['friction']
    for k, row in enumerate(document['aspects']):
        assert (row['id'], row['b']['share']) == ((1, 3, 7)[k], (0.4, 0.2, 0.4)[k])
        assert row['deviation'] == comparison.deviation[k]
        assert row['deviation_lower'] == comparison.lower[k]
        assert row['deviation_upper'] == comparison.upper[k]
        assert [row['b']['model_lower'], row['b']['model_upper']] == bounds[k].tolist()
        assert row['a']['model_lower'] is None
    assert document['largest_deviation']['aspect'] == 7


def test_largest_clusters_have_rows_and_the_rest_share_one():
    counts = [2_000_000, *range(1020, 1001, -1), 7, 7, 7]
    down = np.tile([0, 0.6, -0.8], (len(counts), 1))
    clusters = Clusters(np.zeros(0, int), np.array(counts), down, np.ones(len(counts)))
    found = Distribution(AspectSet('', ()), clusters.counts, 0, 5, 0)
    rows = cluster_table(found, clusters, 'title').rows
    assert [(row[0], row[-1]) for row in rows[:20]] == [
        (str(k), str(count)) for k, count in enumerate(counts[:20], start=1)
    ]
    ends = ('3 more', '21'), ('unsettled', '5'), ('poses in total', str(sum(counts) + 5))
    assert tuple((row[1], row[-1]) for row in rows[20:]) == ends
