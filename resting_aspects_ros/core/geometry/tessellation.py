"""Estimate of the distance between the triangles of a mesh and the true curved surface."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Maximum step of the mesh of a curved side: that of a circle of 15 sides or more (24 degrees). A
# circle with fewer sides is a prism with flat sides.
CURVED_STEP = np.radians(25.0)
# Triangles that meet at a smaller angle are in one plane, up to the noise of float32.
FLAT_ANGLE = np.radians(0.1)
# Maximum angle between the triangles of a facet, rad.
MAX_BEND = 5 * FLAT_ANGLE
# A flat bounded by curved strips, such as a face with rounded edges, does not belong to the curved
# side. It is distinguished from a wide strip by this ratio to the width of the adjacent strips.
MAX_WIDTH_RATIO = 3.0
# Minimum area of a convex facet in terms of its covariance, which is that of a triangle, 6
# sqrt(3), reduced slightly for rounding.
CONVEX = 10.0
# Safety factor on the depths derived for strips and equilateral triangles.
MARGIN = 1.25


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges between two triangles.

    ends : (k, 2) int64, vertices; sides : (k, 2) int64, triangles; angle : (k,) float64, between
    their normals, rad.
    """

    ends: Indices
    sides: Indices
    angle: Array


def sagittas(vertices: Array, faces: Indices) -> tuple[Array, Flags]:
    """Return the depth of the true surface over each triangle, and which vertices are corners.

    Triangles in one plane form a facet. Over a facet the true surface has the slope a/2 at an edge
    of angle a. By the divergence theorem its mean curvature tensor K is the sum over the edges of
    a/2 length n n^T / area, where n is the normal of the edge in the plane of the facet. A
    paraboloid of curvature k rises over a strip of width w by k w^2 / 8, and over an equilateral
    triangle by k (circumradius)^2 / 2. With the covariance C of the facet both are at most
    2 trace(K C).

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int64

    Returns
    -------
    depth : (m,) float64
        In the unit of the vertices; 0 if no edge of a triangle is on a curved surface.
    corners : (n,) bool
        Vertices at an edge that is too sharp for a curved surface or is not shared by two
        triangles.
    """
    triangles = vertices[faces]
    twice = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(twice, axis=1) / 2
    normals = twice / np.maximum(2 * area, np.finfo(float).tiny)[:, None]
    edges = _edges(faces, normals)
    blunt = edges.angle <= CURVED_STEP
    corners = np.zeros(len(vertices), dtype=bool)
    corners[edges.ends[~blunt]] = True

    facet = _facets(normals, area, edges.sides[edges.angle < FLAT_ANGLE])
    size, covariance = _spread(triangles, area, facet)
    curved = blunt & (edges.angle >= FLAT_ANGLE)
    ends, sides = vertices[edges.ends[curved]], edges.sides[curved]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    across = np.cross((along / length[:, None])[:, None], normals[sides])
    width = np.einsum('esi,esij,esj->es', across, covariance[facet[sides]], across)
    width *= _fullness(size, covariance)[facet[sides]] ** 2
    width = np.minimum(width, MAX_WIDTH_RATIO**2 * width[:, ::-1])
    rise = (edges.angle[curved] * length)[:, None] * width / size[facet[sides]]
    depth = np.bincount(facet[sides].ravel(), weights=rise.ravel(), minlength=len(size))
    return np.asarray(MARGIN * depth[facet]), corners


def _fullness(size: Array, covariance: Array) -> Array:
    """Return the share of its extent that each facet fills: 1 if convex, about w / r for a ring.

    The area of a convex facet is at least 6 sqrt(3) times the root of the determinant of its
    covariance, which is the value of a triangle. A ring around the top of a torus is narrower than
    its covariance suggests.
    """
    trace = np.einsum('kii->k', covariance)
    square = np.einsum('kij,kij->k', covariance, covariance)
    root = np.sqrt(np.maximum((trace**2 - square) / 2, np.finfo(float).tiny))
    return np.asarray(np.minimum(size / (CONVEX * root), 1.0))


def _edges(faces: Indices, normals: Array) -> _Edges:
    """Return the edges; those that are not shared by exactly two triangles count as sharp.

    Such edges have an angle of pi and their first two triangles (or a single one, twice).
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    number = high * len(normals) * 3 + low  # unique: there are at most 3 vertices per triangle
    order = np.argsort(number, kind='stable')
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    count = np.diff(np.r_[first, len(order)])
    pair = np.stack([order[first], order[first + (count > 1)]], axis=1)
    sides = pair // 3
    # Neighbours use their edge in opposite directions, unless one of them is inside out.
    sign = np.where(start[pair[:, 0]] == start[pair[:, 1]], -1.0, 1.0)
    a, b = normals[sides[:, 0]], normals[sides[:, 1]] * sign[:, None]
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum('ij,ij->i', a, b))
    ends = np.stack([low, high], axis=1)[order[first]]
    return _Edges(ends, sides, np.where(count == 2, angle, np.pi))


def _facets(normals: Array, area: Array, pairs: Indices) -> Indices:
    """Return the facet of each triangle: triangles connected by flat edges, if coplanar.

    If the steps of a fine curved mesh are below FLAT_ANGLE, connected triangles are not coplanar;
    then each triangle is a facet.
    """
    count = len(normals)
    links = (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1]))
    graph = coo_array(links, shape=(count, count))
    facet = connected_components(graph, directed=False)[1].astype(np.int64)
    mean = np.stack([np.bincount(facet, weights=area * side) for side in normals.T], axis=1)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1), np.finfo(float).tiny)[:, None]
    apart = np.linalg.norm(normals - mean[facet], axis=1) * (area > 0)
    bent = np.bincount(facet, weights=apart > MAX_BEND) > 0
    own = bent[facet]
    facet[own] = len(mean) + np.flatnonzero(own)
    return np.unique(facet, return_inverse=True)[1].astype(np.int64)


def _spread(triangles: Array, area: Array, facet: Indices) -> tuple[Array, Array]:
    """Return the area (k,) of each facet and the covariance (k, 3, 3) of the points on it."""
    size = np.maximum(np.bincount(facet, weights=area), np.finfo(float).tiny)

    def total(values: Array) -> Array:
        columns = values.reshape(len(values), -1).T
        sums = [np.bincount(facet, weights=area * column) for column in columns]
        return np.stack(sums, axis=1) / size[:, None]

    middle = total(triangles.mean(axis=1))
    arms = triangles - middle[facet][:, None]
    whole = arms.sum(axis=1)
    # Second moments of a triangle: (sum of v v^T + s s^T) / 12, s being the sum of its corners.
    second = np.einsum('mci,mcj->mij', arms, arms) + whole[:, :, None] * whole[:, None, :]
    return size, total(second / 12).reshape(-1, 3, 3)
