"""Poses sorted by their down directions alone, without knowing the part.

The rule of the seed method: two poses are the same if the rotation from one to the other is about
the vertical. Then gravity, seen from the part, has the same direction in both, and the other way
round; so poses are compared by their down directions, and the yaw is never looked at.

A cluster holds the directions that a chain of steps, none longer than the tolerance, leads to.
That depends on no order, and makes one cluster of the ring that a rolling part leaves. It is
exact: cells are only used to leave out comparisons whose outcome is certain.
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

# Steps up to this are within a cluster, degrees (docs/explanation/seed_runs.md). In the published
# runs of three printed parts, poses of an aspect are up to 2.6 from the next one, poses that still
# tip up to 4.5, then nothing comes until 6.3; our own engine's scatter by hundredths. Less would
# need more drops to close the ring of a rolling part (5 degrees take some 500); more would let the
# flats of a coarse mesh, or strays, join what is not the same.
DEFAULT_TOLERANCE_DEGREES = 5.0
# Below, poses of one aspect fall apart; above, aspects of common parts run together.
MIN_TOLERANCE_DEGREES, MAX_TOLERANCE_DEGREES = 1.0, 30.0
# A cluster has no mean direction if less than this is left of the mean of its unit vectors: its
# directions are all round a ring (0 if that is a great circle).
MIN_RESULTANT = 0.5


@dataclass(frozen=True, eq=False)
class Clusters:
    """Down directions in clusters, the largest first.

    labels : (n,) int
        Of each direction, from 1.
    counts : (k,) int
        Directions in each cluster.
    mean : (k, 3) float
        Unit vectors, part frame; NaN for a ring.
    spread : (k,) float
        Root of the mean square of the angles to the mean, rad; NaN for a ring.
    """

    labels: Labels
    counts: npt.NDArray[np.int64]
    mean: Array
    spread: Array

    def __len__(self) -> int:
        return len(self.counts)


def find_clusters(down: Array, tolerance: float) -> Clusters:
    """Directions in clusters, with what is to be said of each cluster.

    The same to the last bit whatever the order of the directions.

    Parameters
    ----------
    down, tolerance
        As for cluster_directions.
    """
    labels = cluster_directions(down, tolerance)
    k = int(labels.max(initial=0))
    counts = np.bincount(labels, minlength=k + 1)[1:]
    # Sums are rounded by the order in which they are made.
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
    """(n,) labels of the clusters that directions are in, from 1 for the largest.

    Of clusters that are equally large, the one with the direction that is first by x, then y,
    then z goes first. Permuting the directions permutes the labels, and no more.

    Parameters
    ----------
    down : (n, 3) float
        Unit vectors.
    tolerance : float
        Directions at most this apart are in one cluster, rad.

    Raises
    ------
    InvalidValueError
        The tolerance is not one of 1 to 30 degrees.
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
    """Raise InvalidValueError for a tolerance, rad, that makes no sense."""
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
    """(n,) numbers of the components of 'at most ``reach`` apart'.

    All points in a cube of diagonal ``reach`` are one component. So cubes are joined instead of
    points, of which there are never more than the sphere has room for: first those whose first
    points are in reach; then, where that leaves a doubt, by all their points.
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
    """(n,) numbers of the components that pairs link."""
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), (n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _cubes(points: Array, side: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.intp]]:
    """The (k, 3) cubes of a grid that points are in, and (n,) which of them each point is in."""
    cubes = np.floor(points / side).astype(np.int64)
    width = 2 * int(np.ceil(1 / side)) + 3
    key = ((cubes[:, 0] * width) + cubes[:, 1]) * width + cubes[:, 2]
    _, first, which = np.unique(key, return_index=True, return_inverse=True)
    return cubes[first], which


def _neighbours(cubes: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """(m, 2) pairs of cubes of which some points could be within a diagonal of each other."""
    pairs: npt.NDArray[np.intp] = cKDTree(cubes).query_pairs(3.5, output_type='ndarray')
    gap = np.abs(cubes[pairs[:, 0]] - cubes[pairs[:, 1]]) - 1
    squared = (np.maximum(gap, 0) ** 2).sum(axis=1)
    return np.asarray(pairs[squared <= 3])


def _in_reach(one: Array, other: Array, reach: float) -> bool:
    """Whether any two points of two sets are at most ``reach`` apart."""
    one = one[_distance_to_box(one, other) <= reach]
    if not len(one):
        return False
    other = other[_distance_to_box(other, one) <= reach]
    if not len(other):
        return False
    bound = np.nextafter(reach, np.inf)  # the search wants less than that
    distance, _ = cKDTree(other).query(one, distance_upper_bound=bound)
    return bool(np.isfinite(distance).any())


def _distance_to_box(points: Array, of: Array) -> Array:
    nearest = np.clip(points, of.min(axis=0), of.max(axis=0))
    return np.asarray(np.linalg.norm(points - nearest, axis=1))
