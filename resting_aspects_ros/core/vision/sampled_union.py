"""The union of many triangles, from a grid of samples and the exact crossings of its lines.

The union of the triangles of a scan is slow, because the noise of its walls makes hundreds of them
overlap. Here its time depends on the number of crossings only. The border of the union is exact
where it crosses a line of the grid and straight in between, so that corners are cut by less than a
step of the grid, and gaps and slivers narrower than a step can be missed.
"""

from typing import NamedTuple

import contourpy
import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.core.geometry.triangle_edges import triangle_edges

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# The first line is this far outside, in steps; it is not a simple fraction, so that the sides of
# most parts are between lines.
_MARGIN = 1.6180339887


def sampled_union(plane: Array, faces: Indices, step: float) -> shapely.Geometry:
    """Return the union of counter-clockwise triangles as a polygon or multipolygon.

    Parameters
    ----------
    plane : (n, 2) float
        Corners.
    faces : (m, 3) int
        At least one triangle with an area.
    step : float
        Distance of the lines of the grid, in the unit of ``plane``.
    """
    used = plane[faces].reshape(-1, 2)
    low = used.min(axis=0) - _MARGIN * step
    size = np.ceil((used.max(axis=0) - low) / step + _MARGIN).astype(np.int64)
    ends, weight = _border((plane - low) / step, faces)
    rows = _crossings(ends, size)
    columns = _crossings(ends[:, :, ::-1], size[::-1])
    covered = _covered(rows, weight, size)
    contours = contourpy.contour_generator(
        z=covered, name='serial', fill_type=contourpy.FillType.OuterOffset
    )
    polygons = []
    for points, offsets in zip(*contours.filled(0.5, 2.0), strict=True):
        on_row = points[:, 0] % 1 != 0  # else on a column
        points[on_row, 0] = _outermost(rows, points[on_row], covered)
        points[~on_row, 1] = _outermost(columns, points[~on_row, ::-1], covered.T)
        outer, *holes = np.split(points * step + low, offsets[1:-1])
        polygons.append(shapely.Polygon(outer, holes))
    return shapely.union_all(shapely.make_valid(polygons))


def _border(plane: Array, faces: Indices) -> tuple[Array, Indices]:
    """Return the edges (k, 2, 2) that do not cancel, and their weights (k,).

    The weight is the number of triangles that use the edge in its direction, minus the others.
    """
    edges = triangle_edges(faces)
    weight = np.bincount(edges.number, weights=edges.direction).astype(np.int64)
    use = np.empty_like(weight)
    use[edges.number] = np.arange(len(edges.number))
    use = use[weight != 0]  # one use of each edge that does not cancel
    ends = np.stack([faces.ravel()[use], np.roll(faces, -1, axis=1).ravel()[use]], axis=1)
    return plane[ends], (weight[edges.number] * edges.direction)[use]


class _Crossings(NamedTuple):
    """Where edges cross the rows y = 0, 1, 2, ... of a grid; sorted by edge."""

    edge: Indices  # (n,)
    upward: npt.NDArray[np.bool_]  # (n,)
    x: Array  # (n,)
    sample: Indices  # (n,), row * columns + column of the first sample at or after the crossing


def _crossings(ends: Array, size: Indices) -> _Crossings:
    """Return the crossings of edges (k, 2, 2) with a grid of ``size``, (columns, rows)."""
    upward = ends[:, 0, 1] <= ends[:, 1, 1]
    low = np.where(upward[:, None], ends[:, 0], ends[:, 1])
    high = np.where(upward[:, None], ends[:, 1], ends[:, 0])
    first = np.ceil(low[:, 1]).astype(np.int64)
    count = np.ceil(high[:, 1]).astype(np.int64) - first
    edge = np.repeat(np.arange(len(ends)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
    way = high - low
    slope = way[:, 0] / np.where(count > 0, way[:, 1], 1.0)
    x = low[edge, 0] + (row - low[edge, 1]) * slope[edge]
    return _Crossings(edge, upward[edge], x, row * size[0] + np.ceil(x).astype(np.int64))


def _covered(rows: _Crossings, weight: Indices, size: Indices) -> Array:
    """Return 1 for the samples (rows, columns) that a triangle covers, 0 for the others."""
    count = np.zeros(size[0] * size[1], dtype=np.int32)  # the grid is large, so in place
    np.add.at(count, rows.sample, np.where(rows.upward, -weight[rows.edge], weight[rows.edge]))
    count = count.reshape(size[1], size[0])
    np.cumsum(count, axis=1, out=count)
    return (count > 0).astype(np.float64)


def _outermost(rows: _Crossings, points: Array, covered: Array) -> Array:
    """Return x of the outermost crossing at points (n, 2) between two samples of a row.

    One of the two samples is covered. Where rounding hides the crossing, x is unchanged.
    """
    after, row = np.ceil(points[:, 0]).astype(np.int64), points[:, 1].astype(np.int64)
    sample = row * covered.shape[1] + after
    wanted = np.zeros(covered.size, dtype=bool)
    wanted[sample] = True
    here = np.flatnonzero(wanted[rows.sample])
    here = here[np.lexsort((rows.x[here], rows.sample[here]))]
    first = np.searchsorted(rows.sample[here], sample, side='left')
    last = np.searchsorted(rows.sample[here], sample, side='right') - 1
    found = last >= first
    enters = covered[row, after] > 0
    x: Array = points[:, 0].copy()
    x[found] = rows.x[here[np.where(enters, first, last)[found]]]
    return x
