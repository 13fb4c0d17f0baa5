"""A mesh with fewer triangles, for pictures that are sent over a network."""

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from resting_aspects_ros.core.rotations import Array

Indices = npt.NDArray[np.int64]

# Fewest cells along the longest side: what is left of a mesh is never less than a rough body.
FEWEST_CELLS = 3


def coarse_faces(vertices: Array, faces: Indices, most: int, kept: Indices) -> Indices:
    """The faces after vertices that are close together were merged; as they are if few enough.

    Vertices in one cell of a cubic grid become the one of them that is in their middle, so that
    no new points are made (clustering: Rossignac, Borrel 1993). The grid is made wider until the
    faces are few enough, or it has FEWEST_CELLS.

    Parameters
    ----------
    vertices : (n, 3) float
    faces : (m, 3) int
    most : int
        Triangles that are allowed.
    kept : (k,) int
        Vertices that stay as they are.

    Returns
    -------
    (m', 3) int
        Into ``vertices``.
    """
    cells = max(round(most**0.5), FEWEST_CELLS)
    while len(faces) > most:
        merged = _merged(vertices, faces, cells, kept)
        if len(merged) <= most or cells == FEWEST_CELLS:
            return merged
        cells = max(cells * 4 // 5, FEWEST_CELLS)
    return faces


def _merged(vertices: Array, faces: Indices, cells: int, kept: Indices) -> Indices:
    becomes = _representatives(vertices, _cells(vertices, cells, kept), kept)
    merged = becomes[faces]
    a, b, c = merged.T
    whole = (a != b) & (b != c) & (c != a)
    # Walls that fell together are shown once.
    _, first = np.unique(np.sort(merged[whole], axis=1), axis=0, return_index=True)
    whole = np.flatnonzero(whole)[np.sort(first)]
    merged = merged[whole]
    over = (_normals(vertices, merged) * _normals(vertices, faces[whole])).sum(axis=1) < 0
    merged[over] = merged[over, ::-1]  # light falls on it as on the face that it was
    return merged


def _cells(vertices: Array, cells: int, kept: Indices) -> Indices:
    """(n,) number of each vertex's cell; one with kept vertices is divided between them."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    place = np.floor((vertices - low) * (cells / (high - low).max())).astype(np.int64)
    cell = place @ np.array([1, cells + 1, (cells + 1) ** 2])
    if len(kept):
        divided = np.isin(cell, cell[kept])
        cell[divided] = -1 - KDTree(vertices[kept]).query(vertices[divided])[1]
    return np.asarray(cell)


def _representatives(vertices: Array, cell: Indices, kept: Indices) -> Indices:
    """(n,) what each vertex becomes: the one of its cell nearest to the cell's mean, or kept."""
    _, number, count = np.unique(cell, return_inverse=True, return_counts=True)
    sums = [np.bincount(number, weights=along) for along in vertices.T]
    mean = np.stack(sums, axis=1) / count[:, None]
    off = np.linalg.norm(vertices - mean[number], axis=1)
    off[kept] = -1.0
    order = np.lexsort([off, number])
    return np.asarray(order[np.cumsum(count) - count][number])


def _normals(vertices: Array, faces: Indices) -> Array:
    """(m, 3) of the length of twice the area."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.cross(b - a, c - a)
