"""The silhouette of a mesh: the union of its projected triangles, without effects of rounding.

A union of a million triangles would take half a minute. So the steep triangles of the walls of a
scan are first replaced by the hulls of stacks, and the other upward triangles that share edges are
merged to patches, by cancelling the edges between them; a patch is used if its area is the sum of
those of its triangles, so that it does not overlap itself.
"""

import numpy as np
import numpy.typing as npt
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from resting_aspects_ros.core.errors import PartError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Gaps, slivers and deviations from a straight line up to this, R, are effects of rounding.
ROUNDING = 1e-5
# Coordinates of unions are rounded to this, R. Without a grid, a union can lose a polygon whose
# border differs from that of another one by 1e-16 (GEOS 3.14).
GRID = 1e-9
# Pieces of a silhouette are joined over gaps up to twice this, R, or left out if they are so
# small; holes that are so small are filled.
MAX_GAP = 1e-3
# Mean number of triangles in a patch.
PATCH = 128
# A triangle is steep if its projection is smaller than this share of its area. Sides of cells in
# which steep triangles are stacked, in steps of the mesh (root of the median area of a triangle),
# and the minimum number of triangles in a stack.
STEEP, STACK_STEPS, MIN_STACK = 0.2, 1.0, 16
# Pieces with at most this number of points are left out of a union if they are inside the others.
MAX_SMALL = 6
# Relative difference of the areas of a patch and of its triangles.
_SAME_AREA = 1e-9


