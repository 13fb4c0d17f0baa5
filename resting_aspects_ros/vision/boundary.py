"""The boundary of an outline as points, with the distance to it and the effect of its mesh."""

from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from scipy.spatial import cKDTree

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.symmetry import SYMMETRY_TOLERANCE
from resting_aspects_ros.part.tessellation import CURVED_STEP, MARGIN, MAX_WIDTH_RATIO

# Spacing of the grid of the second attempt, as a share of the root of the area.
GRID = 1e-7


def common_area(one: shapely.Polygon, other: shapely.Polygon) -> float:
    """Return the area of the intersection of two polygons, m2.

    GEOS 3.14 finds only a few common points of some convex polygons that differ by rounding errors
    alone. They are then moved to a grid, which takes ten times as long.
    """
    area = float(shapely.intersection(one, other).area)
    if area == 0 and shapely.intersects(one, other):
        grid = GRID * float(one.area) ** 0.5
        area = float(shapely.intersection(one, other, grid_size=grid).area)
    return area


def normal_equations(
    points: Array, ways: Array, normals: Array, scale: float | Array
) -> tuple[Array, Array]:
    """Return the equations of least squares for a turn about the centroid and a shift.

    The turn is multiplied by ``scale``, m, which may be (k,).

    Parameters
    ----------
    points, ways, normals : (k, m, 2) float
        Points, ways to the nearest pieces, and the normals of these, in the frame of the model.

    Returns
    -------
    square : (k, 3, 3) float
    right : (k, 3) float
    """
    off = (ways * normals).sum(axis=2)
    lever = points[..., 0] * normals[..., 1] - points[..., 1] * normals[..., 0]
    lever /= np.reshape(scale, (-1, 1))
    design = np.concatenate([lever[..., None], normals], axis=2)
    number = points.shape[1]
    square = np.einsum('kmi,kmj->kij', design, design) / number + 1e-9 * np.eye(3)
    return square, np.einsum('kmi,km->ki', design, off) / number


def turned(points: Array, yaws: Array) -> Array:
    """Return points (k, m, 2) rotated by yaws (k,)."""
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=2)


# -- Boundaries -----------------------------------------------------------------------------------


# Two outlines are equal if their boundaries are closer than this share of the maximum radius about
# the centroid, in addition to the effect of the tessellation: the tolerance of `Symmetry`.
SAME = SYMMETRY_TOLERANCE
# Minimum number of points on a boundary, beside its vertices.
POINTS = 300
# Angles of rays in a signature, and the powers of the radius that are summed along a ray.
RAYS, POWERS = 360, (1, 2)
# Boundaries with more vertices are simplified by this share of the radius, to limit the time.
MAX_VERTICES, ROUGH = 1000, 2e-4
# Every how many points are tested first, because most rotations do not fit.
FEW = 16
# Number of random rotations of each point in the test whether an outline is round.
TURNS = 3


