"""Simplification of the hull of a scanned or finely meshed part, with its error.

Corners are omitted, never moved. First the outlines of flat sides and both ends of strips of
curved sides are selected, so that flats stay flat and a cylinder stays straight. Then corners
furthest outside the hull of the selected corners are added in rounds. Finally the maximum distance
of the omitted corners from the hull is measured; neither the height of the centre of mass in any
orientation nor a barrier has a larger error. No step depends on the frame of the mesh, except for
rounding.
"""

from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, KDTree
from scipy.spatial.distance import cdist

from resting_aspects_ros.core.geometry.surface_distance import TriangleTree

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Hulls with at most this number of corners are unchanged. Bullet tests every corner in every step:
# a drop of an egg with 1000, 2000 or 3000 corners takes 9, 14 or 21 ms, that of a box 2 ms. The
# error of a ball is 3e-3 with 2000 corners and 1.7e-3 with 3000; heights are distinguished from
# 1e-3 R.
MAX_CORNERS = 3000
# Lengths are in units of the maximum distance of a corner from the mean of all corners, about R.
# Corners are added until the others are outside by at most this, which does not affect the
# landscape (COPLANAR).
FINE = 1e-5
# Below this error a round that exceeds the maximum number of corners is not started: half a round
# would leave a cylinder with corners at its top that have no counterpart at its bottom.
GOOD = 5e-4
# A round adds corners that are further outside than this share of the maximum.
ROUND = 0.7
# Number of sides from which the first corners are selected.
SIDES = 300
# Maximum distance of corners in the plane of a side: the noise of float32.
IN_PLANE = 2e-6
# A wider side is flat: on a round side only sqrt(8 IN_PLANE) = 0.004 is in a plane.
WIDE = 0.01
# Tolerance of the outline of a flat side: 4^k times this, with the smallest k for which the
# corners suffice.
OUTLINE = 1e-4
# Number of random corners that are used in the rounds; the final error is that of all corners.
SAMPLES = 50_000


