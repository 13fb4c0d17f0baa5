"""Clusters of resting poses as a table in a terminal."""

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.clusters import Clusters
from resting_aspects_ros.core.distribution import CONFIDENCE, Distribution, Interval
from resting_aspects_ros.report.rounding import direction_text, interval_of, outside_aspects
from resting_aspects_ros.report.table import NOTHING, plain_table, shares

# Rows for single clusters; more are told in one.
MOST_ROWS = 20
# In place of a direction, of a cluster that has no mean one.
RING = 'all round'


def cluster_intervals(distribution: Distribution, counts: np.ndarray) -> list[Interval]:
    """The shares of clusters in all poses, each worked out once for each count that occurs."""
    by_count = {int(n): interval_of(distribution, int(n)) for n in np.unique(counts)}
    return [by_count[int(n)] for n in counts]


def cluster_table(distribution: Distribution, clusters: Clusters, title: str) -> Table:
    """A row for each of the largest clusters, then for the rest, then what did not settle.

    Parameters
    ----------
    distribution : Distribution
        Its counts are those of the clusters.
    clusters : Clusters
    title : str
        Plain text, shown above.
    """
    table = _empty_table(title)
    drops = distribution.drops
    shown = clusters.counts[:MOST_ROWS]
    for k, interval in enumerate(cluster_intervals(distribution, shown)):
        table.add_row(
            str(k + 1),
            mean_text(clusters, k),
            spread_text(clusters, k),
            *shares(interval, int(shown[k]), drops),
        )
    table.add_section()
    more = len(clusters) - len(shown)
    rest = [(f'{more} more', int(clusters.counts[MOST_ROWS:].sum()))] if more else []
    for name, count in [*rest, *outside_aspects(distribution)]:
        table.add_row('', name, '', *shares(interval_of(distribution, count), count, drops))
    table.add_row('', 'poses in total', '', '', '', str(drops), style='bold')
    return table


def mean_text(clusters: Clusters, k: int) -> str:
    """The mean direction of the cluster at place ``k``."""
    mean = clusters.mean[k]
    return RING if np.isnan(mean).any() else direction_text(mean)


def spread_text(clusters: Clusters, k: int) -> str:
    """Its spread, degrees."""
    spread = float(np.degrees(clusters.spread[k]))
    return NOTHING if np.isnan(spread) else f'{spread:.2f}'


def _empty_table(title: str) -> Table:
    table = plain_table(title)
    table.add_column('cluster', justify='right', no_wrap=True)
    table.add_column('down in part', no_wrap=True)
    table.add_column('spread\n(degrees)', justify='right', no_wrap=True)
    table.add_column('share', justify='right', no_wrap=True)
    table.add_column(f'{100 * CONFIDENCE:g} % interval', justify='right', no_wrap=True)
    table.add_column('count', justify='right', no_wrap=True)
    return table
