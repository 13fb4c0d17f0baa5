"""A tree of boxes that finds the triangles of a surface near many points at once."""

from collections.abc import Callable, Iterator

import numpy as np

from resting_aspects_ros.arrays import Array, Flags, Indices

Found = Callable[[Indices, Indices], Flags]

# Number of points that descend the tree together, which limits the memory.
BATCH = 1024
# Mean number of boxes per point above which one triangle of each box is tested early.
CROWDED = 1
# Maximum number of pairs of points and boxes, unless they are of a single point.
MAX_PAIRS = 500_000
# Number of triangles of a point that are tested first; each further step tests this factor more.
FEW = 4


class TriangleTree:
    """Triangles in a tree of boxes; each box is split across its longest side.

    The tree is complete: triangles are repeated up to a power of two, so that each level is one
    array and the children of a node follow from its number.
    """

    def __init__(self, corners: Array, skins: Array | None = None) -> None:
        """Build the tree of triangles (m, 3 corners, 3), m.

        skins : (m,) float64, maximum distance of the true surface from each triangle, m, which is
        used as the thickness of the triangle; by default 0.
        """
        skins = np.zeros(len(corners)) if skins is None else skins
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

    def near(self, points: Array, reach: Array, skins: Array) -> Flags:
        """Return which points (n, 3) are within their reach (n,) of the surface, m.

        The larger of the skin of the triangle and the skin of the point, (n,) m, is added to it.
        """
        near = np.zeros(len(points), dtype=bool)

        def found(at: Indices, piece: Indices) -> Flags:
            apart = _ways_to(self._corners[piece], points[at])
            max_distance = reach[at] + np.maximum(skins[at], self._skins[piece])
            near[at[np.einsum('ij,ij->i', apart, apart) <= max_distance**2]] = True
            return near[at]

        for point, triangle in self._pairs(points, reach + skins, found):
            # A few triangles of each point at a time, because most points need no more.
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
        """Return the points (k,) within reach of a triangle, the triangle, and the offset to it.

        The offset (k, 3) leads from the point to the nearest point of the triangle, m.
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

    def distances(self, points: Array, about: float) -> tuple[Array, Indices]:
        """Return the distances (n,) of points (n, 3), m, and the nearest triangles (n,).

        about : float
            Expected distance, more than 0; it only affects the time.
        """
        found, owner = np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
        left, reach = np.arange(len(points)), about
        while len(left):
            near, triangle, ways = self.nearest(points[left], reach)
            found[left[near]] = np.linalg.norm(ways, axis=1)
            owner[left[near]] = triangle
            left, reach = np.delete(left, near), 2 * reach
        return found, owner

    def _pairs(
        self, points: Array, reach: Array, found: Found | None = None
    ) -> Iterator[tuple[Indices, Indices]]:
        """Yield points with the triangles whose boxes are within reach, in ascending order.

        found : callable, optional
            Returns for pairs of a point and a triangle whether the point is finished. It is called
            during the descent where boxes overlap, such as those of the needles of a fan.
        """
        for start in range(0, len(points), BATCH):
            point = np.arange(start, min(start + BATCH, len(points)))
            groups = [(1, point, np.zeros(len(point), dtype=np.int64), CROWDED * BATCH)]
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
    """Return the offsets (k, 3) from points (k, 3) to the nearest points of triangles (k, 3, 3).

    It is the perpendicular if its foot is inside the triangle, else the offset to the nearest
    edge, which is robust for needles.
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
    """Return the triangles of each group, (groups, size), split across its longest side.

    middles : (3, m) float64, by axis, so that each row is contiguous in memory.
    """
    at = [along[groups] for along in middles]
    longest = np.argmax([along.max(axis=1) - along.min(axis=1) for along in at], axis=0)
    along = np.choose(longest[:, None], at)
    half = groups.shape[1] // 2
    return np.take_along_axis(groups, np.argpartition(along, half, axis=1), axis=1)


def face_normals(corners: Array) -> Array:
    """Return normals (m, 3) of triangles (m, 3, 3); their lengths are twice the areas."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.cross(b - a, c - a)


def subdivide(corners: Array, max_edge: float, max_pieces: int) -> tuple[Array, Indices]:
    """Return triangles (m, 3, 3) split at their longest edges until these are short enough.

    The result is the corners of the pieces, (k, 3, 3), and the original triangle of each, (k,).
    The splitting stops at ``max_pieces``.
    """
    whole = np.arange(len(corners))
    while len(corners) < max_pieces:
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        long = lengths.max(axis=1) > max_edge
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
