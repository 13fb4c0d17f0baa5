"""Aspects beside clusters as tables in a terminal, and the poses on which they differ."""

import numpy as np
import numpy.typing as npt
from rich.table import Table

from resting_aspects_ros.core.agreement import Agreement, Differences
from resting_aspects_ros.core.clusters import Clusters
from resting_aspects_ros.core.distribution import CONFIDENCE, Distribution
from resting_aspects_ros.report.rounding import direction_text, interval_of, outside_aspects
from resting_aspects_ros.report.table import NOTHING, plain_table, shares

# Poses that are listed; the document has them all.
MOST_DIFFERENCES = 20
# So near an aspect of a part with flat sides, nothing but that aspect can be meant.
NEAR = np.radians(1.0)

Ids = npt.NDArray[np.int64]


def agreement_table(
    distribution: Distribution, agreement: Agreement, clusters: Clusters, title: str
) -> Table:
    """A row for each aspect, beside the cluster with most of its poses, then what is in none.

    Parameters
    ----------
    distribution : Distribution
        Over the aspects.
    agreement : Agreement
    clusters : Clusters
    title : str
        Plain text, shown above.
    """
    table = _aspect_columns(title)
    drops = distribution.drops
    rows = zip(
        distribution.aspects.aspects,
        distribution.counts,
        distribution.intervals(),
        agreement.cluster_of,
        strict=True,
    )
    for aspect, count, interval, cluster in rows:
        table.add_row(
            str(aspect.id),
            direction_text(aspect.down_in_part),
            *shares(interval, int(count), drops),
            f'{cluster}: {clusters.counts[cluster - 1]}' if cluster else NOTHING,
        )
    table.add_section()
    for name, count in outside_aspects(distribution):
        table.add_row('', name, *shares(interval_of(distribution, count), count, drops), '')
    table.add_row('', 'poses in total', '', '', str(drops), '', style='bold')
    return table


def agreement_line(agreement: Agreement, differences: Differences) -> str:
    """On how many poses the two agree, and whether they do so wherever they must."""
    settled = len(agreement.agree)
    near = int(np.count_nonzero(differences.angle <= NEAR))
    where = f'within {np.degrees(NEAR):g} degree of an aspect'
    return (
        f'Aspects and clusters agree on {settled - len(differences)} of {settled} settled poses, '
        + (f'but not on {near} {where}.' if near else f'and on every one {where}.')
    )


def differences_table(
    differences: Differences, clusters: Clusters, index: Ids, line: Ids
) -> Table:
    """The first poses on which the two differ.

    Parameters
    ----------
    differences : Differences
    clusters : Clusters
    index, line : (n,) int
        Of all poses that were compared: their indices and lines in the file.
    """
    shown = min(len(differences), MOST_DIFFERENCES)
    of = '' if shown == len(differences) else f' of {len(differences)} (--json has all)'
    table = _difference_columns(f'They differ on {shown}{of}:')
    for k in range(shown):
        pose, cluster = differences.pose[k], int(differences.cluster[k])
        nearest = differences.nearest[k]
        table.add_row(
            str(index[pose]),
            str(line[pose]),
            str(nearest or NOTHING),
            f'{np.degrees(differences.angle[k]):.2f}' if nearest else NOTHING,
            str(differences.aspect[k] or 'none'),
            str(cluster),
            str(clusters.counts[cluster - 1]),
        )
    return table


def _aspect_columns(title: str) -> Table:
    table = plain_table(title)
    table.add_column('aspect', justify='right', no_wrap=True)
    table.add_column('down in part', no_wrap=True)
    table.add_column('share', justify='right', no_wrap=True)
    table.add_column(f'{100 * CONFIDENCE:g} % interval', justify='right', no_wrap=True)
    table.add_column('count', justify='right', no_wrap=True)
    table.add_column('cluster:\nits count', justify='right', no_wrap=True)
    return table


def _difference_columns(title: str) -> Table:
    table = plain_table(title)
    headings = (
        'pose',
        'line',
        'nearest\naspect',
        'angle to it\n(degrees)',
        'in aspect',
        'in cluster',
        'its\ncount',
    )
    for heading in headings:
        table.add_column(heading, justify='right', no_wrap=True)
    return table