def simplify_hull(
    corners: Array, triangles: Indices, normals: Array, max_corners: int = MAX_CORNERS
) -> tuple[Array, float]:
    """Return the corners of a hull, or a selection if there are too many, and the error.

    Parameters
    ----------
    corners : (n, 3) float64
        m, all corners of the hull, in lexicographic order, like the result.
    triangles : (f, 3) int64
        Triangles of the hull, rows of ``corners``.
    normals : (f, 3) float64
        Outward unit normals of the triangles.
    max_corners : int
        Maximum number of corners that are kept.

    Returns
    -------
    kept : (k, 3) float64
        m.
    error : float
        m; the exact maximum distance of an omitted corner from the hull of the others.
    """
    if len(corners) <= max_corners:
        return corners, 0.0
    centre = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - centre, axis=1).max())
    points = (corners - centre) / size
    kept = _first(points, triangles, normals, max_corners // 2)
    # Any permutation is suitable; this one is reproducible.
    samples = np.random.default_rng(23).permutation(len(points))[:SAMPLES]
    furthest = 0.0
    while True:
        triangles = kept[ConvexHull(points[kept]).simplices]
        out, owner = _outside(points[samples], points[triangles], furthest)
        furthest = float(out.max())
        new = samples[_round(points[samples], out, owner, KDTree(points[kept]))]
        room = max_corners - len(kept)
        if furthest <= FINE or room <= 0 or (len(new) > room and furthest <= GOOD):
            break
        kept = np.union1d(kept, new[:room])
    return corners[kept], size * float(_outside(points, points[triangles], furthest)[0].max())


def _first(points: Array, triangles: Indices, normals: Array, max_corners: int) -> Indices:
    """Return the first corners: those of sides whose planes together approximate the hull."""
    columns = np.ascontiguousarray(points.T)
    depth = np.full(len(triangles), np.inf)  # of the lowest corner of each below the best plane
    side = int(np.einsum('fi,fi->f', normals, points[triangles[:, 0]]).argmin())
    ends, flats = [], []
    for _ in range(SIDES):
        reach = normals[side] @ columns
        corners = np.flatnonzero(reach >= reach.max() - IN_PLANE)
        arms = points[corners] - points[corners].mean(axis=0)
        flat = arms @ np.linalg.eigh(arms.T @ arms)[1][:, :0:-1]  # the longer direction first
        if np.ptp(flat[:, 1]) > WIDE:
            flats.append((corners, flat))
        else:
            ends += corners[_ends(*flat.T)].tolist()
        a, b, c = reach[triangles.T]
        np.minimum(depth, reach.max() - np.minimum(np.minimum(a, b), c), out=depth)
        side = int(depth.argmax())
        if depth[side] <= FINE:
            break
    for cut in OUTLINE * 4.0 ** np.arange(10):
        kept = np.unique(np.array(ends, dtype=np.int64))
        for corners, flat in flats:
            kept = np.union1d(kept, corners[_outline(flat, np.isin(corners, kept), cut)])
        if len(kept) <= max_corners:
            break
    return kept


def _ends(along: Array, across: Array) -> list[int]:
    """Return the corners at both ends of a strip, in the middle of its width; one for a spot."""
    off = np.abs(across - (across.max() + across.min()) / 2)
    if np.ptp(along) <= WIDE:
        return [int(np.hypot(along, off).argmin())]
    near = along <= along.min() + WIDE, along >= along.max() - WIDE
    return [int(np.where(end, off, np.inf).argmin()) for end in near]


def _outline(flat: Array, kept: npt.NDArray[np.bool_], cut: float) -> Indices:
    """Return the corners of the outline of a flat side (n, 2), including those kept already."""
    around = ConvexHull(flat).vertices.astype(np.int64)
    fixed = np.flatnonzero(kept[around])
    if len(fixed) < 2:
        fixed = np.unique([flat[around, 0].argmin(), flat[around, 0].argmax()])
    around = np.roll(around, -fixed[0])
    stops = [*(fixed - fixed[0]).tolist(), len(around)]
    polygon = flat[np.append(around, around[0])]
    bends = [k for a, b in pairwise(stops) for k in _bends(polygon, a, b, cut)]
    return around[stops[:-1] + bends]


def _bends(polygon: Array, first: int, last: int, cut: float) -> list[int]:
    """Return the corners that the tolerance requires between two others (Douglas, Peucker)."""
    if last - first < 2:
        return []
    (x, y), arms = polygon[last] - polygon[first], polygon[first + 1 : last] - polygon[first]
    off = np.abs(arms @ [-y, x]) / np.hypot(x, y)
    k = first + 1 + int(off.argmax())
    if off.max() <= cut:
        return []
    return [*_bends(polygon, first, k, cut), k, *_bends(polygon, k, last, cut)]


def _outside(points: Array, triangles: Array, about: float) -> tuple[Array, Indices]:
    """Return the distances of points (n, 3) from triangles (f, 3, 3), and the nearest triangles.

    about : float
        Expected distance; it only affects the time.
    """
    tree = TriangleTree(triangles, np.zeros(len(triangles)))
    out, owner = np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
    left, reach = np.arange(len(points)), max(1.01 * about, GOOD)
    while len(left):
        near, owner_near, ways = tree.nearest(points[left], reach)
        out[left[near]] = np.linalg.norm(ways, axis=1)
        owner[left[near]] = owner_near
        left, reach = np.delete(left, near), 2 * reach
    return out, owner


def _round(points: Array, out: Array, owner: Indices, kept: KDTree) -> Indices:
    """Return the furthest point outside each triangle, if it is far, in descending order.

    Of two points that are closer to each other than to those kept, only the first is returned.
    """
    order = np.argsort(-out, kind='stable')
    order = order[out[order] > ROUND * out[order[0]]]
    new = order[np.sort(np.unique(owner[order], return_index=True)[1])]
    near = np.asarray(kept.query(points[new])[0]) / 2
    close = np.tril(cdist(points[new], points[new]) < near[:, None], -1)
    return np.asarray(new[~close.any(axis=1)])
