"""Curved sides of a mesh surface with fewer triangles, within a measured distance of all of them.

Bullet searches a contact between a part and each triangle near it in each step. A finely meshed
curved side therefore costs time for triangles that the part cannot distinguish. Borders are kept,
so that no gap is left beside a flat side. Lengths are in hull radii R.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.geometry.surface_distance import TriangleTree, subdivide
from resting_aspects_ros.core.rotations import Array

Indices = npt.NDArray[np.int64]

# Maximum distance between the triangles and those that replace them, in both directions. It is
# half of the distance at which a part touches a surface.
TOLERANCE = 0.005
# Fewer triangles are not simplified.
MIN_TRIANGLES = 32
# Aggressiveness of the decimation: less reaches no small numbers, more has larger errors.
AGGRESSIVENESS = 5
# The distance is measured at all corners and at points between them that are this close, unless
# there are more than MAX_PIECES triangles.
SPACING = 0.2
MAX_PIECES = 200_000
# Factor between two numbers of triangles that are tried.
FINER = 1.15
# A side is a facet of a curved side if it is bounded by smaller angles, rad, on more than half of
# its outline, and the arc that it replaces is less than TOLERANCE away.
GENTLE = 0.3


@dataclass(frozen=True, eq=False)
class CurvedSides:
    """Triangles (m, 3) of vertices (n, 3), and their maximum distance from the real ones, R."""

    vertices: Array
    triangles: Indices
    distance: float


def simplified(vertices: Array, triangles: Indices) -> CurvedSides:
    """Return as few triangles as a search finds within TOLERANCE; the same ones if none are.

    Without fast-simplification, the triangles are the same.

    Parameters
    ----------
    vertices, triangles : (n, 3) float, R, and (m, 3) int
    """
    unchanged = CurvedSides(vertices, triangles, 0.0)
    corners, faces = welded(vertices[triangles])
    try:
        import fast_simplification
    except ImportError:
        return unchanged
    if len(faces) < MIN_TRIANGLES:
        return unchanged
    real = _Surface(corners[faces])
    found = unchanged

    def tried(number: int) -> CurvedSides | None:
        points, left = fast_simplification.simplify(
            corners,
            faces.astype(np.int32),
            target_count=number,
            agg=AGGRESSIVENESS,
            preserve_border=True,
        )
        left = np.asarray(left, dtype=np.int64)
        if not 0 < len(left) < len(found.triangles):
            return None
        distance = real.distance(_Surface(points[left]))
        return CurvedSides(points, left, distance) if distance <= TOLERANCE else None

    # The distance does not grow steadily with a smaller number: halve it until it is too large,
    # and search the smallest number between.
    few, many = len(faces), len(faces)
    while few > MIN_TRIANGLES:
        few //= 2
        better = tried(few)
        if better is None:
            break
        found, many = better, few
    while many > few * FINER:
        middle = round((few * many) ** 0.5)
        better = tried(middle)
        if better is None:
            few = middle
        else:
            found, many = better, middle
    return found


def welded(corners: Array) -> tuple[Array, Indices]:
    """Return vertices and triangles of the corners (m, 3, 3), without those of no area."""
    points, rows = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = np.asarray(rows, dtype=np.int64).reshape(-1, 3)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    return points, faces[np.cross(b - a, c - a).any(axis=1)]


class _Surface:
    """Triangles (m, 3, 3) with points on them."""

    def __init__(self, corners: Array) -> None:
        self.tree = TriangleTree(corners, np.zeros(len(corners)))
        pieces = subdivide(corners, SPACING, MAX_PIECES)[0]
        self.points = np.unique(pieces.reshape(-1, 3), axis=0)

    def distance(self, other: '_Surface') -> float:
        """Return the Hausdorff distance, or infinity if it is larger than twice TOLERANCE."""
        return max(_furthest(self.points, other.tree), _furthest(other.points, self.tree))


def _furthest(points: Array, tree: TriangleTree) -> float:
    point, _, way = tree.nearest(points, 2 * TOLERANCE)
    if len(point) < len(points):
        return np.inf
    return float(np.linalg.norm(way, axis=1).max())


class Bends:
    """The angles between the triangles (m, 3, 3) of a mesh that share an edge."""

    def __init__(self, corners: Array) -> None:
        _, rows = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        ends = rows.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)[1].ravel()
        order = np.argsort(edge, kind='stable')
        count = np.bincount(edge)
        first = (np.cumsum(count) - count)[count == 2]
        one, other = order[first], order[first + 1]
        self._neighbour = np.full(len(edge), -1)
        self._neighbour[one], self._neighbour[other] = other // 3, one // 3
        ways = np.roll(corners, -1, axis=1) - corners
        self._length = np.linalg.norm(ways, axis=2).ravel()
        normals = np.cross(ways[:, 0], ways[:, 1])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        cosine = (normals[one // 3] * normals[other // 3]).sum(axis=1)
        self._angle = np.full(len(edge), np.pi)
        self._angle[one] = self._angle[other] = np.arccos(np.clip(cosine, -1, 1))

    def sagitta(self, which: Indices, width: float) -> float:
        """Return the height of the arc that a flat side of triangles replaces; infinite if none.

        An arc that bends by an angle at each edge of its chords of a width is this far from them.
        """
        edges = (3 * which[:, None] + np.arange(3)).ravel()
        outline = edges[~np.isin(self._neighbour[edges], which)]
        length, angle = self._length[outline], self._angle[outline]
        gentle = angle < GENTLE
        if length[gentle].sum() <= length.sum() / 2:
            return np.inf
        return width * float(np.average(angle[gentle], weights=length[gentle])) / 8
