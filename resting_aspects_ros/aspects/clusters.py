"""Clusters of poses by their down directions, without knowledge of the part."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import angle_between

# Maximum step within a cluster, degrees (docs/explanation/seed_runs.md). In the published runs of
# three printed parts, the distance to the next pose is up to 2.6 within an aspect, up to 4.5 for
# poses that still tip, and then at least 6.3; poses of this suite scatter by hundredths. A smaller
# step would need more drops to close the ring of a rolling part (5 degrees need about 500); a
# larger step would join different aspects across the flats of a coarse mesh or across outliers.
DEFAULT_TOLERANCE_DEGREES = 5.0
# Below this range poses of one aspect are separated; above it aspects of common parts are joined.
MIN_TOLERANCE_DEGREES, MAX_TOLERANCE_DEGREES = 1.0, 30.0
# A cluster has no mean direction if the mean of its unit vectors is shorter than this: its
# directions form a ring (the length is 0 for a great circle).
MIN_RESULTANT = 0.5


@dataclass(frozen=True, eq=False)
class Clusters:
    """Clusters of down directions, the largest first.

    labels : (n,) int
        Cluster of each direction, from 1.
    counts : (k,) int
        Number of directions in each cluster.
    mean : (k, 3) float
        Unit vectors, part frame; NaN for a ring.
    spread : (k,) float
        Root mean square of the angles to the mean, rad; NaN for a ring.
    """

    labels: Indices
    counts: Indices
    mean: Array
    spread: Array

    def __len__(self) -> int:
        return len(self.counts)


def find_clusters(down: Array, tolerance: float) -> Clusters:
    """Return the clusters of directions with their statistics.

    The result is bit for bit independent of the order of the directions.

    Parameters
    ----------
    down, tolerance
        See cluster_directions.
    """
    labels = cluster_directions(down, tolerance)
    k = int(labels.max(initial=0))
    counts = np.bincount(labels, minlength=k + 1)[1:]
    # The rounding of sums depends on the order of the summands.
    order = _sorted_order(down)
    points, which = np.asarray(down)[order], labels[order] - 1
    sums = np.stack([np.bincount(which, x, minlength=k) for x in points.T], axis=1)
    resultant: Array = sums / counts[:, None]
    length = np.linalg.norm(resultant, axis=1, keepdims=True)
    mean = np.divide(
        resultant, length, out=np.full_like(resultant, np.nan), where=length >= MIN_RESULTANT
    )
    square = angle_between(points, mean[which]) ** 2
    spread = np.sqrt(np.bincount(which, square, minlength=k) / counts)
    return Clusters(labels, counts, mean, spread)


def cluster_directions(down: Array, tolerance: float) -> Indices:
    """Return the cluster labels (n,) of directions, from 1 for the largest cluster.

    Clusters of equal size are ordered by their first direction in the order of x, y and z.
    Permuting the directions only permutes the labels.

    Parameters
    ----------
    down : (n, 3) float
        Unit vectors.
    tolerance : float
        Directions at most this angle apart are in one cluster, rad.

    Raises
    ------
    InvalidValueError
        If the tolerance is not 1 to 30 degrees.
    """
    check_tolerance(tolerance)
    down = np.asarray(down, dtype=np.float64).reshape(-1, 3)
    # Equal directions are searched once: a KD-tree of equal points would compare all pairs.
    points, which = np.unique(down, axis=0, return_inverse=True)
    component = _components(points, float(2 * np.sin(tolerance / 2)))
    which = component[which.reshape(-1)]
    counts, (_, first) = np.bincount(which), np.unique(component, return_index=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.lexsort((first, -counts))] = np.arange(1, len(first) + 1)
    return rank[which]


def check_tolerance(tolerance: float) -> None:
    """Raise InvalidValueError if the tolerance, rad, is outside the limits."""
    low, high = MIN_TOLERANCE_DEGREES, MAX_TOLERANCE_DEGREES
    if not np.radians(low) <= tolerance <= np.radians(high):
        raise InvalidValueError(
            f'invalid tolerance {np.degrees(tolerance):g} degrees: expected {low:g} to {high:g} '
            'degrees'
        )


def _sorted_order(points: Array) -> npt.NDArray[np.intp]:
    x, y, z = np.asarray(points).T
    return np.lexsort((z, y, x))


def _components(points: Array, reach: float) -> Indices:
    """Return the component (n,) of each point, where points at most ``reach`` apart are linked.

    Breadth-first search: a component grows by all points within reach of those that were added
    last, so chains are as long as the component is wide, however many points it has.
    """
    bound = np.nextafter(reach, np.inf)  # the bound is exclusive
    component = np.full(len(points), -1)
    left = np.arange(len(points))
    while len(left):
        added, number = left[len(left) // 2 :][:1], int(component.max()) + 1
        while len(added):
            component[added] = number
            left = left[component[left] < 0]
            distance, _ = cKDTree(points[added]).query(points[left], distance_upper_bound=bound)
            added = left[np.isfinite(distance)]
    return component


@dataclass(frozen=True, eq=False)
class Agreement:
    """The poses on which two classifications agree: by aspects and by clusters.

    An aspect and a cluster match if each contains more poses of the other than of any third. The
    classifications agree on a pose if it is in an aspect and in the matching cluster. They never
    agree on a pose in no aspect, because every pose is in a cluster.

    aspect : (n,) int
        Id of each pose's aspect; 0 for none.
    cluster : (n,) int
        Label of each pose's cluster.
    cluster_of : (a,) int
        For each aspect, by id from 1, the cluster with most of its poses; 0 if it has no poses.
    shared : (a,) int
        Number of poses of each aspect in that cluster.
    agree : (n,) bool
    """

    aspect: Indices
    cluster: Indices
    cluster_of: Indices
    shared: Indices
    agree: Flags


def find_agreement(ids: Indices, aspects: int, clusters: Clusters) -> Agreement:
    """Return the agreement of aspect ids (n,), of ``aspects`` different ones, with clusters."""
    shape = (aspects + 1, len(clusters) + 1)
    cells = np.bincount(ids * shape[1] + clusters.labels, minlength=shape[0] * shape[1])
    table = cells.reshape(shape)
    table[0] = 0  # in no aspect
    cluster_of = table.argmax(axis=1)  # of equal ones the larger cluster and the lower id
    aspect_of = table.argmax(axis=0)
    agree = (ids > 0) & (cluster_of[ids] == clusters.labels) & (aspect_of[clusters.labels] == ids)
    return Agreement(ids, clusters.labels, cluster_of[1:], table.max(axis=1)[1:], agree)


@dataclass(frozen=True, eq=False)
class Differences:
    """The poses on which the two classifications differ, in order; each field is (m,).

    pose : int, index of the pose, from 0.
    nearest, angle : the nearest aspect, 0 if the part has none, and the angle to it, rad.
    aspect, cluster : int, the two classifications; aspect 0 means none.
    """

    pose: Indices
    nearest: Indices
    angle: Array
    aspect: Indices
    cluster: Indices

    def __len__(self) -> int:
        return len(self.pose)


def find_differences(agreement: Agreement, aspects: AspectSet, down: Array) -> Differences:
    """Return the poses without agreement; ``down`` are the down directions (n, 3) of all poses."""
    pose = np.flatnonzero(~agreement.agree)
    nearest, angle = aspects.locate(down[pose])
    return Differences(pose, nearest, angle, agreement.aspect[pose], agreement.cluster[pose])