def silhouette(corners: Array, faces: Indices, closed: bool, radius: float) -> shapely.Polygon:
    """Return the union of the projected triangles of a mesh as a polygon.

    Its exterior is counter-clockwise, its holes are clockwise. Gaps and slivers narrower than
    2 ROUNDING, and vertices closer than ROUNDING to a straight line, are removed. Pieces are
    joined over gaps of up to 2 MAX_GAP.

    Parameters
    ----------
    corners : (n, 3) float
        m, with z up.
    faces : (m, 3) int
    closed : bool
        Whether the mesh is a closed solid with outward faces. Then upward faces are sufficient.
    radius : float
        R, m.

    Raises
    ------
    PartError
        If the silhouette has no area or several pieces.
    """
    scaled = corners / radius
    triangles = scaled[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice = normals[:, 2]
    if not closed:
        faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
        twice = np.abs(twice)
    seen = twice > ROUNDING**2 * 1e-3
    full = np.linalg.norm(normals[seen], axis=1) / 2
    union = _union(scaled[:, :2], faces[seen], twice[seen] / 2, full)
    cleaned = _cleaned(union)
    return shapely.geometry.polygon.orient(
        shapely.transform(cleaned, lambda points: points * radius)
    )


def _union(plane: Array, faces: Indices, area: Array, full: Array) -> shapely.Geometry:
    """Return the union of the projections of counter-clockwise triangles.

    ``area`` (k,) is that of the projection, ``full`` (k,) that of the triangle.
    """
    stacks, stacked = _stacks(plane[faces], area, full)
    patches, rest = _patches(plane, faces[~stacked], area[~stacked])
    small = shapely.get_num_coordinates(patches) <= MAX_SMALL
    union = shapely.union_all(np.concatenate([patches[~small], stacks]), grid_size=GRID)
    others = np.concatenate([patches[small], shapely.polygons(rest)])
    shapely.prepare(union)
    others = others[~shapely.contains_properly(union, others)]
    return shapely.union_all(np.append(others, union), grid_size=GRID)


def _stacks(
    triangles: Array, area: Array, full: Array
) -> tuple[npt.NDArray[np.object_], npt.NDArray[np.bool_]]:
    """Return the hulls of stacks of steep triangles, and which triangles (k,) are in them.

    The vertical walls of a scan are such stacks: noise turns half of their triangles upward. In a
    cell of a few steps of the mesh the hull is narrower than 2 MAX_GAP, so that it adds less.
    """
    stacked = np.zeros(len(triangles), dtype=np.bool_)
    steep = np.flatnonzero(area < STEEP * full)
    if len(steep) < MIN_STACK:
        return np.array([], dtype=object), stacked
    step = max(STACK_STEPS * float(np.sqrt(np.median(full))), ROUNDING)
    cell = np.floor(triangles[steep].mean(axis=1) / step).astype(np.int64)
    cell -= cell.min(axis=0)
    _, stack, size = np.unique(cell @ [1 << 32, 1], return_inverse=True, return_counts=True)
    order = np.argsort(stack, kind='stable')
    points = triangles[steep[order]].reshape(-1, 2)
    # Lines, because Shapely makes them from coordinates; multipoints are made from points.
    hulls = shapely.convex_hull(shapely.linestrings(points, indices=np.repeat(stack[order], 3)))
    width = 2 * shapely.area(hulls) / np.maximum(shapely.length(hulls), ROUNDING)
    walls = (size >= MIN_STACK) & (width < 2 * MAX_GAP)
    stacked[steep[walls[stack]]] = True
    return hulls[walls], stacked


def _patches(plane: Array, faces: Indices, area: Array) -> tuple[npt.NDArray[np.object_], Array]:
    """Return patches of triangles as polygons, and the triangles (k, 3, 2) that are in none."""
    if not len(faces):
        return np.array([], dtype=object), plane[faces]
    middle = plane[faces].mean(axis=1)
    steps = np.sqrt(len(faces) / PATCH) * (middle - middle.min(axis=0)) / np.ptp(plane)
    cell = np.floor(steps).astype(np.int64) @ np.array([1 << 20, 1])
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    low, high = np.minimum(start, end), np.maximum(start, end)
    edge = high * len(plane) + low
    order = np.argsort(edge, kind='stable')
    a, b = order[:-1], order[1:]
    twins = (edge[a] == edge[b]) & (start[a] != start[b]) & (cell[owner[a]] == cell[owner[b]])
    twins[1:] &= ~twins[:-1]  # each edge is in one pair at most
    a, b = a[twins], b[twins]
    links = (np.ones(len(a)), (owner[a], owner[b]))
    graph = coo_array(links, shape=(len(faces), len(faces)))
    count, patch = connected_components(graph, directed=False)
    outer = np.ones(len(start), dtype=bool)
    outer[a] = outer[b] = False
    outer = np.flatnonzero(outer)
    outer = outer[np.argsort(patch[owner[outer]], kind='stable')]
    lines = shapely.linestrings(np.stack([plane[start[outer]], plane[end[outer]]], axis=1))
    borders = np.full(count, None, dtype=object)
    shapely.multilinestrings(lines, indices=patch[owner[outer]], out=borders)
    borders[~shapely.is_simple(borders)] = None
    merged = shapely.build_area(borders)
    total = np.bincount(patch, weights=area, minlength=count)
    simple = np.abs(shapely.area(merged) - total) <= _SAME_AREA * total
    return merged[simple], plane[faces[~simple[patch]]]


def _cleaned(union: shapely.Geometry) -> shapely.Polygon:
    """Return a union, in units of R, as one polygon without effects of rounding."""
    outline = _opened(_closed(union.simplify(ROUNDING), ROUNDING), ROUNDING).simplify(ROUNDING)
    if shapely.get_num_geometries(outline) > 1:
        outline = _closed(outline, MAX_GAP).simplify(ROUNDING)
        pieces = shapely.get_parts(outline)
        large = pieces[shapely.area(pieces) > MAX_GAP**2]
        outline = large[0] if len(large) == 1 else outline
    if outline.is_empty:
        raise PartError('invalid outline: expected an area, but the mesh is seen from its edge')
    if not isinstance(outline, shapely.Polygon):
        raise PartError(
            f'invalid outline of {shapely.get_num_geometries(outline)} separate pieces: '
            f'expected a part whose outline is connected'
        )
    holes = [hole for hole in outline.interiors if shapely.Polygon(hole).area > MAX_GAP**2]
    return shapely.Polygon(outline.exterior, holes)


def _closed(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, gap), -gap)


def _opened(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, -gap), gap)


def _offset(shape: shapely.Geometry, distance: float) -> shapely.Geometry:
    return shape.buffer(distance, join_style='mitre')
