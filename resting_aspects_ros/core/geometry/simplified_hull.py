"""Fewer corners for the hull of a scanned or finely meshed part, and what that costs.

Corners are left out, none is moved. First come the outlines of flat sides and both ends of strips
of curved ones, so that flats stay flat and a cylinder straight. Then, round by round, the corners
that are furthest outside the hull of those taken so far. In the end it is measured how far the
others are outside: neither the height of the centre of mass in any orientation nor a barrier is
off by more. No step depends on the frame of the mesh but through rounding.
"""

from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, KDTree
from scipy.spatial.distance import cdist

from resting_aspects_ros.core.geometry.surface_distance import TriangleTree

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Up to here a hull is left as it is. Bullet looks at every corner in every step: a drop of an egg
# with 1000, 2000 or 3000 corners takes 9, 14 or 21 ms, that of a box 2 ms. A ball is off by 3e-3
# with 2000 corners and by 1.7e-3 with 3000, and heights are told apart from 1e-3 R on.
MAX_CORNERS = 3000
# Lengths are in units of the furthest corner's distance from the mean of all corners, about R.
# Corners are added until the others are outside by this: the landscape sees no finer (COPLANAR).
FINE = 1e-5
# Once they are outside by less than this, a round that does not fit is not begun: half of it
# would leave a cylinder with corners at its top that have no partner at its bottom.
GOOD = 5e-4
# A round takes what is further out than this share of the furthest.
ROUND = 0.7
# Sides from which the first corners are taken.
SIDES = 300
# Corners in the plane of a side, but for the noise of float32.
IN_PLANE = 2e-6
# A side that is wider than this is flat: of a round one sqrt(8 IN_PLANE) = 0.004 is in a plane.
WIDE = 0.01
# By how much the outline of a flat side may be cut: 4^k times this, as the corners allow.
OUTLINE = 1e-4
# So many corners, at random, are looked at in the rounds; in the end all are measured.
CROWD = 50_000


def simplify_hull(
    corners: Array, triangles: Indices, normals: Array, most: int = MAX_CORNERS
) -> tuple[Array, float]:
    """Return the corners of a hull, or some of them if they are too many, and the error.

    Parameters
    ----------
    corners : (n, 3) float64
        m, all of them corners of the hull, in lexicographic order, as the result is.
    triangles : (f, 3) int64
        Of the hull, rows of ``corners``.
    normals : (f, 3) float64
        Of the triangles, outward unit vectors.
    most : int
        So many corners are left at most.

    Returns
    -------
    kept : (k, 3) float64
        m.
    error : float
        m; the largest distance of a corner that was left out from the hull of the others, exactly.
    """
    if len(corners) <= most:
        return corners, 0.0
    centre = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - centre, axis=1).max())
    points = (corners - centre) / size
    kept = _first(points, triangles, normals, most // 2)
    # Any will do; these are the same every time.
    crowd = np.random.default_rng(23).permutation(len(points))[:CROWD]
    furthest = 0.0
    while True:
        triangles = kept[ConvexHull(points[kept]).simplices]
        out, owner = _outside(points[crowd], points[triangles], furthest)
        furthest = float(out.max())
        new = crowd[_round(points[crowd], out, owner, KDTree(points[kept]))]
        room = most - len(kept)
        if furthest <= FINE or room <= 0 or (len(new) > room and furthest <= GOOD):
            break
        kept = np.union1d(kept, new[:room])
    return corners[kept], size * float(_outside(points, points[triangles], furthest)[0].max())


def _first(points: Array, triangles: Indices, normals: Array, most: int) -> Indices:
    """The corners to begin with: of sides whose planes are near the hull everywhere."""
    columns = np.ascontiguousarray(points.T)
    depth = np.full(len(triangles), np.inf)  # of each one's lowest corner below the best plane
    side = int(np.einsum('fi,fi->f', normals, points[triangles[:, 0]]).argmin())
    ends, flats = [], []
    for _ in range(SIDES):
        reach = normals[side] @ columns
        corners = np.flatnonzero(reach >= reach.max() - IN_PLANE)
        arms = points[corners] - points[corners].mean(axis=0)
        flat = arms @ np.linalg.eigh(arms.T @ arms)[1][:, :0:-1]  # the longer way first
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
        if len(kept) <= most:
            break
    return kept


def _ends(along: Array, across: Array) -> list[int]:
    """The corners at both ends of a strip, in the middle of its width; one of a spot."""
    off = np.abs(across - (across.max() + across.min()) / 2)
    if np.ptp(along) <= WIDE:
        return [int(np.hypot(along, off).argmin())]
    near = along <= along.min() + WIDE, along >= along.max() - WIDE
    return [int(np.where(end, off, np.inf).argmin()) for end in near]


def _outline(flat: Array, kept: npt.NDArray[np.bool_], cut: float) -> Indices:
    """Corners (of all, (n, 2)) of the outline of a flat side, those kept already among them."""
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
    """Corners without which the way from one to another is cut by more (Douglas, Peucker)."""
    if last - first < 2:
        return []
    (x, y), arms = polygon[last] - polygon[first], polygon[first + 1 : last] - polygon[first]
    off = np.abs(arms @ [-y, x]) / np.hypot(x, y)
    k = first + 1 + int(off.argmax())
    if off.max() <= cut:
        return []
    return [*_bends(polygon, first, k, cut), k, *_bends(polygon, k, last, cut)]


def _outside(points: Array, triangles: Array, about: float) -> tuple[Array, Indices]:
    """How far points (n, 3) are from triangles (f, 3, 3), and which one is the nearest.

    about : float
        What to expect; it only saves time.
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
    """The furthest outside over each triangle, of those that are far; in that order.

    Of two that are closer to each other than to those kept, over neighbours, only the first.
    """
    order = np.argsort(-out, kind='stable')
    order = order[out[order] > ROUND * out[order[0]]]
    new = order[np.sort(np.unique(owner[order], return_index=True)[1])]
    near = np.asarray(kept.query(points[new])[0]) / 2
    close = np.tril(cdist(points[new], points[new]) < near[:, None], -1)
    return np.asarray(new[~close.any(axis=1)])
