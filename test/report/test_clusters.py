"""Tables of clusters, and of aspects beside them."""

import re

import numpy as np
import pytest

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.clusters import (
    Clusters,
    find_agreement,
    find_clusters,
    find_differences,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.comparison import agreement_line, cluster_table
from resting_aspects_ros.statistics.distribution import Distribution


def test_largest_clusters_have_rows_and_the_rest_share_one(lines):
    counts = [2_000_000, *range(1020, 1001, -1), 7, 7, 7]
    down = np.tile([0, 0.6, -0.8], (len(counts), 1))
    clusters = Clusters(np.zeros(0, int), np.array(counts), down, np.ones(len(counts)))
    found = Distribution(AspectSet('', ()), clusters.counts, 0, 5, 0)
    shown = lines(cluster_table(found, clusters, '[a] title'))
    assert shown[0] == '[a] title'
    rows = [re.match(r' *(\d+)  [-+ ]\d.* (\d+)$', line) for line in shown]
    expected = list(enumerate(counts[:20], start=1))
    assert [(int(row[1]), int(row[2])) for row in rows if row] == expected
    text = '\n'.join(shown)
    assert '3 more' in text
    assert re.search(r'unsettled .* 5$', text, re.MULTILINE)
    assert re.search(rf'poses in total +{sum(counts) + 5}$', text)


@pytest.mark.parametrize(('ids', 'agree', 'near'), [([1, 1, 1, 2], 4, 0), ([1, 1, 0, 2], 3, 1)])
def test_differences_near_aspects_are_counted(part, ids, agree, near):
    aspects = find_aspects(part('box_10x20x30'))
    down = np.array([a.down_in_part for a in aspects])[[0, 0, 0, 1]]
    clusters = find_clusters(down, 0.1)
    agreement = find_agreement(np.array(ids), len(aspects), clusters)
    differences = find_differences(agreement, aspects, down)
    line = agreement_line(agreement, differences)
    assert f'{agree} of 4 ' in line
    assert (f'on {near} within' in line) == bool(near)
