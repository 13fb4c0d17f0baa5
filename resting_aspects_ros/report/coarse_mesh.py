"""Reduce the number of triangles of a mesh, for pictures and for messages."""

import numpy as np
from scipy.spatial import KDTree

from resting_aspects_ros.arrays import Array, Indices

# Minimum number of cells along the longest side: even the coarsest mesh is still a rough body.
MIN_CELLS = 3


def coarse_faces(vertices: Array, faces: Indices, max_faces: int, kept: Indices) -> Indices:
    """Return faces of a coarser mesh, or the same faces if there are at most ``max_faces``.

    Vertices in one cell of a cubic grid are merged into the one nearest to their mean, so that no
    new points are made (clustering: Rossignac, Borrel 1993). The cells are enlarged until there
    are few enough faces, or until the grid has MIN_CELLS along the longest side.

    Parameters
    ----------
    vertices : (n, 3) float
    faces : (m, 3) int
    max_faces : int
        Maximum number of triangles.
    kept : (k,) int
        Vertices that are not merged into others.

    Returns
    -------
    (m', 3) int
        Indices of ``vertices``.
    """
    cells = max(round(max_faces**0.5), MIN_CELLS)
    while len(faces) > max_faces:
        merged = _merge_vertices(vertices, faces, cells, kept)
        if len(merged) <= max_faces or cells == MIN_CELLS:
            return merged
        cells = max(cells * 4 // 5, MIN_CELLS)
    return faces


def _merge_vertices(vertices: Array, faces: Indices, cells: int, kept: Indices) -> Indices:
    """Return the faces that remain after the vertices in each cell were merged."""
    representative = _representatives(vertices, _cells(vertices, cells, kept), kept)
    merged = representative[faces]
    a, b, c = merged.T
    whole = (a != b) & (b != c) & (c != a)
    # Duplicate faces, such as of thin walls that collapsed, are kept once.
    _, first = np.unique(np.sort(merged[whole], axis=1), axis=0, return_index=True)
    whole = np.flatnonzero(whole)[np.sort(first)]
    merged = merged[whole]
    # A face that was turned over by the merge is flipped back, so that its shading is right.
    flipped = (_normals(vertices, merged) * _normals(vertices, faces[whole])).sum(axis=1) < 0
    merged[flipped] = merged[flipped, ::-1]
    return merged


def _cells(vertices: Array, cells: int, kept: Indices) -> Indices:
    """Return (n,) cell numbers of the vertices; a cell with kept vertices is split among them."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    place = np.floor((vertices - low) * (cells / (high - low).max())).astype(np.int64)
    cell = place @ np.array([1, cells + 1, (cells + 1) ** 2])
    if len(kept):
        divided = np.isin(cell, cell[kept])
        cell[divided] = -1 - KDTree(vertices[kept]).query(vertices[divided])[1]
    return np.asarray(cell)


def _representatives(vertices: Array, cell: Indices, kept: Indices) -> Indices:
    """Return (n,) the vertex into which each is merged: a kept one, or the nearest to the mean."""
    _, number, count = np.unique(cell, return_inverse=True, return_counts=True)
    sums = [np.bincount(number, weights=along) for along in vertices.T]
    mean = np.stack(sums, axis=1) / count[:, None]
    distance = np.linalg.norm(vertices - mean[number], axis=1)
    distance[kept] = -1.0
    order = np.lexsort([distance, number])
    return np.asarray(order[np.cumsum(count) - count][number])


def _normals(vertices: Array, faces: Indices) -> Array:
    """Return (m, 3) normals, twice as long as the area of the face."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.cross(b - a, c - a)
