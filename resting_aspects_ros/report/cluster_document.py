"""Clusters, and aspects beside them, as a JSON document; SI units, angles in rad."""

from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.agreement import Agreement, Differences
from resting_aspects_ros.core.clusters import Clusters
from resting_aspects_ros.core.distribution import Distribution
from resting_aspects_ros.report.cluster_table import cluster_intervals
from resting_aspects_ros.report.document import SCHEMA_VERSION

Ids = npt.NDArray[np.int64]


def cluster_document(
    distribution: Distribution, clusters: Clusters, tolerance: float
) -> dict[str, object]:
    """What is known without the part.

    Parameters
    ----------
    distribution : Distribution
        Its counts are those of the clusters.
    clusters : Clusters
        ``mean`` becomes ``down_in_part``, and null where there is none.
    tolerance : float
        rad.
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
                'down_in_part': _finite(clusters.mean[k]),
                'spread': _finite(clusters.spread[k]),
                'count': int(clusters.counts[k]),
                'probability': interval.probability,
                'lower': interval.lower,
                'upper': interval.upper,
            }
            for k, interval in enumerate(cluster_intervals(distribution, clusters.counts))
        ],
    }


def agreement_fields(
    distribution: Distribution,
    agreement: Agreement,
    differences: Differences,
    places: tuple[Ids, Ids],
) -> dict[str, object]:
    """What the part adds: aspects beside their clusters, and where the two differ.

    Parameters
    ----------
    distribution : Distribution
        Over the aspects.
    agreement : Agreement
    differences : Differences
    places : two of (n,) int
        Indices and lines of all poses that were compared, in their file.
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
                'down_in_part': _finite(aspect.down_in_part),
                'com_height': float(aspect.com_height),
                'count': int(count),
                'probability': interval.probability,
                'lower': interval.lower,
                'upper': interval.upper,
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
                'angle': _finite(differences.angle[k]),
                'aspect': int(differences.aspect[k]),
                'cluster': int(differences.cluster[k]),
            }
            for k, pose in enumerate(differences.pose)
        ],
    }


def _finite(numbers: Any) -> Any:
    """Plain numbers; null if they are not all finite, which JSON does not have."""
    array = np.asarray(numbers, dtype=np.float64) + 0.0  # and no -0.0
    return array.tolist() if np.isfinite(array).all() else None
