"""The convex hull of a part as flat facets, edges and corners around the centre of mass."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array, angle_between

Indices = npt.NDArray[np.int64]

# A hull triangle belongs to a facet if its corners are within this distance of the plane of the
# facet, R: the noise of float32 coordinates far from the origin. Finer tessellation has no effect.
# For a slender or thin body the distance is less: this share of its thickness, R, but not less
# than the noise of float32 coordinates near the origin.
COPLANAR, COPLANAR_SHARE, MIN_COPLANAR = 1e-5, 2e-3, 4e-7
# Facets within this angle of the one on which the part rests belong to the same support polygon.
# It is far below the angles of designed parts.
SAME_FACET = np.radians(1.0)
# A triangle with less than twice this area, R^2, is degenerate and its normal is meaningless.
_SLIVER = 1e-12


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A convex body around the origin, in units of its radius R.

    points : (v, 3) float
        Corners, each with three edges or more.
    normals : (f, 3) float
        Outward unit normals of the facets.
    heights : (f,) float
        Height of the origin above the plane of each facet.
    ends : (e, 2) int
        Corners at the ends of each edge.
    sides : (e, 2) int
        Facets on both sides of each edge: seen from outside, on the left and on the right of the
        direction from the first end to the second.
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
        """(e,) position on each edge of the foot of the perpendicular from the origin.

        It is 0 at the first end and 1 at the second; other values are beyond the edge.
        """
        first = self.points[self.ends[:, 0]]
        along = self.points[self.ends[:, 1]] - first
        return np.asarray(-(first * along).sum(axis=1) / (along * along).sum(axis=1))

    @cached_property
    def margins(self) -> Array:
        """(e, 2) distances from each edge of the feet of the two facets; negative if outside.

        The foot of a facet is the foot of the perpendicular from the origin onto its plane.
        """
        first = self.points[self.ends[:, 0]]
        along = self.points[self.ends[:, 1]] - first
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        margins = []
        for side in (0, 1):
            normal, other = (
                self.normals[self.sides[:, side]],
                self.normals[self.sides[:, 1 - side]],
            )
            out = np.cross(along, normal)
            # The normal of the other facet leans outward.
            out *= np.sign((out * other).sum(axis=1, keepdims=True))
            margins.append((out * first).sum(axis=1))
        return np.stack(margins, axis=1)

    @cached_property
    def edges_of_facets(self) -> list[list[int]]:
        """The edges around each facet, unordered."""
        return _gathered(self.sides, len(self.normals))

    @cached_property
    def edges_of_points(self) -> list[list[int]]:
        """The edges that meet at each corner, unordered."""
        return _gathered(self.ends, len(self.points))

    def corners(self, facet: int) -> Indices:
        """Return the corners of a facet."""
        return np.unique(self.ends[self.edges_of_facets[facet]])


def coplanar_facets(hull: Polyhedron, facet: int) -> list[int]:
    """Return a facet and the facets connected to it whose normals are within SAME_FACET of it."""
    normal = hull.normals[facet]
    facets = [facet]
    for each in facets:
        for edge in hull.edges_of_facets[each]:
            other = int(hull.sides[edge].sum()) - each
            near = angle_between(hull.normals[other], normal) <= SAME_FACET
            if near and other not in facets:
                facets.append(other)
    return facets


def polyhedron(points: Array) -> Polyhedron:
    """Return the convex hull of points (n, 3), in units of R, around the origin inside it."""
    # Worker processes use the class without SciPy, which reduces their start time to a fraction.
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
    members = _facets(points, triangles, neighbors, area, _coplanar(points))
    sums = np.zeros((int(members.max()) + 1, 3))
    np.add.at(sums, members, area)
    normals = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    # The corners of a facet deviate by up to COPLANAR; the part rests on the outermost one.
    heights = np.full(len(normals), -np.inf)
    reach = np.einsum('tij,tj->ti', points[triangles], normals[members]).max(axis=1)
    np.maximum.at(heights, members, reach)
    ends, sides = _edges(triangles, neighbors, members)
    used, ends = np.unique(ends, return_inverse=True)
    return Polyhedron(points[used], normals, heights, ends.reshape(-1, 2), sides)


def _coplanar(points: Array) -> float:
    """Return the maximum distance from a plane, R, of points of a body that are in the plane."""
    axes = np.linalg.eigh(np.cov(points.T))[1]
    thickness = float(np.ptp(points @ axes, axis=0).min())
    return max(MIN_COPLANAR, min(COPLANAR, COPLANAR_SHARE * thickness))


def _facets(
    points: Array, triangles: Indices, neighbors: Indices, area: Array, coplanar: float
) -> Indices:
    """Return the facet of each triangle; a facet grows from its largest triangle in one plane.

    Comparing neighbours with each other would merge a finely divided cylinder into one facet.
    """
    size = np.linalg.norm(area, axis=1)
    facet = np.full(len(triangles), -1)
    count = 0
    for seed in np.argsort(-size, kind='stable'):
        if facet[seed] >= 0:
            continue
        if size[seed] < _SLIVER:
            # The remaining triangles have no area and no normal: each joins a neighbour.
            facet[seed] = next((facet[n] for n in neighbors[seed] if facet[n] >= 0), 0)
            continue
        normal = area[seed] / size[seed]
        level = points[triangles[seed, 0]] @ normal
        facet[seed] = count
        grown = [int(seed)]
        for triangle in grown:
            around = [n for n in neighbors[triangle].tolist() if facet[n] < 0]
            depth = level - points[triangles[around]] @ normal
            for neighbor in np.array(around)[(depth <= coplanar).all(axis=1)].tolist():
                facet[neighbor] = count
                grown.append(neighbor)
        count += 1
    return facet


def _edges(triangles: Indices, neighbors: Indices, members: Indices) -> tuple[Indices, Indices]:
    """Return ends and sides of the edges between facets; one edge for each pair of facets."""
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
    """Return for each member of the pairs the numbers of the pairs that contain it."""
    numbers: list[list[int]] = [[] for _ in range(count)]
    for number, (one, other) in enumerate(pairs.tolist()):
        numbers[one].append(number)
        numbers[other].append(number)
    return numbers