class Boundary:
    """The exterior and the holes of a polygon, about its centroid, as pieces of segments.

    centre : (2,) float
        The centroid, m.
    radius : float
        Maximum distance of the boundary from the centroid, m.
    points : (k, 2) float
        Starts of the pieces, relative to the centroid, m.
    along : (k, 2) float
        From the start of each piece to its end, m.
    squares : (k,) float
        Their squared lengths, m^2.
    sides : (2, k) int
        The pieces that start and that end at each point.
    skins : (k,) float
        Depth of the true curve over the pieces, m.
    """

    def __init__(self, polygon: shapely.Polygon) -> None:
        """Divide all rings into pieces of similar lengths."""
        polygon = shapely.geometry.polygon.orient(polygon)  # the signature depends on it
        self.centre = shapely.get_coordinates(polygon.centroid)[0]
        corners = shapely.get_coordinates(polygon.exterior)
        self.radius = float(np.linalg.norm(corners - self.centre, axis=1).max())
        if shapely.get_num_coordinates(polygon) > MAX_VERTICES:
            polygon = polygon.simplify(ROUGH * self.radius)
        rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(polygon)]
        spacing = polygon.length / POINTS
        pieces = [_pieces(ring - self.centre, spacing) for ring in rings]
        self.points = np.concatenate([start for start, *_ in pieces])
        self._ends = np.concatenate([end for _, end, _ in pieces])
        self.skins = np.concatenate([skin for *_, skin in pieces])
        first = np.cumsum([0, *(len(start) for start, *_ in pieces)])
        before = [np.roll(np.arange(a, b), 1) for a, b in pairwise(first)]
        self.sides = np.stack([np.arange(len(self.points)), np.concatenate(before)])
        self.along = self._ends - self.points
        self.squares = (self.along**2).sum(axis=1)
        self._tree = cKDTree(self.points)  # KDTree takes longer for few points

    def nearest(self, points: Array) -> tuple[Array, Indices]:
        """Return the ways (n, 2) from points to the boundary and the pieces where they end."""
        pieces = self.sides[:, self._tree.query(points)[1]]
        return nearest_on_pieces(points, pieces, self.points, self.along, self.squares)

    @cached_property
    def normals(self) -> Array:
        """(k, 2) float: unit normals of the pieces."""
        along = self.along / np.linalg.norm(self.along, axis=1)[:, None]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)

    def excess(self, points: Array, skins: Array) -> Array:
        """Return distances (n,) of points beyond the effect of the meshes, m; may be negative."""
        way, piece = self.nearest(points)
        return np.asarray(np.linalg.norm(way, axis=1) - skins - self.skins[piece])

    def equals(self, other: 'Boundary', yaw: float, shift: Array, play: float = 0.0) -> bool:
        """Return whether this boundary, rotated and then shifted, equals another one.

        ``yaw`` is in rad; ``shift`` (2,), m, is of the centroid, relative to the other's.
        ``play``, m, is added to the tolerance, SAME times the larger radius.
        """
        matrix, tolerance = turn(yaw), SAME * max(self.radius, other.radius) + play
        for some in (slice(None, None, FEW), slice(None)):
            moved = self.points[some] @ matrix.T + shift
            if (other.excess(moved, self.skins[some]) > tolerance).any():
                return False
        back = (other.points - shift) @ matrix
        return bool((self.excess(back, other.skins) <= tolerance).all())

    def is_round(self) -> bool:
        """Return whether any rotation about the centroid leaves the boundary as it is.

        Each point is rotated by its own angles, so that no order of rotation is mistaken for it.
        """
        generator = np.random.default_rng(20)  # any angles are suitable; these are reproducible
        for _ in range(TURNS):
            angle = generator.uniform(0, 2 * np.pi, len(self.points))
            moved = turned(self.points[:, None], angle)[:, 0]
            if (self.excess(moved, self.skins) > SAME * self.radius).any():
                return False
        return True

    def has_order(self, n: int) -> bool:
        """Return whether rotations by 360 / n degrees leave the boundary as it is."""
        # Not only the smallest rotation, which may fit because it hardly moves the boundary.
        steps = 2 ** np.arange(np.ceil(np.log2(n)))[::-1]
        return all(self.equals(self, 2 * np.pi * k / n, np.zeros(2)) for k in steps)

    @cached_property
    def signature(self) -> Array:
        """(len(POWERS), RAYS) float: integrals of the polygon along rays from the centroid.

        Row p is the sum of r^p over the crossings of a ray with the boundary, with a sign: outward
        crossings are positive. It rotates with the outline and contains its holes.
        """
        start, end = self.points, self._ends
        cross = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
        step = 2 * np.pi / RAYS
        a = np.arctan2(start[:, 1], start[:, 0])
        b = a + np.arctan2(cross, (start * end).sum(axis=1))
        low, high = np.ceil(np.minimum(a, b) / step), np.ceil(np.maximum(a, b) / step)
        count = (high - low).astype(np.int64)
        piece = np.repeat(np.arange(len(start)), count)
        offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        ray = low[piece].astype(np.int64) + offset
        direction = np.stack([np.cos(ray * step), np.sin(ray * step)], axis=1)
        along = (end - start)[piece]
        slope = direction[:, 0] * along[:, 1] - direction[:, 1] * along[:, 0]
        r = cross[piece] / np.where(slope == 0, np.inf, slope)
        sums = [
            np.bincount(ray % RAYS, np.sign(cross[piece]) * np.abs(r) ** p, RAYS) for p in POWERS
        ]
        return np.array(sums)


def nearest_on_pieces(
    points: Array, pieces: Indices, starts: Array, along: Array, squares: Array
) -> tuple[Array, Indices]:
    """Return the ways (n, 2) from points to the nearer one of two pieces (2, n), and that piece.

    ``starts`` (k, 2), ``along`` (k, 2) and ``squares`` (k,) describe all pieces; see Boundary.
    """
    # Sums of two terms are faster than sum(axis=-1).
    u, v = np.moveaxis(along[pieces], -1, 0)
    x, y = np.moveaxis(starts[pieces] - points, -1, 0)
    share = np.clip(-(x * u + y * v) / squares[pieces], 0, 1)
    x, y = x + share * u, y + share * v
    square = x * x + y * y
    first = square[0] <= square[1]
    way = np.stack([np.where(first, x[0], x[1]), np.where(first, y[0], y[1])], axis=1)
    return way, np.where(first, pieces[0], pieces[1])


def turn(angle: float) -> Array:
    """Return the matrix (2, 2) of a counter-clockwise rotation, rad."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def placed(shape: shapely.Geometry, x: float, y: float, yaw: float) -> shapely.Geometry:
    """Return a shape after a rotation about the origin, rad, and a translation."""
    return shapely.transform(shape, lambda points: points @ turn(yaw).T + (x, y))


def _pieces(ring: Array, spacing: float) -> tuple[Array, Array, Array]:
    """Return the starts, ends and skins of pieces of a ring, the first point being the last."""
    along = np.diff(ring, axis=0)
    length = np.linalg.norm(along, axis=1)
    skins = _skins(along, length)
    count = np.maximum(np.ceil(length / spacing), 1).astype(np.int64)
    edge = np.repeat(np.arange(len(along)), count)
    share = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)) / count[edge]
    start = ring[edge] + share[:, None] * along[edge]
    return start, np.roll(start, -1, axis=0), skins[edge]


def _skins(along: Array, length: Array) -> Array:
    """Return the depth of the true curve over each edge of a ring, m, as `sagittas` does.

    An edge between two bends of angle a on a curve has the slope a / 2 at its ends, so that the
    curve rises by length x a / 8. Bends above CURVED_STEP are corners.
    """
    following, after = np.roll(along, -1, axis=0), np.roll(length, -1)
    cross = along[:, 0] * following[:, 1] - along[:, 1] * following[:, 0]
    bend = np.abs(np.arctan2(cross, (along * following).sum(axis=1)))
    bend[bend > CURVED_STEP] = 0.0
    # A long edge beside a fillet is not curved.
    here = np.minimum(length, MAX_WIDTH_RATIO * after) * bend
    there = np.roll(np.minimum(after, MAX_WIDTH_RATIO * length) * bend, 1)
    return np.asarray(MARGIN * (here + there) / 16)
