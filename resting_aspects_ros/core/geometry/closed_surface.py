"""From the triangles of a file to a closed, outward surface: welding, mending, and saying why not.

A surface is closed when every edge is passed as often in one direction as in the other. That is
what the volume integrals need, and it allows more than "two triangles at each edge": bodies that
touch along an edge, or share a wall, are closed.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from resting_aspects_ros.core.geometry.shells import facing

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Vertices closer than this, as a share of the part's half size, are one. STL stores float32, whose
# neighbours are up to 1.2e-7 apart, and text often has seven digits: the same corner of two
# triangles can differ by that much in each coordinate, and a file cannot mean anything smaller.
WELD = 1e-6
# Far from the origin the same corner can differ by more; so a mesh that has open edges is welded
# again, within WELD of the largest coordinate, but at most within this share of its half size.
MAX_WELD = 1e-3


@dataclass(frozen=True, eq=False)
class Surface:
    """A welded surface; ``defect`` says why it encloses no solid, None if it does."""

    vertices: Vertices  # (n, 3), lexicographic, each one used by a triangle
    faces: Faces  # (m, 3), outward if there is no defect
    defect: str | None  # a predicate, as 'is not watertight: ...'
    warnings: tuple[str, ...]
    body: Faces  # (m,) number of the body that each triangle belongs to, 0 if there is a defect


def closed_surface(vertices: Vertices, faces: Faces) -> Surface:
    """Weld the vertices, drop triangles that are none, and turn all triangles outward.

    Parameters
    ----------
    vertices : (n, 3) float64
        Any unit, any frame; finite.
    faces : (m, 3) int64
        As in the file.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    half = float(np.abs(vertices - middle).max())
    surface = _closed(vertices, faces, WELD * half)
    wide = min(WELD * float(np.abs(vertices).max()), MAX_WELD * half)
    if surface.defect and wide > WELD * half:
        again = _closed(vertices, faces, wide)
        surface = surface if again.defect else again
    return surface


def _closed(vertices: Vertices, faces: Faces, tolerance: float) -> Surface:
    warnings: list[str] = []
    vertices, faces = _weld(vertices, faces, tolerance)
    every = faces
    faces, copies = _without_copies(faces)
    defect = _defect(faces)
    if defect and copies and not _defect(every) and _balanced(every) and _in_order(every).any():
        # Bodies that overlap have a side in common.
        faces, copies, defect = every, 0, None
    if copies:
        warnings.append(f'triangles that were there more than once count once: {copies}')
    if defect:
        # A needle of no area with three different corners can close a gap, or be in the way.
        solid = faces[_areas(vertices, faces) > 0]
        if not _defect(solid):
            faces, defect = solid, None
    mended = np.zeros(len(faces), dtype=bool)
    if not defect and not _balanced(faces):
        mended = _against_their_neighbours(faces)
        faces = _flipped(faces, mended)
        if _balanced(faces):
            warnings.append(
                'triangles that faced the other way than their neighbours were '
                f'turned: {np.count_nonzero(mended)}'
            )
        else:
            defect = 'has triangles that cannot be turned to face the same way as their neighbours'
    body = np.zeros(len(faces), dtype=np.int64)
    if not defect:
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        found = facing((vertices - middle)[faces], _shells(faces), mended)
        faces, defect, body = _flipped(faces, found.inward), found.defect, found.body
        warnings += found.warnings
    used, faces = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3), defect, tuple(warnings), body)


def _weld(vertices: Vertices, faces: Faces, tolerance: float) -> tuple[Vertices, Faces]:
    """Join vertices within the tolerance; drop triangles that have fewer than three corners left.

    The first in lexicographic order stands for each group, whatever the order in the file.
    """
    vertices = vertices + 0.0  # -0 is 0
    order = np.lexsort(vertices.T[::-1])
    vertices = vertices[order]
    group = np.empty(len(vertices), dtype=np.int64)
    group[order] = np.cumsum(np.r_[0, (np.diff(vertices, axis=0) != 0).any(axis=1)])
    vertices = vertices[np.r_[True, (np.diff(vertices, axis=0) != 0).any(axis=1)]]
    if tolerance:
        # First by cells, so that a file with a million vertices in one spot has few pairs.
        _, first, cell = np.unique(
            np.round((vertices - vertices[0]) / tolerance).astype(np.int64),
            axis=0,
            return_index=True,
            return_inverse=True,
        )
        pairs = KDTree(vertices[first]).query_pairs(tolerance, output_type='ndarray')
        label = _components(len(first), pairs)[cell.ravel()]
        _, first, label = np.unique(label, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))
        vertices, group = vertices[np.sort(first)], rank[label][group]
    faces = group[faces]
    a, b, c = faces.T
    return vertices, faces[(a != b) & (b != c) & (c != a)]


