"""A closed surface that faces outward, from the triangles of a file: weld, repair, check."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Faces, Flags, Indices
from resting_aspects_ros.part.mesh_files import without_unused

# -- Edges ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class TriangleEdges:
    """The edges of triangles, (3 m), triangle by triangle."""

    number: Indices  # the same for all uses of an edge
    direction: Indices  # +1 or -1

    def open_count(self) -> int:
        """Return how many edges have an odd number of triangles."""
        return int(np.count_nonzero(np.bincount(self.number) % 2))

    def is_balanced(self) -> bool:
        """Return whether each edge is used equally often in both directions."""
        return not np.bincount(self.number, weights=self.direction).any()

    def components(self) -> Indices:
        """Return for each triangle the number of its component, connected by edges."""
        return _linked(self.number, np.arange(len(self.number)))

    def against_their_neighbours(self) -> Flags:
        """Return which triangles to flip so that neighbours across edges of two triangles agree.

        Each triangle is represented twice, unchanged and flipped, and copies that agree are
        linked. The components come in pairs, each the other one inside out; one of each pair is
        used.
        """
        order = np.argsort(self.number, kind='stable')
        pairs = order[np.bincount(self.number)[self.number[order]] == 2].reshape(-1, 2)
        face, other = (pairs // 3).T
        turn = self.direction[pairs[:, 0]] == self.direction[pairs[:, 1]]
        m = len(self.number) // 3
        links = np.concatenate(
            [
                np.stack([face, other + m * turn], axis=1),
                np.stack([face + m, other + m * ~turn], axis=1),
            ]
        )
        piece = connected(2 * m, links)
        return piece[:m] > piece[m:]

    def shells(self) -> Indices:
        """Return for each triangle of a balanced surface the number of its shell.

        Four triangles meet at an edge that two bodies share. If linking triangles at edges of two
        triangles does not give closed shells, because bodies share a side, the shells are the
        closed sequences of triangles in the file.
        """
        paired = np.bincount(self.number)[self.number] == 2
        shell = _linked(self.number, np.flatnonzero(paired))
        if not np.bincount(self._edges_of(shell), weights=self.direction).any():
            return shell
        return _linked(self._edges_of(self.sequences()), np.arange(len(self.number)))

    def sequences(self) -> Indices:
        """Return the number of closed sequences before each triangle in the file.

        The surface must be balanced.
        """
        order = np.argsort(self.number, kind='stable')
        triangle = order // 3
        # The directions at each edge sum to zero, so each edge begins with zero.
        opened = np.flatnonzero(np.cumsum(self.direction[order]))
        change = np.bincount(triangle[opened], minlength=len(order) // 3)
        change -= np.bincount(triangle[opened + 1], minlength=len(order) // 3)
        closed = np.cumsum(change) == 0
        return np.asarray(np.r_[0, np.cumsum(closed[:-1])])

    def _edges_of(self, group: Indices) -> Indices:
        """Return numbers of the edges that differ between groups of triangles (m,)."""
        both = np.repeat(group, 3) * (int(self.number.max()) + 1) + self.number
        return np.asarray(np.unique(both, return_inverse=True)[1])


def triangle_edges(faces: Indices) -> TriangleEdges:
    """Return the edges of triangles (m, 3)."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, number = np.unique(low * (int(faces.max(initial=0)) + 1) + high, return_inverse=True)
    return TriangleEdges(number, np.where(start < end, 1, -1))


