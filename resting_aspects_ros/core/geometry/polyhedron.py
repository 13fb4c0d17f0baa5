"""The convex hull of a part as flat facets, edges and corners, seen from the centre of mass."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array, angle_between

Indices = npt.NDArray[np.int64]

# A hull triangle belongs to a facet if its corners are within this of the facet's plane, R: the
# noise of float32 coordinates far from the origin. A finer tessellation than that is not seen.
COPLANAR = 1e-5
# A facet has to fit this many times better than the hull is wide: less is a triangle without
# area, whose normal says nothing.
_SLIVER = 1e-12


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A convex body around the origin, in units of its radius R.

    points : (v, 3) float
        Corners, each with three edges or more.
    normals : (f, 3) float
        Outward unit normals of the facets.
    heights : (f,) float
        Of the origin above each facet's plane.
    ends : (e, 2) int
        Corners at the ends of each edge.
    sides : (e, 2) int
        Facets at its sides: seen from outside, on the left and on the right of the way from the
        first end to the second.
    """

    points: Array
    normals: Array
    heights: Array
    ends: Indices
    sides: Indices

    @cached_property
    def angles(self) -> Array:
        """(e,) angles between the normals at the sides of each edge, rad."""
        return angle_between(self.normals[self.sides[:, 0]], self.normals[self.sides[:, 1]])

    @cached_property
    def feet(self) -> Array:
        """(e,) where on each edge the foot of the perpendicular from the origin is.

        0 at the first end and 1 at the second; outside of that the foot is beyond the edge.
        """
        first = self.points[self.ends[:, 0]]
        along = self.points[self.ends[:, 1]] - first
        return np.asarray(-(first * along).sum(axis=1) / (along * along).sum(axis=1))

    @cached_property
    def margins(self) -> Array:
        """(e, 2) distances of the foot of each side's facet from the edge; negative: outside.

        The foot of a facet is the foot of the perpendicular from the origin onto its plane.
        """
        first = self.points[self.ends[:, 0]]
        along = self.points[self.ends[:, 1]] - first
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        found = []
        for side in (0, 1):
            normal, other = (
                self.normals[self.sides[:, side]],
                self.normals[self.sides[:, 1 - side]],
            )
            out = np.cross(along, normal)
            # Outward is where the other facet's normal leans.
            out *= np.sign((out * other).sum(axis=1, keepdims=True))
            found.append((out * first).sum(axis=1))
        return np.stack(found, axis=1)

    @cached_property
    def edges_of_facets(self) -> list[list[int]]:
        """The edges around each facet, in no order."""
        return _gathered(self.sides, len(self.normals))

    @cached_property
    def edges_of_points(self) -> list[list[int]]:
        """The edges that meet at each corner, in no order."""
        return _gathered(self.ends, len(self.points))

    def corners(self, facet: int) -> Indices:
        """Corners around a facet."""
        return np.unique(self.ends[self.edges_of_facets[facet]])


def polyhedron(points: Array) -> Polyhedron:
    """The hull of points (n, 3) from the origin, which is inside, in units of R."""
    # Worker processes use the class without SciPy, and start in a fraction of the time.
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    triangles = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    area = np.cross(b - a, c - a)
    inward = (area * a).sum(axis=1) < 0
    area[inward] *= -1
    triangles[inward] = triangles[inward][:, ::-1]  # counter-clockwise from outside
    neighbors = hull.neighbors.astype(np.int64)
    neighbors[inward] = neighbors[inward][:, ::-1]
    members = _facets(points, triangles, neighbors, area)
    sums = np.zeros((int(members.max()) + 1, 3))
    np.add.at(sums, members, area)
    normals = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    # Rounding is up to COPLANAR: of the corners of a facet the outermost carries the part.
    heights = np.full(len(normals), -np.inf)
    reach = np.einsum('tij,tj->ti', points[triangles], normals[members]).max(axis=1)
    np.maximum.at(heights, members, reach)
    ends, sides = _edges(triangles, neighbors, members)
    used, ends = np.unique(ends, return_inverse=True)
    return Polyhedron(points[used], normals, heights, ends.reshape(-1, 2), sides)


def _facets(points: Array, triangles: Indices, neighbors: Indices, area: Array) -> Indices:
    """The facet of each triangle: each grows from its largest triangle, within its plane.

    Neighbours compared with each other would make one facet of a finely divided cylinder.
    """
    size = np.linalg.norm(area, axis=1)
    facet = np.full(len(triangles), -1)
    count = 0
    for seed in np.argsort(-size, kind='stable'):
        if facet[seed] >= 0:
            continue
        if size[seed] < _SLIVER:
            # What is left has no area and no normal: each joins a neighbour.
            facet[seed] = next((facet[n] for n in neighbors[seed] if facet[n] >= 0), 0)
            continue
        normal = area[seed] / size[seed]
        level = points[triangles[seed, 0]] @ normal
        facet[seed] = count
        grown = [int(seed)]
        for triangle in grown:
            around = [n for n in neighbors[triangle].tolist() if facet[n] < 0]
            depth = level - points[triangles[around]] @ normal
            for neighbor in np.array(around)[(depth <= COPLANAR).all(axis=1)].tolist():
                facet[neighbor] = count
                grown.append(neighbor)
        count += 1
    return facet


def _edges(triangles: Indices, neighbors: Indices, members: Indices) -> tuple[Indices, Indices]:
    """Ends and sides of the edges between facets; pieces between the same two are one edge."""
    pieces: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for triangle, around in enumerate(neighbors):
        for opposite, neighbor in enumerate(around):
            one, other = int(members[triangle]), int(members[neighbor])
            if one < other:
                a, b = np.roll(triangles[triangle], -opposite - 1)[:2].tolist()
                pieces.setdefault((one, other), []).append((a, b))
    ends, sides = [], []
    for pair, parts in pieces.items():
        starts, stops = map(set, zip(*parts, strict=True))
        tips = [*(starts - stops), *(stops - starts)]
        for a, b in [tips] if len(tips) == 2 else parts:
            ends.append((a, b))
            sides.append(pair)
    return np.array(ends), np.array(sides)


def _gathered(pairs: Indices, count: int) -> list[list[int]]:
    found: list[list[int]] = [[] for _ in range(count)]
    for number, (one, other) in enumerate(pairs.tolist()):
        found[one].append(number)
        found[other].append(number)
    return found
