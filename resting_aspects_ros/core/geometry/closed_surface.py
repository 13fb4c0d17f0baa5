"""Make a closed surface that faces outward from the triangles of a file: weld, repair, check.

A surface is closed if every edge is used equally often in both directions. This is the condition
of the volume integrals. It is weaker than "two triangles at each edge": bodies that touch along an
edge or share a wall are closed.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from resting_aspects_ros.core.geometry.shells import check_facing

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Vertices closer than this, as a share of half the size of the part, are welded. STL stores
# float32 with a relative resolution of 1.2e-7, and text files often have seven digits. So the same
# corner of two triangles can differ by this much in each coordinate, and a file cannot represent
# smaller details.
WELD = 1e-6
# Far from the origin the difference can be larger. So a mesh with open edges is welded again,
# within WELD of the largest coordinate, but at most within this share of half its size.
MAX_WELD = 1e-3


@dataclass(frozen=True, eq=False)
class Surface:
    """A welded surface; ``defect`` is the reason why it does not enclose a solid, or None."""

    vertices: Vertices  # (n, 3), in lexicographic order, each used by a triangle
    faces: Faces  # (m, 3), outward if there is no defect
    defect: str | None  # a predicate, such as 'is not watertight: ...'
    warnings: tuple[str, ...]
    body: Faces  # (m,) number of the body that each triangle belongs to, 0 if there is a defect


def closed_surface(vertices: Vertices, faces: Faces) -> Surface:
    """Return the surface with welded vertices, without degenerate triangles, facing outward.

    Parameters
    ----------
    vertices : (n, 3) float64
        Any unit, any frame; finite.
    faces : (m, 3) int64
        Triangles as in the file.
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
        # Overlapping bodies have a common side.
        faces, copies, defect = every, 0, None
    if copies:
        warnings.append(f'duplicate triangles were removed: {copies}')
    if defect:
        # A degenerate triangle with three different corners can close a gap or cause a defect.
        solid = faces[_areas(vertices, faces) > 0]
        if not _defect(solid):
            faces, defect = solid, None
    mended = np.zeros(len(faces), dtype=bool)
    if not defect and not _balanced(faces):
        mended = _against_their_neighbours(faces)
        faces = _flipped(faces, mended)
        if _balanced(faces):
            warnings.append(
                'triangles that did not face the same way as their neighbours were '
                f'flipped: {np.count_nonzero(mended)}'
            )
        else:
            defect = (
                'has triangles that cannot be flipped to face the same way as their neighbours'
            )
    body = np.zeros(len(faces), dtype=np.int64)
    if not defect:
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        found = check_facing((vertices - middle)[faces], _shells(faces), mended)
        faces, defect, body = _flipped(faces, found.inward), found.defect, found.body
        warnings += found.warnings
    used, faces = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3), defect, tuple(warnings), body)


def _weld(vertices: Vertices, faces: Faces, tolerance: float) -> tuple[Vertices, Faces]:
    """Merge vertices within the tolerance; remove triangles with fewer than three corners left.

    Each group is replaced by its lexicographically first vertex, in any order of the file.
    """
    vertices = vertices + 0.0  # -0 is 0
    order = np.lexsort(vertices.T[::-1])
    vertices = vertices[order]
    group = np.empty(len(vertices), dtype=np.int64)
    group[order] = np.cumsum(np.r_[0, (np.diff(vertices, axis=0) != 0).any(axis=1)])
    vertices = vertices[np.r_[True, (np.diff(vertices, axis=0) != 0).any(axis=1)]]
    if tolerance:
        # First by grid cells, so that a million vertices in one spot have few pairs.
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
    """Remove duplicates, triangles with the same corners in the same orientation.

    Two triangles of opposite orientation are a wall shared by two bodies; they cancel in every
    integral.
    """
    if not len(faces):
        return faces, 0
    turn = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (turn + np.arange(3)) % 3, axis=1)
    order = np.lexsort(turned.T)
    new = np.r_[True, (np.diff(turned[order], axis=0) != 0).any(axis=1)]
    return faces[np.sort(order[new])], int(np.count_nonzero(~new))


def _edges(faces: Faces) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the number and the direction (+1, -1) of each of the (3 m) edges, face by face."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, number = np.unique(low * (int(faces.max()) + 1) + high, return_inverse=True)
    return number, np.where(start < end, 1, -1)


def _defect(faces: Faces) -> str | None:
    """Return the number of open edges as text; an edge is open if its number of faces is odd."""
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

    Each triangle is represented twice, unchanged and flipped, and copies that agree are linked.
    The components come in pairs, each the other one inside out; one of each pair is used.
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

    Four triangles meet at an edge that two bodies share. If linking triangles at edges of two
    triangles does not give closed shells, because bodies share a side, the shells are the closed
    sequences of triangles in the file.
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


def edge_components(faces: Faces) -> Faces:
    """Return for each triangle the number of its component, connected by edges."""
    number, _ = _edges(faces)
    return _linked(number, np.arange(len(number)), len(faces))


def _linked(number: Faces, edges: Faces, count: int) -> Faces:
    """Return the components of triangles that share one of the edges, rows of ``number``."""
    at_edge = np.empty(number.max() + 1, dtype=np.int64)
    at_edge[number[edges]] = edges // 3
    return _components(count, np.stack([edges // 3, at_edge[number[edges]]], axis=1))


def _in_order(faces: Faces) -> Faces:
    """Return the number of closed components before each triangle in the file."""
    number, direction = _edges(faces)
    order = np.argsort(number, kind='stable')
    triangle = order // 3
    # The directions at each edge sum to zero, so each edge begins with zero.
    opened = np.flatnonzero(np.cumsum(direction[order]))
    change = np.bincount(triangle[opened], minlength=len(faces))
    change -= np.bincount(triangle[opened + 1], minlength=len(faces))
    closed = np.cumsum(change) == 0
    return np.asarray(np.r_[0, np.cumsum(closed[:-1])])


def _areas(vertices: Vertices, faces: Faces) -> npt.NDArray[np.float64]:
    """Return the areas; those of needles that are nonzero only by rounding are set to zero."""
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
