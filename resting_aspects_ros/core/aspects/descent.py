"""Quasi-static rolling of a released part: steepest descent of the support height.

A direction d is the direction of gravity in the part frame. The part touches the surface with its
lowest corner p, and the support height is s(d) = max p . d. While one corner touches, the part
pivots about it: d moves away from p along a great circle. When a second corner touches, the part
rolls over the edge between them if the foot of the perpendicular from the centre of mass is inside
the edge; otherwise it pivots about the second corner. This is repeated until the centre of mass is
above the inside of a facet (Baktash, Sharp, Zhou, Crane, Jacobson, SIGGRAPH 2025).
"""

from collections.abc import Iterator

import numpy as np

from resting_aspects_ros.core.geometry.polyhedron import Indices, Polyhedron
from resting_aspects_ros.core.rotations import Array

# A part can rest on a facet if its centre of mass is inside the facet by more than this, R. Less
# is indistinguishable from the noise of float32 coordinates, and any disturbance tips the part
# over. For slender parts the margin is less: this share of the width of the facet.
STABLE_MARGIN, MARGIN_SHARE = 1e-4, 0.01
# Number of array elements that are processed at once, to limit the memory.
_BATCH = 4_000_000


class Descent:
    """The steepest descent on a polyhedron.

    onto : (f,) int
        For each facet the next facet to which a part rolls; itself if it is stable.
    rest : (f,) int
        For each facet the stable facet to which a part released on it rolls.
    """

    def __init__(self, body: Polyhedron) -> None:
        self._body = body
        self._radii = np.linalg.norm(body.points, axis=1)
        around = body.edges_of_points
        self._width = max(map(len, around))
        self._edges = np.full((len(around), self._width), -1)
        for point, edges in enumerate(around):
            self._edges[point, : len(edges)] = edges
        self.onto = self._without_cycles(self._onto())
        self.rest = self._settle()

    def facets_from(self, directions: Array) -> Indices:
        """Return the stable facets (n,) to which a part rolls from unit vectors (n, 3)."""
        found = np.empty(len(directions), dtype=np.int64)
        for chunk in _slices(len(directions), len(self._body.points)):
            # Not a matrix product, because its rounding depends on the number of rows.
            x, y, z = directions[chunk].T[:, :, None]
            px, py, pz = self._body.points.T
            found[chunk] = (x * px + y * py + z * pz).argmax(axis=1)
        for chunk in _slices(len(directions), 9 * self._width):
            found[chunk] = self.rest[self._first_facets(directions[chunk], found[chunk])]
        return found

    def _first_facets(self, directions: Array, corner: Indices) -> Indices:
        """Return the facet on which each part first lies when it pivots about a corner."""
        body = self._body
        found = np.empty(len(directions), dtype=np.int64)
        left = np.arange(len(directions))
        d = directions
        while len(left):
            edge, d = self._next_edge(d, corner)
            second = body.ends[edge, 1] == corner
            other = np.where(second, body.ends[edge, 0], body.ends[edge, 1])
            foot = np.where(second, 1 - body.feet[edge], body.feet[edge])
            over = foot < 1
            found[left[over]] = self._over_edge(edge[over], d[over])
            left, d, corner = left[~over], d[~over], other[~over]
        return found

    def _next_edge(self, d: Array, corner: Indices) -> tuple[Indices, Array]:
        """Return the edge that each part touches next, and its down direction then."""
        p = self._body.points[corner]
        away = (p * d).sum(axis=1, keepdims=True) * d - p
        length = np.linalg.norm(away, axis=1, keepdims=True)
        # Exactly above the corner every direction leads down; any of them is valid.
        axis = np.eye(3)[np.abs(d).argmin(axis=1)]
        along = np.cross(d, axis)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        away = np.where(length > 1e-12, away / np.maximum(length, 1e-300), along)
        edges = self._edges[corner]
        ends = self._body.ends[edges]
        other = np.where(ends[..., 1] == corner[:, None], ends[..., 0], ends[..., 1])
        gap = p[:, None, :] - self._body.points[other]
        now = np.maximum((gap * d[:, None, :]).sum(axis=2), 0.0)
        rate = (gap * away[:, None, :]).sum(axis=2)
        angle = np.arctan2(now, -rate)
        angle[edges < 0] = np.inf
        first = angle.argmin(axis=1)
        rows = np.arange(len(d))
        turn = angle[rows, first][:, None]
        moved = np.cos(turn) * d + np.sin(turn) * away
        return edges[rows, first], moved / np.linalg.norm(moved, axis=1, keepdims=True)

    def _over_edge(self, edge: Indices, d: Array) -> Indices:
        """Return the facet to which each part rolls over an edge, away from the balance on it."""
        body = self._body
        a, b = np.moveaxis(body.points[body.ends[edge]], 1, 0)
        top = a + body.feet[edge][:, None] * (b - a)
        turn = np.cross(top, b - a)
        lean = (d * turn).sum(axis=1)
        first, second = body.sides[edge].T
        towards = ((body.normals[second] - body.normals[first]) * turn).sum(axis=1)
        return np.asarray(np.where((lean > 0) == (towards > 0), second, first))

    def _settle(self) -> Indices:
        """Return the stable facet that follows each facet."""
        onto = self.onto
        while (onto[onto] != onto).any():
            onto = onto[onto]
        return onto

    def _onto(self) -> Indices:
        """Return for each facet the facet that follows; itself if it is stable."""
        body = self._body
        onto = np.arange(len(body.normals))
        pivots: list[tuple[int, int]] = []
        for facet, edges in enumerate(body.edges_of_facets):
            which = (body.sides[edges, 1] == facet).astype(int)
            margin = body.margins[edges, which]
            needed = STABLE_MARGIN
            if 0 < margin.min() <= needed:
                needed = min(needed, MARGIN_SHARE * self._width_of(facet))
            if margin.min() > needed:
                continue
            ends = body.points[body.ends[edges]]
            at = np.clip(body.feet[edges], 0.0, 1.0)[:, None]
            nearest = ends[:, 0] + at * (ends[:, 1] - ends[:, 0])
            distance = np.linalg.norm(nearest - body.heights[facet] * body.normals[facet], axis=1)
            distance[margin > needed] = np.inf
            k = int(distance.argmin())
            edge = edges[k]
            if 0.0 < at[k, 0] < 1.0:
                onto[facet] = body.sides[edge, 1 - which[k]]
            else:
                pivots.append((facet, int(body.ends[edge, int(at[k, 0])])))
        if pivots:
            facets, corners = np.array(pivots).T
            onto[facets] = self._first_facets(body.normals[facets], corners)
        return onto

    def _width_of(self, facet: int) -> float:
        """Return the minimum width of a facet, R."""
        body = self._body
        ends = body.points[body.ends[body.edges_of_facets[facet]]]
        out = np.cross(ends[:, 1] - ends[:, 0], body.normals[facet])
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        return float(np.ptp(body.points[body.corners(facet)] @ out.T, axis=0).min())

    def _without_cycles(self, onto: Indices) -> Indices:
        """Make the lowest facet of each cycle stable; noise causes cycles of nearby facets."""
        seen = np.full(len(onto), -1)  # the facet from which each was reached first
        for start in range(len(onto)):
            facet = start
            while seen[facet] < 0:
                seen[facet] = start
                facet = int(onto[facet])
            if seen[facet] != start:
                continue
            cycle = [facet]
            while onto[cycle[-1]] != facet:
                cycle.append(int(onto[cycle[-1]]))
            lowest = min(cycle, key=lambda k: float(self._body.heights[k]))
            onto[lowest] = lowest
        return onto


def _slices(count: int, width: int) -> Iterator[slice]:
    """Return slices of rows of ``width`` numbers that are processed at once."""
    step = max(1, _BATCH // width)
    return (slice(first, first + step) for first in range(0, count, step))
