"""Tables of clusters, and of aspects beside them, say what they are in 80 columns."""

import re

import numpy as np
import pytest
from rich.console import Console

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.clusters import (
    Clusters,
    find_agreement,
    find_clusters,
    find_differences,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.comparison import agreement_line, cluster_table, differences_table
from resting_aspects_ros.statistics.distribution import Distribution

MAX_RUN_DROPS = 2_000_000  # drops of a run


def lines(table):
    console = Console(width=80, force_terminal=False)
    with console.capture() as captured:
        console.print(table)
    return captured.get().splitlines()


def clusters_of(counts):
    k = len(counts)
    return Clusters(
        np.zeros(0, int), np.array(counts), np.tile([0, 0.6, -0.8], (k, 1)), np.ones(k)
    )


@pytest.mark.parametrize('more', [0, 3])
def test_largest_clusters_have_rows_and_the_rest_share_one(more):
    counts = [MAX_RUN_DROPS, *range(1020, 1001, -1), *[7] * more]
    clusters = clusters_of(counts)
    shown = lines(
        cluster_table(
            Distribution(AspectSet('', ()), clusters.counts, 0, 5, 0), clusters, '[a] title'
        )
    )
    assert shown[0].rstrip() == '[a] title'
    assert '…' not in ''.join(shown)
    found = [re.match(r' *(\d+)  [-+ ]\d.* (\d+) *$', line) for line in shown]
    assert [(int(row[1]), int(row[2])) for row in found if row] == list(
        enumerate(counts[:20], start=1)
    )
    text = '\n'.join(shown)
    assert (f'{more} more' in text) == bool(more)
    assert re.search(r'unsettled .* 5 *$', text, re.MULTILINE)
    assert re.search(rf'poses in total +{sum(counts) + 5} *$', text)


@pytest.mark.parametrize(
    ('ids', 'says'),
    [
        ([1, 1, 1, 2], 'agree on 4 of 4 settled poses, including all poses within 1 degree'),
        ([1, 1, 0, 2], 'agree on 3 of 4 settled poses, but differ on 1 within 1 degree'),
    ],
)
def test_agreement_line_counts_differences_near_aspects(part, ids, says):
    aspects = find_aspects(part('box_10x20x30'))
    down = np.array([a.down_in_part for a in aspects.aspects])[[0, 0, 0, 1]]
    clusters = find_clusters(down, 0.1)
    agreement = find_agreement(np.array(ids), len(aspects), clusters)
    differences = find_differences(agreement, aspects, down)
    assert says in agreement_line(agreement, differences)
    place = np.array([10, 20, 30, 40])
    shown = lines(differences_table(differences, clusters, place, place + 2))
    assert [line.split() for line in shown if line.split()[:1] == ['30']] == [
        ['30', '32', '1', '0.00', 'none', '1', '3']
    ] * ids.count(0)
