"""A mesh with fewer triangles, for pictures that are sent over a network."""

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array

Indices = npt.NDArray[np.int64]

# Fewest cells along the longest side: what is left of a mesh is never less than a rough body.
FEWEST_CELLS = 3


def coarse_faces(vertices: Array, faces: Indices, most: int, kept: Indices) -> Indices:
    """The faces after vertices that are close together were merged; as they are if few enough.

    Vertices in one cell of a cubic grid become the one of them that is furthest from the middle,
    so that no new points are made and the outline stays (clustering: Rossignac, Borrel 1993).
    The grid is made wider until the faces are few enough, or it has FEWEST_CELLS.

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
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    place = np.floor((vertices - low) * (cells / (high - low).max())).astype(np.int64)
    cell = place @ np.array([1, cells + 1, (cells + 1) ** 2])
    cell[kept] = -1 - np.arange(len(kept))
    # The first of each cell, when the furthest come first.
    order = np.argsort(-np.linalg.norm(vertices - (low + high) / 2, axis=1), kind='stable')
    _, first, number = np.unique(cell[order], return_index=True, return_inverse=True)
    becomes = np.empty(len(vertices), dtype=np.int64)
    becomes[order] = order[first][number]
    merged = becomes[faces]
    a, b, c = merged.T
    merged = merged[(a != b) & (b != c) & (c != a)]
    # Walls that fell together are shown once.
    _, first = np.unique(np.sort(merged, axis=1), axis=0, return_index=True)
    return merged[np.sort(first)]
