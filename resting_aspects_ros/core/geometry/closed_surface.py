"""Make a closed surface that faces outward from the triangles of a file: weld, repair, check.

A surface is closed if every edge is used equally often in both directions. This is the condition
of the volume integrals. It is weaker than "two triangles at each edge": bodies that touch along an
edge or share a wall are closed.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from resting_aspects_ros.core.geometry.mesh_file import without_unused
from resting_aspects_ros.core.geometry.shells import check_facing
from resting_aspects_ros.core.geometry.triangle_edges import (
    TriangleEdges,
    connected,
    triangle_edges,
)

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
    edges = triangle_edges(faces)
    defect = _defect(edges)
    if defect and copies:
        every_edge = triangle_edges(every)
        if not _defect(every_edge) and every_edge.is_balanced() and every_edge.sequences().any():
            # Overlapping bodies have a common side.
            faces, edges, copies, defect = every, every_edge, 0, None
    if copies:
        warnings.append(f'duplicate triangles were removed: {copies}')
    if defect:
        # A degenerate triangle with three different corners can close a gap or cause a defect.
        solid = faces[_areas(vertices, faces) > 0]
        if not _defect(solid_edges := triangle_edges(solid)):
            faces, edges, defect = solid, solid_edges, None
    mended = np.zeros(len(faces), dtype=bool)
    if not defect and not edges.is_balanced():
        mended = edges.against_their_neighbours()
        faces = _flipped(faces, mended)
        edges = triangle_edges(faces)
        if edges.is_balanced():
            warnings.append(
                'triangles that did not face the same way as their neighbours were '
                f'flipped: {np.count_nonzero(mended)}'
            )
        else:
            defect = (
                'has triangles that cannot be flipped to face the same way as their neighbours'
            )
    if not defect and _is_folded(faces):
        defect = 'encloses no volume: it has each triangle twice, with opposite orientations'
    body = np.zeros(len(faces), dtype=np.int64)
    if not defect:
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        found = check_facing((vertices - middle)[faces], edges.shells(), mended)
        faces, defect, body = _flipped(faces, found.inward), found.defect, found.body
        warnings += found.warnings
    return Surface(*without_unused(vertices, faces), defect, tuple(warnings), body)


def _weld(vertices: Vertices, faces: Faces, tolerance: float) -> tuple[Vertices, Faces]:
    """Merge vertices within the tolerance; remove triangles with fewer than three corners left."""
    vertices, group = weld_groups(vertices, tolerance)
    faces = group[faces]
    a, b, c = faces.T
    return vertices, faces[(a != b) & (b != c) & (c != a)]


def weld_groups(vertices: Vertices, tolerance: float) -> tuple[Vertices, Faces]:
    """Return the vertices that remain if those within the tolerance are merged, and their rows.

    Each group is replaced by its lexicographically first vertex, in any order of the file. The
    second result, (n,), has the row of the remaining vertex for each vertex.
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
        label = connected(len(first), pairs)[cell.ravel()]
        _, first, label = np.unique(label, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))
        vertices, group = vertices[np.sort(first)], rank[label][group]
    return vertices, group


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


def _is_folded(faces: Faces) -> bool:
    """Return whether each triangle occurs equally often in both orientations."""
    order = np.argsort(faces, axis=1)
    sense = np.where((order[:, 1] - order[:, 0]) % 3 == 1, 1, -1)
    rows = np.take_along_axis(faces, order, axis=1)
    _, number = np.unique(rows, axis=0, return_inverse=True)
    return not np.bincount(number.ravel(), weights=sense).any()


def _defect(edges: TriangleEdges) -> str | None:
    if not len(edges.number):
        return 'has no triangle with an area'
    count = edges.open_count()
    return f'is not watertight: it has {count} open edges' if count else None


def _areas(vertices: Vertices, faces: Faces) -> npt.NDArray[np.float64]:
    """Return the areas; those of needles that are nonzero only by rounding are set to zero."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    longest = np.maximum(((b - a) ** 2).sum(axis=1), ((c - a) ** 2).sum(axis=1))
    return np.where(area > WELD * longest, area, 0.0)


def _flipped(faces: Faces, which: Flags) -> Faces:
    return np.where(which[:, None], faces[:, ::-1], faces)
