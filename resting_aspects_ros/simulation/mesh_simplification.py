"""A mesh surface in shapes that Bullet simulates well: wide flat sides and curved sides."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import KDTree

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.part.near import TriangleTree, face_normals, subdivide
from resting_aspects_ros.part.tessellation import mesh_edges
from resting_aspects_ros.simulation.scene import clipped

# -- Convex polygons ------------------------------------------------------------------------------


# A corner that lies deeper than this inside the convex hull is cut; a polygon without such corners
# is replaced by its hull.
CONVEX = 1e-3
# Pieces narrower than this are dropped.
SLIVER = 1e-3


def convex_polygons(polygon: shapely.Polygon, most: int) -> list[Array]:
    """Return convex polygons (k, 2), counterclockwise; none if there are more than ``most``.

    The polygon is cut along its own sides, beginning at the deepest corner.
    """
    left, found = [polygon], []
    while left:
        piece = left.pop()
        corner = _deepest(piece)
        if corner is None:
            outline = shapely.geometry.polygon.orient(piece.convex_hull).exterior
            found.append(np.array(outline.coords)[1:])
        else:
            left += _halves(piece, *corner)
        if len(found) + len(left) > most:
            return []
    return found


def _deepest(piece: shapely.Polygon) -> tuple[Array, Array] | None:
    """Return the corner deepest inside the hull and the direction of its side; None if convex."""
    hull = piece.convex_hull.exterior
    best, deepest = None, CONVEX
    for ring in (piece.exterior, *piece.interiors):
        points = np.array(ring.coords)[:-1]
        depths = shapely.distance(hull, shapely.points(points))
        k = int(np.argmax(depths))
        if depths[k] > deepest:
            deepest = float(depths[k])
            side = points[k] - points[k - 1]
            best = points[k], side / np.linalg.norm(side)
    return best


def _halves(piece: shapely.Polygon, point: Array, along: Array) -> list[shapely.Polygon]:
    """Return the pieces on both sides of a line through a point."""
    low, high = np.array(piece.bounds).reshape(2, 2)
    reach = 2 * float(np.linalg.norm(high - low)) * along
    found = []
    for across in (np.array([-reach[1], reach[0]]), np.array([reach[1], -reach[0]])):
        half = [point - reach, point + reach, point + reach + across, point - reach + across]
        parts = shapely.get_parts(shapely.intersection(piece, shapely.Polygon(half)))
        found += [
            part
            for part in parts
            if part.geom_type == 'Polygon' and not part.buffer(-SLIVER / 2).is_empty
        ]
    return found


def edge_planes(polygon: Array) -> tuple[Array, Array]:
    """Return outward normals (k, 2) and offsets (k,) of the sides of a convex polygon (k, 2)."""
    sides = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, (normals * polygon).sum(axis=1)


def polygon_from(polygon: Array, normals: Array, offsets: Array) -> Array:
    """Return the polygon (k, 2) in all half-planes ``normals @ x <= offsets``; (0, 2) if none.

    ``polygon`` (k, 2) determines how far it can extend.
    """
    low, high = polygon.min(axis=0) - 1.0, polygon.max(axis=0) + 1.0
    found = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for normal, offset in zip(normals, offsets, strict=True):
        found = clipped(found, normal, float(offset))
    return found


# -- Curved sides ---------------------------------------------------------------------------------


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


def simplified(vertices: Array, triangles: Indices) -> tuple[Array, float]:
    """Return as few triangles as a search finds within TOLERANCE; the same ones if none are.

    Returns their corners (l, 3, 3) and their maximum distance from the given ones, R. Without
    fast-simplification, the triangles are the same.

    Parameters
    ----------
    vertices, triangles : (n, 3) float, R, and (m, 3) int
    """
    found = vertices[triangles], 0.0
    corners, faces = welded(found[0])
    try:
        import fast_simplification
    except ImportError:
        return found
    if len(faces) < MIN_TRIANGLES:
        return found
    real = _Surface(corners[faces])

    def tried(number: int) -> tuple[Array, float] | None:
        points, left = fast_simplification.simplify(
            corners,
            faces.astype(np.int32),
            target_count=number,
            agg=AGGRESSIVENESS,
            preserve_border=True,
        )
        if not 0 < len(left) < len(found[0]):
            return None
        distance = real.distance(_Surface(points[left]))
        return (points[left], distance) if distance <= TOLERANCE else None

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
    return points, faces[face_normals(points[faces]).any(axis=1)]


class _Surface:
    """Triangles (m, 3, 3) with points on them."""

    def __init__(self, corners: Array) -> None:
        self.tree = TriangleTree(corners)
        pieces = subdivide(corners, SPACING, MAX_PIECES)[0]
        self.points = np.unique(pieces.reshape(-1, 3), axis=0)

    def distance(self, other: '_Surface') -> float:
        """Return the Hausdorff distance."""
        pairs = (self.points, other.tree), (other.points, self.tree)
        return max(float(tree.distances(at, 2 * TOLERANCE)[0].max()) for at, tree in pairs)


class Bends:
    """The angles between the triangles (m, 3, 3) of a mesh that share an edge."""

    def __init__(self, corners: Array) -> None:
        points, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        normals = face_normals(corners)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        self._edges = mesh_edges(faces.reshape(-1, 3), normals)
        ends = points[self._edges.ends]
        self._length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)

    def sagitta(self, which: Indices, width: float) -> float:
        """Return the height of the arc that a flat side of triangles replaces; infinite if none.

        An arc that bends by an angle at each edge of its chords of a width is this far from them.
        """
        one, other = np.isin(self._edges.sides, which).T
        ends = self._edges.sides[:, 0] == self._edges.sides[:, 1]
        outline = (one != other) | (one & ends)
        length, angle = self._length[outline], self._edges.angle[outline]
        gentle = angle < GENTLE
        if length[gentle].sum() <= length.sum() / 2:
            return np.inf
        return width * float(np.average(angle[gentle], weights=length[gentle])) / 8


# -- Flat sides -----------------------------------------------------------------------------------


# Triangles belong to one side if their normals differ by less than this, rad, and their corners
# are this close to its plane.
SAME_NORMAL = 1e-3
SAME_PLANE = 5e-4
# Narrower sides remain triangles: they are rims and facets of curved surfaces.
MIN_WIDTH = 0.25
# Depth of a prism, unless the solid is thinner. A part sinks in by at most 0.05 in one step.
DEPTH = 0.5
# A prism is continued by this into the solid where another side rises from its edge, so that no
# gap is left in the edge.
EXTENSION = 0.1
# Sides of more convex polygons than this remain triangles.
MAX_POLYGONS = 64
# Grid on which triangles are joined.
GRID = 1e-5
# Distance at which a point is on a line or on a surface.
NEAR = 1e-3


class MergedMesh(NamedTuple):
    """A mesh surface as convex prisms and triangles; see MeshBody."""

    prisms: tuple[Array, ...]
    remaining: Array
    sides: int
    distance: float


def merged_mesh(vertices: Array, triangles: Indices, radius: float) -> MergedMesh:
    """Return the flat sides of a mesh that are wide for a part of a hull radius as prisms.

    The other triangles are simplified.

    Parameters
    ----------
    vertices, triangles : (n, 3) float and (m, 3) int
        The triangles point outward.
    radius : float
        Hull radius of the part, in the unit of the vertices.
    """
    origin = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    corners = ((vertices - origin) / radius)[triangles]
    left = np.ones(len(triangles), dtype=bool)
    prisms: list[Array] = []
    sides = 0
    bends = Bends(corners)
    for seed, which in _coplanar(corners):
        for covered, found in _Side(corners, seed, which, bends).merged():
            left[covered] = False
            prisms += [prism * radius + origin for prism in found]
            sides += 1
    remaining, distance = simplified((vertices - origin) / radius, triangles[left])
    if not distance:
        return MergedMesh(tuple(prisms), vertices[triangles[left]], sides, 0.0)
    return MergedMesh(tuple(prisms), remaining * radius + origin, sides, distance * radius)


def _coplanar(corners: Array) -> Iterator[tuple[int, Indices]]:
    """Yield the largest triangle of each plane, and all triangles (k,) in this plane."""
    crossed = face_normals(corners)
    double = np.linalg.norm(crossed, axis=1)
    solid = np.flatnonzero(double > GRID**2)
    normals = crossed[solid] / double[solid, None]
    tree = KDTree(normals)
    alone = tree.query_ball_point(normals, SAME_NORMAL, return_length=True) == 1
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)[solid]
    free = ~(alone & (double[solid] / longest < MIN_WIDTH))
    for seed in np.argsort(-double[solid], kind='stable').tolist():
        if not free[seed]:
            continue
        near = np.sort(tree.query_ball_point(normals[seed], SAME_NORMAL))
        near = near[free[near]]
        apart = (corners[solid[near]] - corners[solid[seed], 0]) @ normals[seed]
        inside = near[np.abs(apart).max(axis=1) < SAME_PLANE]
        free[inside] = False
        free[seed] = False
        yield int(solid[seed]), solid[inside]


class _Side:
    """The triangles of a mesh in one plane, with the axes u, v and the normal of the plane."""

    def __init__(self, corners: Array, seed: int, which: Indices, bends: Bends) -> None:
        self._all, self._which, self._bends = corners, which, bends
        a, b, c = corners[seed]
        u = (b - a) / np.linalg.norm(b - a)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        self._origin, self._axes = a, np.array([u, np.cross(normal, u), normal])

    def merged(self) -> Iterator[tuple[Indices, list[Array]]]:
        """Yield triangles (k,) of each wide connected region, and the corners of its prisms."""
        flat = self._in_plane(self._all[self._which])[:, :, :2]
        region = shapely.union_all(shapely.polygons(flat), grid_size=GRID)
        middles = shapely.points(flat.mean(axis=1))
        for part in shapely.get_parts(region):
            if part.geom_type != 'Polygon' or part.buffer(-MIN_WIDTH / 2).is_empty:
                continue
            covered = self._which[shapely.intersects(part.buffer(GRID), middles)]
            width = 2 * shapely.maximum_inscribed_circle(part).length
            if self._bends.sagitta(covered, width) < TOLERANCE:
                continue
            outline = shapely.simplify(part, 10 * GRID)
            polygons = convex_polygons(outline, MAX_POLYGONS)
            if polygons:
                yield covered, [self._prism(each, outline.boundary) for each in polygons]

    def _in_plane(self, points: Array) -> Array:
        return np.asarray((points - self._origin) @ self._axes.T)

    def _in_space(self, points: Array, depth: float) -> Array:
        """Return points (n, 2) of the plane, at a depth below it."""
        return np.asarray(
            np.column_stack([points, np.full(len(points), -depth)]) @ self._axes + self._origin
        )

    def _prism(self, polygon: Array, boundary: shapely.Geometry) -> Array:
        """Return the corners of a prism below a convex polygon (k, 2).

        Its sides are inclined by 45 degrees at free edges, so that it stays within a solid with
        sharp edges, and upright where the next polygon of the side begins. Where another side
        rises, it is continued.
        """
        normals, offsets = edge_planes(polygon)
        ends = np.roll(polygon, -1, axis=0)
        middles = (polygon + ends) / 2
        at_boundary = shapely.distance(boundary, shapely.points(middles)) < NEAR
        room = np.zeros(len(polygon))
        for k in np.flatnonzero(at_boundary):
            room[k] = self._room_beyond(polygon[k], ends[k], normals[k])
        free = at_boundary & (room == 0)
        top = polygon_from(polygon, normals, offsets + room)
        depth, bottom = DEPTH, np.zeros((0, 2))
        for taper in (1.0, 1.0, 1.0, 0.5, 0.25, 0.0):
            bottom = polygon_from(polygon, normals, offsets + room - free * depth * taper)
            if not len(bottom):
                continue
            below = np.vstack([bottom, bottom.mean(axis=0)])
            inside = (below @ normals.T - offsets < -SLIVER / 10).all(axis=1)
            thickness = self._thickness(below[inside])
            if thickness >= depth:
                break
            depth = thickness
        return np.vstack([self._in_space(top, 0.0), self._in_space(bottom, depth)])

    def _thickness(self, points: Array) -> float:
        """Return the least distance from points (n, 2) of the side down to another surface."""
        down = -self._axes[2]
        starts = self._in_space(points, 0.0)
        return min((_ray(self._all, each, down) for each in starts), default=DEPTH)

    def _room_beyond(self, a: Array, b: Array, outward: Array) -> float:
        """Return by how much a prism can be continued beyond an edge; 0 at a free edge."""
        direction = np.append(outward, 0.0) @ self._axes
        found = EXTENSION
        for share in (0.1, 0.5, 0.9):
            point = self._in_space((a + share * (b - a))[None], 0.0)[0]
            if not self._rises(point, direction):
                return 0.0
            found = min(found, _ray(self._all, point - NEAR * self._axes[2], direction))
        return found

    def _rises(self, point: Array, direction: Array) -> bool:
        """Return whether a side that begins at a point of an edge faces this side."""
        near = _distances(self._all, point) < NEAR
        near[self._which] = False
        normals = face_normals(self._all[near])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) + GRID**2
        return bool((normals @ direction < -SAME_NORMAL).any())


def _ray(corners: Array, origin: Array, direction: Array) -> float:
    """Return the distance along a ray to the first of the triangles (m, 3, 3); inf if none."""
    a, b, c = np.moveaxis(corners, 1, 0)
    one, other = b - a, c - a
    across = np.cross(direction, other)
    determinant = (one * across).sum(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):  # triangles along the ray
        start = origin - a
        u = (start * across).sum(axis=1) / determinant
        turned = np.cross(start, one)
        v = (turned @ direction) / determinant
        distance = (other * turned).sum(axis=1) / determinant
        hit = (u >= -GRID) & (v >= -GRID) & (u + v <= 1 + GRID) & (distance > 2 * NEAR)
    return float(distance[hit].min(initial=np.inf))


def _distances(corners: Array, point: Array) -> Array:
    """Return the distances of a point from the edges of triangles (m, 3, 3), (m,)."""
    ways = np.roll(corners, -1, axis=1) - corners
    squared = (ways**2).sum(axis=2)
    along = ((point - corners) * ways).sum(axis=2) / np.maximum(squared, GRID**2)
    nearest = corners + np.clip(along, 0.0, 1.0)[:, :, None] * ways
    return np.asarray(np.linalg.norm(nearest - point, axis=2).min(axis=1))
