"""A small software renderer that finds the visible triangle of each pixel, without a GPU.

It uses parallel projection and a depth buffer, so that parts that are not convex look right.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Indices

Mask = npt.NDArray[np.bool_]

NOTHING = -1
# An edge is drawn where surfaces meet at more than 25 degrees, also across a fillet that is a few
# pixels wide, but not between the facets of a curved side.
CREASE = np.cos(np.radians(25.0))
# An edge is drawn at a step in depth of more than this, pixels.
STEP = 3.0
# Pixel centres this close outside a triangle count as inside, because rounding would leave holes.
BORDER = 1e-7


@dataclass(frozen=True, eq=False)
class Rendering:
    """The visible triangle of each pixel; row 0 is the lowest.

    face : (size, size) int
        Index of the triangle; NOTHING if there is none.
    depth : (size, size) float
        Depth towards the viewer, pixels; -inf if there is no triangle.
    slope : (m, 2) float
        Change of depth per pixel to the right and up, on each triangle that faces the viewer.
    """

    face: Indices
    depth: Array
    slope: Array


def rasterise(points: Array, faces: Indices, size: int) -> Rendering:
    """Find the nearest triangle in each pixel of a square picture.

    Parameters
    ----------
    points : (n, 3) float
        Coordinates to the right, up, and towards the viewer, pixels. The centre of pixel (row,
        column) is at (column + 0.5, row + 0.5).
    faces : (m, 3) int
        Counter-clockwise as seen from outside; triangles that face away are invisible.
    size : int
        Rows and columns of the picture.
    """
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.flatnonzero(normal[:, 2] > 1e-12)
    slope = np.zeros((len(faces), 2))
    slope[facing] = -normal[facing, :2] / normal[facing, 2:]
    face, row, column = _covered(corners, facing, size)

    first = corners[face, 0]
    along = np.stack([column + 0.5, row + 0.5], axis=1) - first[:, :2]
    heights = corners[face, :, 2]
    # Clipped to the depths of the corners: a triangle seen edge-on has an almost infinite slope.
    depth = np.clip(
        first[:, 2] + (slope[face] * along).sum(axis=1), heights.min(axis=1), heights.max(axis=1)
    )
    pixel = row * size + column
    nearest = np.full(size * size, -np.inf)
    np.maximum.at(nearest, pixel, depth)
    seen = np.full(size * size, NOTHING)
    on_top = depth == nearest[pixel]
    seen[pixel[on_top]] = face[on_top]
    return Rendering(seen.reshape(size, size), nearest.reshape(size, size), slope)


def edges(seen: Rendering, normals: Array) -> Mask:
    """Return the (size, size) mask of pixels on edges: outlines, steps in depth, and creases.

    Parameters
    ----------
    seen : Rendering
    normals : (m, 3) float
        Unit normals of the triangles, any frame.
    """
    size = len(seen.face)
    marked = np.zeros(size * size, dtype=bool)
    number = np.arange(size * size).reshape(size, size)
    for axis, near, far in ((0, number[:, :-1], number[:, 1:]), (1, number[:-1], number[1:])):
        differ = seen.face.ravel()[near] != seen.face.ravel()[far]
        a, b = near[differ], far[differ]
        edge = _is_edge(seen, normals, a, b, axis)
        marked[a[edge]] = marked[b[edge]] = True
    return marked.reshape(size, size)


def _is_edge(seen: Rendering, normals: Array, a: Indices, b: Indices, axis: int) -> Mask:
    """Return whether there is an edge between neighbouring pixels a and b (k,) that differ."""
    face_a, face_b = seen.face.ravel()[a], seen.face.ravel()[b]
    outline = (face_a == NOTHING) | (face_b == NOTHING)
    crease = (normals[face_a] * normals[face_b]).sum(axis=1) < CREASE
    with np.errstate(invalid='ignore'):  # -inf - -inf occurs only on outlines
        rise = seen.depth.ravel()[b] - seen.depth.ravel()[a]
    slopes = seen.slope[np.stack([face_a, face_b]), axis]
    step = np.abs(rise - slopes).min(axis=0) > STEP
    return outline | crease | step


def _covered(corners: Array, facing: Indices, size: int) -> tuple[Indices, Indices, Indices]:
    """Return triangle, row and column of every pixel whose centre is in a triangle."""
    y = corners[facing, :, 1]
    which, row = _spread(y.min(axis=1), y.max(axis=1), size)
    face = facing[which]
    low = np.full(len(row), -np.inf)
    high = np.full(len(row), np.inf)
    for start, stop in ((0, 1), (1, 2), (2, 0)):
        x0, y0 = corners[face, start, 0], corners[face, start, 1]
        dx, dy = corners[face, stop, 0] - x0, corners[face, stop, 1] - y0
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            crossing = x0 + dx * ((row + 0.5 - y0) / dy)
        # Counter-clockwise: the inside is left of an upward edge and right of a downward edge.
        np.minimum(high, crossing, out=high, where=dy > 0)
        np.maximum(low, crossing, out=low, where=dy < 0)
    which, column = _spread(low, high, size)
    return face[which], row[which], column


def _spread(low: Array, high: Array, size: int) -> tuple[Indices, Indices]:
    """Return, for every pixel centre in one of the ranges (k,), the range and the pixel index."""
    first = np.ceil(np.clip(low - 0.5 - BORDER, 0, size)).astype(np.int64)
    last = np.floor(np.clip(high - 0.5 + BORDER, -1, size - 1)).astype(np.int64)
    count = np.maximum(last - first + 1, 0)
    which = np.repeat(np.arange(len(count)), count)
    begin = np.cumsum(count) - count
    return which, first[which] + np.arange(len(which)) - begin[which]
