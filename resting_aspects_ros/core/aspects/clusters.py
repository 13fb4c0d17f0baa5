"""Clusters of poses by their down directions, without knowledge of the part.

The rule of the seed method is that two poses are the same if the rotation from one to the other is
about the vertical. This is equivalent to equal directions of gravity in the part frame, so poses
are compared by their down directions and the yaw is ignored.

A cluster contains all directions connected by chains of steps up to the tolerance (single
linkage). The result does not depend on the order of the poses, and the ring of a rolling part is
one cluster. The result is exact: the grid only avoids comparisons whose outcome is certain.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import angle_between

Array = npt.NDArray[np.float64]
Labels = npt.NDArray[np.int64]

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

    labels: Labels
    counts: npt.NDArray[np.int64]
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


def cluster_directions(down: Array, tolerance: float) -> Labels:
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
    order = _sorted_order(down)
    component = _components(down[order], float(2 * np.sin(tolerance / 2)))
    _, first, which, counts = np.unique(
        component, return_index=True, return_inverse=True, return_counts=True
    )
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.lexsort((first, -counts))] = np.arange(1, len(first) + 1)
    labels = np.empty(len(down), dtype=np.int64)
    labels[order] = rank[which]
    return labels


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


def _components(points: Array, reach: float) -> npt.NDArray[np.int64]:
    """Return the component (n,) of each point, where points at most ``reach`` apart are linked.

    All points in a cube of diagonal ``reach`` are in one component. So cubes are linked instead of
    points; their number is limited by the size of the sphere. Cubes are linked first if their
    first points are within reach; remaining pairs are compared by all their points.
    """
    cubes, which = _cubes(points, reach / np.sqrt(3))
    order = np.argsort(which, kind='stable')
    starts = np.searchsorted(which[order], np.arange(len(cubes) + 1))
    pairs = _neighbours(cubes)
    first = points[order[starts[:-1]]]
    near = np.linalg.norm(first[pairs[:, 0]] - first[pairs[:, 1]], axis=1) <= reach
    number = _linked(len(cubes), pairs[near])
    members = [points[order[start:end]] for start, end in pairwise(starts)]
    doubtful = np.flatnonzero(number[pairs[:, 0]] != number[pairs[:, 1]])
    near[doubtful] = [_in_reach(members[a], members[b], reach) for a, b in pairs[doubtful]]
    return _linked(len(cubes), pairs[near])[which]


def _linked(n: int, pairs: npt.NDArray[np.intp]) -> npt.NDArray[np.int64]:
    """Return the component (n,) of each element, linked by pairs."""
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), (n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _cubes(points: Array, side: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.intp]]:
    """Return the occupied cubes (k, 3) of a grid, and the index (n,) of the cube of each point."""
    cubes = np.floor(points / side).astype(np.int64)
    width = 2 * int(np.ceil(1 / side)) + 3
    key = ((cubes[:, 0] * width) + cubes[:, 1]) * width + cubes[:, 2]
    _, first, which = np.unique(key, return_index=True, return_inverse=True)
    return cubes[first], which


def _neighbours(cubes: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """Return the pairs (m, 2) of cubes whose points may be within a diagonal of each other."""
    pairs: npt.NDArray[np.intp] = cKDTree(cubes).query_pairs(3.5, output_type='ndarray')
    gap = np.abs(cubes[pairs[:, 0]] - cubes[pairs[:, 1]]) - 1
    squared = (np.maximum(gap, 0) ** 2).sum(axis=1)
    return np.asarray(pairs[squared <= 3])


def _in_reach(one: Array, other: Array, reach: float) -> bool:
    """Return whether any point of one set is at most ``reach`` from a point of the other."""
    one = one[_distance_to_box(one, other) <= reach]
    if not len(one):
        return False
    other = other[_distance_to_box(other, one) <= reach]
    if not len(other):
        return False
    bound = np.nextafter(reach, np.inf)  # the bound is exclusive
    distance, _ = cKDTree(other).query(one, distance_upper_bound=bound)
    return bool(np.isfinite(distance).any())


def _distance_to_box(points: Array, of: Array) -> Array:
    nearest = np.clip(points, of.min(axis=0), of.max(axis=0))
    return np.asarray(np.linalg.norm(points - nearest, axis=1))
