"""The silhouette of a mesh: the union of its projected triangles, without effects of rounding.

A union of a million triangles would take half a minute. So upward triangles that share edges are
first merged to patches, by cancelling the edges between them; a patch is used if its area is the
sum of those of its triangles, so that it does not overlap itself.
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
# small.
MAX_GAP = 1e-3
# Mean number of triangles in a patch.
PATCH = 128
# Sides of cells in which slivers are stacked, in steps of the mesh (root of the median area of a
# triangle seen from above), and the minimum number of slivers in a stack.
STACK_STEPS, MIN_STACK = 1.0, 16
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
    plane = corners[:, :2] / radius
    triangles = plane[faces]
    twice = _cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    if not closed:
        faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
        twice = np.abs(twice)
    seen = twice > ROUNDING**2 * 1e-3
    union = _union(plane, faces[seen], twice[seen] / 2)
    cleaned = _cleaned(union)
    scaled = shapely.transform(cleaned, lambda points: points * radius)
    return shapely.geometry.polygon.orient(scaled)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _union(plane: Array, faces: Indices, area: Array) -> shapely.Geometry:
    """Return the union of the projections of counter-clockwise triangles."""
    patches, rest = _patches(plane, faces, area)
    union = shapely.union_all(patches, grid_size=GRID)
    if len(rest):
        step = float(np.sqrt(np.median(area)))
        others = shapely.union_all(_without_walls(rest, step), grid_size=GRID)
        union = shapely.union(union, others, grid_size=GRID)
    return union


def _without_walls(triangles: Array, step: float) -> npt.NDArray[np.object_]:
    """Return polygons that cover triangles (k, 3, 2), with the hull of each stack of slivers.

    The vertical walls of a scan are such stacks: noise turns half of their triangles upward. In a
    cell of a few steps of the mesh the hull is narrower than 2 MAX_GAP, so that it adds less.
    """
    cell = np.floor(triangles.mean(axis=1) / max(STACK_STEPS * step, ROUNDING)).astype(np.int64)
    cell -= cell.min(axis=0)
    _, stack, size = np.unique(cell @ [1 << 32, 1], return_inverse=True, return_counts=True)
    order = np.argsort(np.repeat(stack, 3), kind='stable')
    points = shapely.points(triangles.reshape(-1, 2)[order])
    hulls = shapely.convex_hull(shapely.multipoints(points, indices=np.repeat(stack, 3)[order]))
    width = 2 * shapely.area(hulls) / np.maximum(shapely.length(hulls), ROUNDING)
    walls = (size >= MIN_STACK) & (width < 2 * MAX_GAP)
    return np.concatenate([hulls[walls], shapely.polygons(triangles[~walls[stack]])])


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
    return outline


def _closed(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, gap), -gap)


def _opened(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, -gap), gap)


def _offset(shape: shapely.Geometry, distance: float) -> shapely.Geometry:
    return shape.buffer(distance, join_style='mitre')
