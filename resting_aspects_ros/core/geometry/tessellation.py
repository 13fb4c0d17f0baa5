"""How far the triangles of a mesh are off the curved surface that they stand for."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# A curved side is meshed in steps of at most this: a circle of 15 sides or more (24 degrees); a
# circle of fewer is a prism with flat sides.
CURVED_STEP = np.radians(25.0)
# Triangles that meet at less are in one plane, but for the noise of float32.
FLAT_ANGLE = np.radians(0.1)
# A facet whose triangles are further apart than this, rad, is none.
BENT = 5 * FLAT_ANGLE
# A flat bounded by curved strips, as a face with rounded edges, is no part of the curve. It is
# told from a wide strip among narrow ones by being more than so many times as wide as they.
WIDER = 3.0
# A triangle fills its extent least of all convex facets; a little less, for rounding.
CONVEX = 10.0
# On top of what is derived for strips and for triangles of like sides.
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

    Triangles in one plane make a facet. Over a facet the true surface has the slope a/2 at an
    edge of angle a; by the divergence theorem its mean curvature tensor is
    sum over edges of a/2 length n n^T / area, n being the edge's normal in the facet's plane. A
    paraboloid of that curvature rises over a strip of width w by k w^2 / 8, and over a triangle
    of like sides by k (circumradius)^2 / 2; with the facet's covariance C both are at most
    2 trace(K C).

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int64

    Returns
    -------
    depth : (m,) float64
        In the unit of the vertices; 0 where a triangle has no edge of a curved surface.
    corners : (n,) bool
        Vertices at an edge that is too sharp for a curved surface, or is none of two triangles.
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
    width = np.minimum(width, WIDER**2 * width[:, ::-1])
    rise = (edges.angle[curved] * length)[:, None] * width / size[facet[sides]]
    depth = np.bincount(facet[sides].ravel(), weights=rise.ravel(), minlength=len(size))
    return np.asarray(MARGIN * depth[facet]), corners


def _fullness(size: Array, covariance: Array) -> Array:
    """Return how much of its extent each facet fills: 1 if it is convex, about w / r for a ring.

    The area of a convex facet is at least 6 sqrt(3) times the root of the determinant of its
    covariance, which is that of a triangle. A ring around the top of a torus is not as wide as
    its covariance says.
    """
    trace = np.einsum('kii->k', covariance)
    square = np.einsum('kij,kij->k', covariance, covariance)
    root = np.sqrt(np.maximum((trace**2 - square) / 2, np.finfo(float).tiny))
    return np.asarray(np.minimum(size / (CONVEX * root), 1.0))


def _edges(faces: Indices, normals: Array) -> _Edges:
    """Return the edges of two triangles; all others are bounds or seams, and count as sharp.

    Those are left in with an angle of pi and their first two triangles (or one, twice).
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    number = high * len(normals) * 3 + low  # one for each edge: fewer vertices than 3 a triangle
    order = np.argsort(number, kind='stable')
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    count = np.diff(np.r_[first, len(order)])
    pair = np.stack([order[first], order[first + (count > 1)]], axis=1)
    sides = pair // 3
    # Neighbours pass their edge in opposite directions, unless one of them is inside out.
    sign = np.where(start[pair[:, 0]] == start[pair[:, 1]], -1.0, 1.0)
    a, b = normals[sides[:, 0]], normals[sides[:, 1]] * sign[:, None]
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum('ij,ij->i', a, b))
    ends = np.stack([low, high], axis=1)[order[first]]
    return _Edges(ends, sides, np.where(count == 2, angle, np.pi))


def _facets(normals: Array, area: Array, pairs: Indices) -> Indices:
    """Return the facet of each triangle: those that flat edges join, if they are in one plane.

    On a mesh so fine that its steps are flat they are not: there each triangle is its own.
    """
    count = len(normals)
    links = (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1]))
    graph = coo_array(links, shape=(count, count))
    facet = connected_components(graph, directed=False)[1].astype(np.int64)
    mean = np.stack([np.bincount(facet, weights=area * side) for side in normals.T], axis=1)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1), np.finfo(float).tiny)[:, None]
    apart = np.linalg.norm(normals - mean[facet], axis=1) * (area > 0)
    bent = np.bincount(facet, weights=apart > BENT) > 0
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
