"""Which points lie near a surface of triangles: a tree of boxes, asked for many points at once."""

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Found = Callable[[Indices, Indices], Flags]

# Points that go down the tree together: what bounds the memory.
TOGETHER = 1024
# Boxes for each of those points from which on one triangle of each box is looked at.
CROWDED = 32
# Pairs of points and boxes that are kept, if they are of more than one point.
MAX_PAIRS = 500_000
# Triangles of a point that are looked at first; then so many times more, and so on.
FEW = 4


class TriangleTree:
    """Triangles in a tree of boxes; each box is cut in half across its longest side.

    The tree is full: the triangles are repeated to a power of two, so that a level is one array
    and a node's children are found by its number.
    """

    def __init__(self, corners: Array, skins: Array) -> None:
        """Build the tree of triangles (m, 3 corners, 3), m.

        skins : (m,) float64, by how much the true surface may be off each triangle, m: it counts
        as that thick.
        """
        self._corners, self._skins = corners, skins
        depth = int(np.ceil(np.log2(len(corners))))
        order = np.arange(2**depth) % len(corners)
        middles = np.ascontiguousarray(corners.mean(axis=1).T)
        for level in range(depth):
            order = _halved(order.reshape(2**level, -1), middles)
        self._triangle = order.ravel()
        low = (corners.min(axis=1) - skins[:, None])[self._triangle]
        high = (corners.max(axis=1) + skins[:, None])[self._triangle]
        self._levels = [(low, high)]
        while len(low) > 1:
            low = low.reshape(-1, 2, 3).min(axis=1)
            high = high.reshape(-1, 2, 3).max(axis=1)
            self._levels.insert(0, (low, high))

    def near(self, points: Array, reach: float, skins: Array) -> Flags:
        """Tell which points (n, 3) are within reach of the surface, m.

        The reach is on top of the thicker of the triangle's skin and the point's own, (n,) m.
        """
        near = np.zeros(len(points), dtype=bool)

        def found(at: Indices, piece: Indices) -> Flags:
            apart = _ways_to(self._corners[piece], points[at])
            allowed = reach + np.maximum(skins[at], self._skins[piece])
            near[at[np.einsum('ij,ij->i', apart, apart) <= allowed**2]] = True
            return near[at]

        for point, triangle in self._pairs(points, reach + skins, found):
            # A few triangles of each point at a time: most points need no more.
            rank = np.arange(len(point)) - np.searchsorted(point, point)
            left = np.arange(len(point))
            few = FEW
            while len(left):
                now = left[rank[left] < few]
                found(point[now], triangle[now])
                left = left[(rank[left] >= few) & ~near[point[left]]]
                few *= FEW
        return near

    def nearest(self, points: Array, reach: float) -> tuple[Indices, Indices, Array]:
        """Return (k,) points that have a triangle within reach, that one, and the way to it.

        The way, (k, 3), leads from the point to the nearest point of the triangle, m.
        """
        found: list[tuple[Indices, Indices, Array]] = [
            (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        ]
        for point, triangle in self._pairs(points, np.full(len(points), reach)):
            apart = _ways_to(self._corners[triangle], points[point])
            order = np.lexsort((np.einsum('ij,ij->i', apart, apart), point))
            first = order[np.flatnonzero(np.diff(point[order], prepend=-1))]
            found.append((point[first], triangle[first], apart[first]))
        point, triangle, apart = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return point, triangle, apart

    def _pairs(
        self, points: Array, reach: Array, found: Found | None = None
    ) -> Iterator[tuple[Indices, Indices]]:
        """Give points with the triangles whose box is within reach, ascending each time.

        found : callable, optional
            Tells of pairs of a point and a triangle whether the point can be left out. It is asked
            where boxes lie over each other, as those of the needles of a fan, on the way down.
        """
        for start in range(0, len(points), TOGETHER):
            point = np.arange(start, min(start + TOGETHER, len(points)))
            groups = [(1, point, np.zeros(len(point), dtype=np.int64), CROWDED * TOGETHER)]
            while groups:
                level, point, node, crowd = groups.pop()
                if found and len(point) > crowd:
                    crowd = 4 * len(point)
                    one = self._triangle[node << (len(self._levels) - level)]
                    left = ~found(point, one)
                    point, node = point[left], node[left]
                if not len(point):
                    continue
                if level == len(self._levels):
                    yield point, self._triangle[node]
                    continue
                low, high = self._levels[level]
                point, node = np.repeat(point, 2), np.repeat(2 * node, 2)
                node[1::2] += 1
                at = points[point]
                outside = np.maximum(np.maximum(low[node] - at, at - high[node]), 0.0)
                inside = np.einsum('ij,ij->i', outside, outside) <= reach[point] ** 2
                point, node = point[inside], node[inside]
                half = int(np.searchsorted(point, point[len(point) // 2])) if len(point) else 0
                parts = [slice(half, None), slice(0, half)]
                if not half or len(point) <= MAX_PAIRS:
                    parts = [slice(None)]
                groups += [(level + 1, point[part], node[part], crowd) for part in parts]


def _ways_to(corners: Array, points: Array) -> Array:
    """Return the ways (k, 3) from points (k, 3) to the nearest points of triangles (k, 3, 3).

    Straight down if that is inside, else to the nearest edge: so needles do no harm.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    arms = points[:, None] - corners
    squares = np.maximum(np.einsum('kei,kei->ke', edges, edges), np.finfo(float).tiny)
    along = np.clip(np.einsum('kei,kei->ke', edges, arms) / squares, 0, 1)
    to_edges = along[:, :, None] * edges - arms
    nearest = np.einsum('kei,kei->ke', to_edges, to_edges).argmin(axis=1)
    ways = to_edges[np.arange(len(points)), nearest]
    normal = np.cross(edges[:, 0], edges[:, 1])
    square = np.einsum('ki,ki->k', normal, normal)
    sides = np.einsum('kei,ki->ke', np.cross(edges, arms), normal)
    over = (sides >= 0).all(axis=1) & (square > 0)
    depth = np.einsum('ki,ki->k', arms[over, 0], normal[over]) / square[over]
    ways[over] = -depth[:, None] * normal[over]
    return np.asarray(ways)


def _halved(groups: Indices, middles: Array) -> Indices:
    """Order the triangles of each group, (groups, size), across the longest side of its box.

    middles : (3, m) float64, by axis: a row of one group is one row in memory.
    """
    at = [along[groups] for along in middles]
    longest = np.argmax([along.max(axis=1) - along.min(axis=1) for along in at], axis=0)
    along = np.choose(longest[:, None], at)
    half = groups.shape[1] // 2
    return np.take_along_axis(groups, np.argpartition(along, half, axis=1), axis=1)


def cut(corners: Array, longest: float, most: int) -> tuple[Array, Indices]:
    """Cut triangles (m, 3, 3) across their longest edges until those are short, or too many.

    Returns the corners of the pieces, (k, 3, 3), and the triangle that each is of, (k,).
    """
    whole = np.arange(len(corners))
    while len(corners) < most:
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        long = lengths.max(axis=1) > longest
        if not long.any():
            break
        first = lengths[long].argmax(axis=1)[:, None] + np.arange(3)
        a, b, c = np.moveaxis(
            np.take_along_axis(corners[long], (first % 3)[:, :, None], axis=1), 1, 0
        )
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        corners = np.concatenate([corners[~long], *halves])
        whole = np.concatenate([whole[~long], whole[long], whole[long]])
    return corners, whole
