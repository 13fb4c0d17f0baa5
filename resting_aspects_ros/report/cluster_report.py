"""Tables and a JSON document that compare clusters of poses with aspects (angles in rad)."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from rich.table import Table

from resting_aspects_ros.aspects.clusters import Agreement, Clusters, Differences
from resting_aspects_ros.report.document import SCHEMA_VERSION, numbers, plain, share_fields
from resting_aspects_ros.report.rounding import direction_text, interval_of, outside_aspects
from resting_aspects_ros.report.table import DOWN, NOTHING, plain_table, shares
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, Interval

# Maximum number of poses in the table of differences; the JSON document has all.
MAX_DIFFERENCES = 20
# Within this angle of an aspect of a part with flat sides, no other aspect is possible.
NEAR = np.radians(1.0)

# Maximum number of rows for single clusters; the other clusters share one row.
MAX_ROWS = 20
# The cell for the direction of a cluster without a mean direction.
RING = 'all round'

Ids = npt.NDArray[np.int64]


def cluster_intervals(distribution: Distribution, counts: np.ndarray) -> list[Interval]:
    """Return the share of each cluster in all poses; equal counts are computed once."""
    by_count = {int(n): interval_of(distribution, int(n)) for n in np.unique(counts)}
    return [by_count[int(n)] for n in counts]


def cluster_table(distribution: Distribution, clusters: Clusters, title: str) -> Table:
    """Return a table of the largest clusters, the other clusters, and the unsettled poses.

    ``distribution`` has the counts of the clusters in place of aspects.
    """
    percent = f'{100 * CONFIDENCE:g} % interval'
    table = plain_table(title, 'cluster', DOWN, 'spread\n(degrees)', 'share', percent, 'count')
    drops = distribution.drops
    shown = clusters.counts[:MAX_ROWS]
    for k, interval in enumerate(cluster_intervals(distribution, shown)):
        table.add_row(
            str(k + 1),
            RING if np.isnan(clusters.mean[k]).any() else direction_text(clusters.mean[k]),
            NOTHING if np.isnan(clusters.spread[k]) else f'{np.degrees(clusters.spread[k]):.2f}',
            *shares(interval, int(shown[k]), drops),
        )
    table.add_section()
    more = len(clusters) - len(shown)
    rest = [(f'{more} more', int(clusters.counts[MAX_ROWS:].sum()))] if more else []
    for name, count in [*rest, *outside_aspects(distribution)]:
        table.add_row('', name, '', *shares(interval_of(distribution, count), count, drops))
    table.add_row('', 'poses in total', '', '', '', str(drops), style='bold')
    return table


def agreement_table(
    distribution: Distribution, agreement: Agreement, clusters: Clusters, title: str
) -> Table:
    """Return a table of the aspects, each beside the cluster with most of its poses."""
    percent = f'{100 * CONFIDENCE:g} % interval'
    table = plain_table(title, 'aspect', DOWN, 'share', percent, 'count', 'cluster:\nits count')
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
    """State on how many poses aspects and clusters agree, and whether on all near an aspect."""
    settled = len(agreement.agree)
    near = int(np.count_nonzero(differences.angle <= NEAR))
    where = f'within {np.degrees(NEAR):g} degree of an aspect'
    return (
        f'Aspects and clusters agree on {settled - len(differences)} of {settled} settled poses, '
        + (f'but differ on {near} {where}.' if near else f'including all poses {where}.')
    )


def differences_table(
    differences: Differences, clusters: Clusters, index: Ids, line: Ids
) -> Table:
    """Return a table of the first poses on which aspects and clusters differ.

    index, line : (n,) int, indices of all compared poses, and their lines in the file.
    """
    shown = min(len(differences), MAX_DIFFERENCES)
    total = '' if shown == len(differences) else f' of {len(differences)}, --json lists all'
    table = plain_table(
        f'Differing poses ({shown}{total}):',
        'pose',
        'line',
        'nearest\naspect',
        'angle to it\n(degrees)',
        'in aspect',
        'in cluster',
        'its\ncount',
    )
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


def cluster_document(
    distribution: Distribution, clusters: Clusters, tolerance: float
) -> dict[str, object]:
    """Return the document of the clusters, for which the part is not needed.

    ``distribution`` has the counts of the clusters; ``down_in_part`` is the mean direction, null
    if there is none; ``tolerance`` is in rad.
    """
    return {
        'schema_version': SCHEMA_VERSION,
        'tolerance': tolerance,
        'drops': distribution.drops,
        'unsettled': distribution.unsettled,
        'failed': distribution.failed,
        'confidence': distribution.confidence,
        'interval': distribution.interval,
        'clusters': [
            {
                'id': k + 1,
                'down_in_part': None if np.isnan(mean).any() else numbers(mean),
                'spread': plain(float(clusters.spread[k])),
                **share_fields(int(clusters.counts[k]), interval),
            }
            for k, (mean, interval) in enumerate(
                zip(clusters.mean, cluster_intervals(distribution, clusters.counts), strict=True)
            )
        ],
    }


def agreement_fields(
    distribution: Distribution,
    agreement: Agreement,
    differences: Differences,
    places: Sequence[Ids],
) -> dict[str, object]:
    """Return the fields that need the part: aspects with their clusters, and differences.

    places : two of (n,) int, indices of all compared poses, and their lines in the file.
    """
    index, line = places
    rows = zip(
        distribution.aspects.aspects, distribution.counts, distribution.intervals(), strict=True
    )
    return {
        'unclassified': distribution.unclassified,
        'agreed': int(agreement.agree.sum()),
        'aspects': [
            {
                'id': aspect.id,
                'down_in_part': numbers(aspect.down_in_part),
                'com_height': float(aspect.com_height),
                **share_fields(int(count), interval),
                'cluster': int(agreement.cluster_of[k]),
                'count_in_cluster': int(agreement.shared[k]),
            }
            for k, (aspect, count, interval) in enumerate(rows)
        ],
        'differing': [
            {
                'pose': int(index[pose]),
                'line': int(line[pose]),
                'nearest_aspect': int(differences.nearest[k]),
                'angle': plain(float(differences.angle[k])),
                'aspect': int(differences.aspect[k]),
                'cluster': int(differences.cluster[k]),
            }
            for k, pose in enumerate(differences.pose)
        ],
    }