def _without_copies(faces: Faces) -> tuple[Faces, int]:
    """Drop all but the first of triangles with the same corners in the same sense of rotation.

    Two with the opposite sense are a wall shared by two bodies; they cancel in every integral.
    """
    if not len(faces):
        return faces, 0
    turn = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (turn + np.arange(3)) % 3, axis=1)
    order = np.lexsort(turned.T)
    new = np.r_[True, (np.diff(turned[order], axis=0) != 0).any(axis=1)]
    return faces[np.sort(order[new])], int(np.count_nonzero(~new))


def _edges(faces: Faces) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return for each of the (3 m) edges, face by face, its number and its direction (+1, -1)."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, number = np.unique(low * (int(faces.max()) + 1) + high, return_inverse=True)
    return number, np.where(start < end, 1, -1)


def _defect(faces: Faces) -> str | None:
    """Say how many edges are open; every edge of a closed surface has an even number of faces."""
    if not len(faces):
        return 'has no triangle with an area'
    number, _ = _edges(faces)
    odd = np.bincount(number) % 2 == 1
    return f'is not watertight: it has {np.count_nonzero(odd)} open edges' if odd.any() else None


def _balanced(faces: Faces) -> bool:
    number, direction = _edges(faces)
    return not np.bincount(number, weights=direction).any()


def _against_their_neighbours(faces: Faces) -> Flags:
    """Return which triangles to flip so that neighbours across edges of two triangles agree.

    Each triangle is there twice, as it is and flipped; copies that agree are linked. The pieces
    come in pairs, each the other one inside out; one of each pair is taken.
    """
    number, direction = _edges(faces)
    order = np.argsort(number, kind='stable')
    pairs = order[np.bincount(number)[number[order]] == 2].reshape(-1, 2)
    face, other = (pairs // 3).T
    turn = direction[pairs[:, 0]] == direction[pairs[:, 1]]
    m = len(faces)
    links = np.concatenate(
        [
            np.stack([face, other + m * turn], axis=1),
            np.stack([face + m, other + m * ~turn], axis=1),
        ]
    )
    piece = _components(2 * m, links)
    return piece[:m] > piece[m:]


def _shells(faces: Faces) -> Faces:
    """Return for each triangle the number of its shell, which is closed.

    Where bodies have an edge in common, four triangles meet there. If the triangles that meet in
    pairs do not make closed shells, because the bodies have a side in common, the shells are those
    that follow each other in the file.
    """
    number, direction = _edges(faces)
    paired = np.bincount(number)[number] == 2
    shell = _linked(number, np.flatnonzero(paired), len(faces))
    of_edge = np.repeat(shell, 3) * (int(number.max()) + 1) + number
    _, of_edge = np.unique(of_edge, return_inverse=True)
    if not np.bincount(of_edge, weights=direction).any():
        return shell
    piece = np.repeat(_in_order(faces), 3) * (int(number.max()) + 1) + number
    _, piece = np.unique(piece, return_inverse=True)
    return _linked(piece, np.arange(len(number)), len(faces))


def edge_pieces(faces: Faces) -> Faces:
    """Return for each triangle the number of the piece that hangs together by edges."""
    number, _ = _edges(faces)
    return _linked(number, np.arange(len(number)), len(faces))


def _linked(number: Faces, edges: Faces, count: int) -> Faces:
    """Link triangles that have one of the edges, which are rows of ``number``, in common."""
    at_edge = np.empty(number.max() + 1, dtype=np.int64)
    at_edge[number[edges]] = edges // 3
    return _components(count, np.stack([edges // 3, at_edge[number[edges]]], axis=1))


def _in_order(faces: Faces) -> Faces:
    """Return the number of closed pieces that come before each triangle in the file."""
    number, direction = _edges(faces)
    order = np.argsort(number, kind='stable')
    triangle = order // 3
    # All edges add up to zero, so each one begins with zero.
    opened = np.flatnonzero(np.cumsum(direction[order]))
    change = np.bincount(triangle[opened], minlength=len(faces))
    change -= np.bincount(triangle[opened + 1], minlength=len(faces))
    closed = np.cumsum(change) == 0
    return np.asarray(np.r_[0, np.cumsum(closed[:-1])])


def _areas(vertices: Vertices, faces: Faces) -> npt.NDArray[np.float64]:
    """Return the areas, with those of needles that only rounding keeps from zero set to zero."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    longest = np.maximum(((b - a) ** 2).sum(axis=1), ((c - a) ** 2).sum(axis=1))
    return np.where(area > WELD * longest, area, 0.0)


def _flipped(faces: Faces, which: Flags) -> Faces:
    return np.where(which[:, None], faces[:, ::-1], faces)


def _components(count: int, pairs: Faces) -> npt.NDArray[np.int64]:
    links = (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1]))
    graph = coo_array(links, shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)