def _linked(number: Indices, edges: Indices) -> Indices:
    """Return the components of triangles that share one of the edges, rows of ``number``."""
    at_edge = np.empty(number.max() + 1, dtype=np.int64)
    at_edge[number[edges]] = edges // 3
    links = np.stack([edges // 3, at_edge[number[edges]]], axis=1)
    return connected(len(number) // 3, links)


def connected(count: int, pairs: Indices) -> Indices:
    """Return the component of each of ``count`` items that are linked in pairs (k, 2)."""
    links = (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1]))
    graph = coo_array(links, shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


# -- Shells ---------------------------------------------------------------------------------------


# Maximum number of shells around one shell, by their boxes. No part has more, and each costs time.
MAX_DEPTH = 100

# Distance behind a triangle of the point that represents the inside of its shell, as a share of
# the size of the triangle: more than the noise of float32, less than any wall.
INNER_DISTANCE = 1e-3

# Rotates the mesh before rays are cast along the z axis, so that no ray is parallel to a likely
# side of a part.
RAY_ROTATION = Rotation.from_rotvec((0.7, 1.1, 0.3)).as_matrix()


def _facing(
    corners: Array, shell: Indices, mended: Flags
) -> tuple[Flags, Indices, list[str], str | None]:
    """Return which triangles are of shells that face the wrong way, bodies, warnings, and defect.

    The bodies are numbers (m,); a body is a shell that faces outward, with its cavities.

    A shell that is not inside another one must face outward. A shell inside another one is a
    cavity if it faces inward. It is treated as a cavity too if the shell around it was inside out,
    or if its own triangles had inconsistent orientations.

    Parameters
    ----------
    corners : (m, 3, 3) float64
        Corners of the triangles, near the origin.
    shell : (m,) int64
        Number of the shell of each triangle, from 0; each is closed and consistently oriented.
    mended : (m,) bool
        Triangles that were flipped, so that the orientation of their shell is arbitrary.
    """
    volumes = np.bincount(shell, weights=np.linalg.det(corners))
    doubtful = np.bincount(shell, weights=mended) > 0
    order = np.argsort(shell, kind='stable')
    triangles = np.split(corners[order], np.cumsum(np.bincount(shell))[:-1])
    # Each shell comes after all shells that can contain it, which are larger.
    largest_first = np.argsort(-np.abs(volumes), kind='stable')
    boxed = _boxed(triangles, largest_first)
    if boxed is None:
        none = np.zeros(len(shell), dtype=bool)
        return none, shell * 0, [], f'has more than {MAX_DEPTH} bodies inside each other'
    around: dict[int, dict[int, int]] = {}
    for o, inner in boxed.items():
        points = np.array([_inner_point(triangles[s], volumes[s]) for s in inner])
        for s, turn in zip(inner, _turns(points, triangles[o]).tolist(), strict=True):
            around.setdefault(s, {})[o] = turn
    flip, body = volumes < 0, np.arange(len(volumes))
    for s in filter(around.__contains__, largest_first.tolist()):
        turns, flip[s] = around[s], False
        depth = sum(-turn if flip[o] else turn for o, turn in turns.items())
        if depth <= 0:
            flip[s] = volumes[s] < 0
        elif volumes[s] > 0:
            flip[s] = doubtful[s] or any(turn and flip[o] for o, turn in turns.items())
        if (volumes[s] < 0) != flip[s]:
            # A cavity belongs to the smallest body around it.
            body[s] = [o for o in turns if turns[o] and body[o] == o][-1]
    return flip[shell], body[shell], _warnings(flip & ~doubtful), None


def _boxed(triangles: list[Array], largest_first: Indices) -> dict[int, list[int]] | None:
    """Return the smaller shells in the box of each shell; None if the nesting is too deep."""
    low = np.array([t.min(axis=(0, 1)) for t in triangles])
    high = np.array([t.max(axis=(0, 1)) for t in triangles])
    middle, half = (low + high) / 2, (high - low).max(axis=1) / 2
    near = KDTree(middle)
    rank = np.argsort(largest_first)
    count = np.zeros(len(rank), dtype=np.int64)
    found = {}
    for o in largest_first.tolist():
        inner = np.array(near.query_ball_point(middle[o], 1.01 * half[o], p=np.inf))
        inner = inner[(low[inner] >= low[o]).all(axis=1) & (high[inner] <= high[o]).all(axis=1)]
        inner = inner[rank[inner] > rank[o]]
        count[inner] += 1
        if count[inner].max(initial=0) > MAX_DEPTH:
            return None
        if len(inner):
            found[o] = inner.tolist()
    return found


def _warnings(flipped: Flags) -> list[str]:
    if flipped.all():
        return ['the mesh was inside out and was flipped']
    count, total = np.count_nonzero(flipped), len(flipped)
    return [f'{count} of {total} bodies were inside out and were flipped'] if count else []


def _inner_point(triangles: Array, volume: float) -> Array:
    """Return a point (3,) enclosed by a shell, just behind the middle of its largest triangle.

    The point is not on the triangle, because bodies often touch, and noise would decide on which
    side of the other body the point is.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    largest = int((normals**2).sum(axis=1).argmax())
    normal = normals[largest] * np.sign(volume)
    size = np.sqrt(np.linalg.norm(normals[largest])) or 1.0
    return np.asarray(triangles[largest].mean(axis=0) - INNER_DISTANCE / size * normal)


def _turns(points: Array, shell: Array) -> Indices:
    """Return the winding numbers of a shell (m, 3, 3) at points (n, 3): 1 or -1 inside, else 0.

    It is the number of triangles that a ray from the point crosses from inside, minus those
    crossed from outside. Adjacent triangles agree exactly on which side of their edge the ray
    passes.
    """
    shell, points = shell @ RAY_ROTATION, points @ RAY_ROTATION
    low, high = shell.min(axis=1), shell.max(axis=1)
    turns = np.zeros(len(points), dtype=np.int64)
    for k, (x, y, _) in enumerate(points):
        ahead = np.flatnonzero((low[:, 0] <= x) & (high[:, 0] >= x))
        ahead = ahead[(low[ahead, 1] <= y) & (high[ahead, 1] >= y)]
        arms = shell[ahead] - points[k]
        u, v = arms[:, :, 0], arms[:, :, 1]
        # Twice the areas of the triangles between the ray and the three edges, seen along the ray.
        areas = np.roll(u, -1, 1) * np.roll(v, -2, 1) - np.roll(u, -2, 1) * np.roll(v, -1, 1)
        sense = np.sign(areas)
        met = (sense == sense[:, :1]).all(axis=1) & (
            (areas * arms[:, :, 2]).sum(axis=1) * sense[:, 0] > 0
        )
        turns[k] = sense[met, 0].sum()
    return turns


# -- Closed surfaces ------------------------------------------------------------------------------


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

    vertices: Array  # (n, 3), in lexicographic order, each used by a triangle
    faces: Faces  # (m, 3), outward if there is no defect
    defect: str | None  # a predicate, such as 'is not watertight: ...'
    warnings: tuple[str, ...]
    body: Faces  # (m,) number of the body that each triangle belongs to, 0 if there is a defect


def closed_surface(vertices: Array, faces: Faces) -> Surface:
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


def _closed(vertices: Array, faces: Faces, tolerance: float) -> Surface:
    warnings: list[str] = []
    vertices, group = weld_groups(vertices, tolerance)
    a, b, c = group[faces].T
    every = faces = group[faces][(a != b) & (b != c) & (c != a)]
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
        corners = (vertices - middle)[faces]
        inward, body, more, defect = _facing(corners, edges.shells(), mended)
        faces = _flipped(faces, inward)
        warnings += more
    return Surface(*without_unused(vertices, faces), defect, tuple(warnings), body)


def weld_groups(vertices: Array, tolerance: float) -> tuple[Array, Faces]:
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


def _areas(vertices: Array, faces: Faces) -> Array:
    """Return the areas; those of needles that are nonzero only by rounding are set to zero."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    longest = np.maximum(((b - a) ** 2).sum(axis=1), ((c - a) ** 2).sum(axis=1))
    return np.where(area > WELD * longest, area, 0.0)


def _flipped(faces: Faces, which: Flags) -> Faces:
    return np.where(which[:, None], faces[:, ::-1], faces)
