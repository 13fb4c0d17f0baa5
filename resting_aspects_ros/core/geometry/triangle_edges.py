"""The edges of the triangles of a surface, and what they connect."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


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
