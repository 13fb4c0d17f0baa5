"""Flat sides of a mesh surface as convex prisms, which parts meet instead of triangles.

Bullet finds a contact of a part with each triangle by itself. That takes time for every triangle
near a part, and a corner that slides over the edge between two triangles of a flat side can be
kicked. Therefore the triangles of a wide flat side are merged into convex polygons, each of which
is the top of a prism inside the solid. All other triangles, and the facets of curved sides,
remain. Lengths are in hull radii R.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import KDTree

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.surroundings.convex_polygons import (
    clipped,
    convex_polygons,
    edge_planes,
    polygon_from,
)
from resting_aspects_ros.simulation.surroundings.curved_sides import TOLERANCE, Bends, simplified

Indices = npt.NDArray[np.int64]

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


@dataclass(frozen=True, eq=False)
class MergedMesh:
    """A mesh surface as convex prisms and triangles.

    prisms : tuple of (k, 3) float64
        Corners of the prisms, in the frame and unit of the mesh.
    vertices, triangles : (n, 3) float and (m, 3) int
        Triangles that were not merged, or the fewer that replace them.
    sides : int
        Number of flat sides that were merged into the prisms.
    distance : float
        Maximum distance of these triangles from the real ones, in the unit of the mesh.
    """

    prisms: tuple[Array, ...]
    vertices: Array
    triangles: Indices
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
    curved = simplified((vertices - origin) / radius, triangles[left])
    if not curved.distance:
        return MergedMesh(tuple(prisms), vertices, triangles[left], sides, 0.0)
    moved = curved.vertices * radius + origin
    return MergedMesh(tuple(prisms), moved, curved.triangles, sides, curved.distance * radius)


def _coplanar(corners: Array) -> Iterator[tuple[int, Indices]]:
    """Yield the largest triangle of each plane, and all triangles (k,) in this plane."""
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
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
            thickness = self._thickness(clipped(below, polygon))
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
        a, b, c = np.moveaxis(self._all[near], 1, 0)
        normals = np.cross(b - a, c - a)
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
