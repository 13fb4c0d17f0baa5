"""Curved sides of a mesh: the distance of its triangles from them, and which edges are steps."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.part.hull import Polyhedron
from resting_aspects_ros.part.near import face_normals
from resting_aspects_ros.part.surface import connected

# Maximum step of the mesh of a curved side: that of a circle of 15 sides or more (24 degrees). A
# circle with fewer sides is a prism with flat sides.
CURVED_STEP = np.radians(25.0)
# Triangles that meet at a smaller angle are in one plane, up to the noise of float32.
FLAT_ANGLE = np.radians(0.1)
# Maximum angle between the triangles of a facet, rad.
MAX_BEND = 5 * FLAT_ANGLE
# A flat bounded by curved strips, such as a face with rounded edges, does not belong to the curved
# side. It is distinguished from a wide strip by this ratio to the width of the adjacent strips.
MAX_WIDTH_RATIO = 3.0
# Minimum area of a convex facet in terms of its covariance, which is that of a triangle, 6
# sqrt(3), reduced slightly for rounding.
CONVEX = 10.0
# Safety factor on the depths derived for strips and equilateral triangles.
MARGIN = 1.25


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """The edges of triangles.

    ends : (k, 2) int64, vertices; sides : (k, 2) int64, triangles; angle : (k,) float64, between
    their normals, rad.
    """

    ends: Indices
    sides: Indices
    angle: Array


def sagittas(vertices: Array, faces: Indices) -> tuple[Array, Flags]:
    """Return the depth of the true surface over each triangle, and which vertices are corners.

    Triangles in one plane form a facet. Over a facet the true surface has the slope a/2 at an edge
    of angle a. By the divergence theorem its mean curvature tensor K is the sum over the edges of
    a/2 length n n^T / area, where n is the normal of the edge in the plane of the facet. A
    paraboloid of curvature k rises over a strip of width w by k w^2 / 8, and over an equilateral
    triangle by k (circumradius)^2 / 2. With the covariance C of the facet both are at most
    2 trace(K C).

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) int64

    Returns
    -------
    depth : (m,) float64
        In the unit of the vertices; 0 if no edge of a triangle is on a curved surface.
    corners : (n,) bool
        Vertices at an edge that is too sharp for a curved surface or is not shared by two
        triangles.
    """
    triangles = vertices[faces]
    twice = face_normals(triangles)
    area = np.linalg.norm(twice, axis=1) / 2
    normals = twice / np.maximum(2 * area, np.finfo(float).tiny)[:, None]
    edges = mesh_edges(faces, normals)
    blunt = edges.angle <= CURVED_STEP
    corners = np.zeros(len(vertices), dtype=bool)
    corners[edges.ends[~blunt]] = True

    facet = _facets(normals, area, edges.sides[edges.angle < FLAT_ANGLE])
    size, covariance = _spread(triangles, area, facet)
    curved = blunt & (edges.angle >= FLAT_ANGLE)
    ends, sides = vertices[edges.ends[curved]], edges.sides[curved]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    across = np.cross((along / length[:, None])[:, None], normals[sides])
    width = np.einsum('esi,esij,esj->es', across, covariance[facet[sides]], across)
    width *= _fullness(size, covariance)[facet[sides]] ** 2
    width = np.minimum(width, MAX_WIDTH_RATIO**2 * width[:, ::-1])
    rise = (edges.angle[curved] * length)[:, None] * width / size[facet[sides]]
    depth = np.bincount(facet[sides].ravel(), weights=rise.ravel(), minlength=len(size))
    return np.asarray(MARGIN * depth[facet]), corners


def _fullness(size: Array, covariance: Array) -> Array:
    """Return the share of its extent that each facet fills: 1 if convex, about w / r for a ring.

    The area of a convex facet is at least 6 sqrt(3) times the root of the determinant of its
    covariance, which is the value of a triangle. A ring around the top of a torus is narrower than
    its covariance suggests.
    """
    trace = np.einsum('kii->k', covariance)
    square = np.einsum('kij,kij->k', covariance, covariance)
    root = np.sqrt(np.maximum((trace**2 - square) / 2, np.finfo(float).tiny))
    return np.asarray(np.minimum(size / (CONVEX * root), 1.0))


def mesh_edges(faces: Indices, normals: Array) -> MeshEdges:
    """Return the edges of triangles (m, 3) with unit normals (m, 3).

    Those that are not shared by exactly two triangles count as sharp: they have an angle of pi and
    their first two triangles (or a single one, twice).
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    number = high * len(normals) * 3 + low  # unique: there are at most 3 vertices per triangle
    order = np.argsort(number, kind='stable')
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    count = np.diff(np.r_[first, len(order)])
    pair = np.stack([order[first], order[first + (count > 1)]], axis=1)
    sides = pair // 3
    # Neighbours use their edge in opposite directions, unless one of them is inside out.
    sign = np.where(start[pair[:, 0]] == start[pair[:, 1]], -1.0, 1.0)
    a, b = normals[sides[:, 0]], normals[sides[:, 1]] * sign[:, None]
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum('ij,ij->i', a, b))
    ends = np.stack([low, high], axis=1)[order[first]]
    return MeshEdges(ends, sides, np.where(count == 2, angle, np.pi))


def _facets(normals: Array, area: Array, pairs: Indices) -> Indices:
    """Return the facet of each triangle: triangles connected by flat edges, if coplanar.

    If the steps of a fine curved mesh are below FLAT_ANGLE, connected triangles are not coplanar;
    then each triangle is a facet.
    """
    facet = connected(len(normals), pairs)
    mean = np.stack([np.bincount(facet, weights=area * side) for side in normals.T], axis=1)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1), np.finfo(float).tiny)[:, None]
    apart = np.linalg.norm(normals - mean[facet], axis=1) * (area > 0)
    bent = np.bincount(facet, weights=apart > MAX_BEND) > 0
    own = bent[facet]
    facet[own] = len(mean) + np.flatnonzero(own)
    return np.unique(facet, return_inverse=True)[1].astype(np.int64)


def _spread(triangles: Array, area: Array, facet: Indices) -> tuple[Array, Array]:
    """Return the area (k,) of each facet and the covariance (k, 3, 3) of the points on it."""
    size = np.maximum(np.bincount(facet, weights=area), np.finfo(float).tiny)

    def total(values: Array) -> Array:
        columns = values.reshape(len(values), -1).T
        sums = [np.bincount(facet, weights=area * column) for column in columns]
        return np.stack(sums, axis=1) / size[:, None]

    middle = total(triangles.mean(axis=1))
    arms = triangles - middle[facet][:, None]
    whole = arms.sum(axis=1)
    # Second moments of a triangle: (sum of v v^T + s s^T) / 12, s being the sum of its corners.
    second = np.einsum('mci,mcj->mij', arms, arms) + whole[:, :, None] * whole[:, None, :]
    return size, total(second / 12).reshape(-1, 3, 3)


# -- Steps of the mesh ----------------------------------------------------------------------------


# Successive steps of a curved side and the widths of its flats differ by at most this factor.
MAX_RATIO = 2.5
# A flat that is wider than its neighbour by more than this factor is a flat side there.
MAX_CHORD_RATIO = 2.0
# Inside an irregular mesh, a step is at most this multiple of the median of those around it, and
# a flat at most this multiple of the mean area of those around it: triangles between random points
# on a sphere reach 4 and 8.
MAX_IRREGULARITY, MAX_AREA_RATIO = 5.0, 10.0
# Maximum number of corners of a flat of an irregular mesh: a quadrilateral that was cut has five.
MAX_CORNERS = 5
# A flat is wider than its neighbour, not only irregular, from this ratio of their widths on. Then
# the step to it is at most MAX_TANGENT_RATIO times the next one.
WIDE, MAX_TANGENT_RATIO = 1.5, 1.25
# Minimum cosine between the directions in which two successive steps turn.
AHEAD = 0.3
# An edge with less than this share of the angle of a step only divides a flat, because of noise;
# at most this many parts of a flat are considered.
NOISE_SHARE, MAX_IN_PLANE = 0.2, 8
# Two steps are in the same direction, or opposite ones, if the cosine is more than this.
PARALLEL = 0.7
# Depth of a flat between parallel edges, as a multiple of that of equal flats, and depth of a
# triangle, as a multiple of its curvature times its covariance: 2 for equal triangles on a sphere.
# Between random points on a sphere, the curvature of a triangle varies by a factor of 2.
STRIP_DEPTH, TRIANGLE_DEPTH, EQUAL_DEPTH = 1.3, 7.0, 2.6


class CurvedEdges:
    """The edges of a hull that are steps of the mesh of a curved side.

    Parameters
    ----------
    hull : Polyhedron
    """

    def __init__(self, hull: Polyhedron) -> None:
        self._hull = hull
        self._small = (hull.angles <= CURVED_STEP).tolist()
        self._angles = hull.angles.tolist()
        self._sides = hull.sides.tolist()

    @cached_property
    def curved(self) -> Flags:
        """(e,) whether each edge is a step of the mesh of a curved side."""
        found = self._inside.copy()
        for edge in np.flatnonzero(self._hull.angles <= CURVED_STEP).tolist():
            if not found[edge]:
                found[edge] = self._is_step(edge)
        return np.asarray(found)

    @cached_property
    def _inside(self) -> Flags:
        """(e,) whether each edge is inside an irregular mesh, with small steps all around it."""
        hull = self._hull
        ends = hull.ends
        largest = np.zeros(len(hull.points))
        np.maximum.at(largest, ends.ravel(), np.repeat(hull.angles, 2))
        typical = np.array([np.median(hull.angles[edges]) for edges in hull.edges_of_points])
        # The mesh continues at one of the sides, at least: a flat side among strips with a sharp
        # edge on the other side, such as those of fillets with two chords, is no mesh.
        sides, is_step = hull.sides, hull.angles <= CURVED_STEP
        sharp = np.zeros(len(hull.normals), dtype=np.bool_)
        sharp[sides[~is_step]] = True
        core = (self._corners == 3) | ((self._corners == 4) & ~sharp)
        continues = np.zeros(len(core), dtype=np.bool_)
        continues[sides[is_step & core[sides].all(axis=1)]] = True
        return np.asarray(
            ((self._corners <= MAX_CORNERS) & self._is_small)[sides].all(axis=1)
            & (core & continues)[sides].any(axis=1)
            & (largest[ends] <= CURVED_STEP).all(axis=1)
            & (hull.angles <= MAX_IRREGULARITY * typical[ends].max(axis=1))
        )

    @cached_property
    def _is_small(self) -> Flags:
        """(f,) whether each facet is not much larger than those with which it shares a corner."""
        hull = self._hull
        pairs = [(hull.ends[:, i], hull.sides[:, j]) for i in (0, 1) for j in (0, 1)]
        points, facets = np.unique(np.concatenate(pairs, axis=1), axis=1)
        around, count = np.zeros(len(hull.points)), np.zeros(len(hull.points))
        np.add.at(around, points, self._areas[facets])
        np.add.at(count, points, 1.0)
        others, number = np.zeros(len(self._areas)), np.zeros(len(self._areas))
        np.add.at(others, facets, around[points] - self._areas[facets])
        np.add.at(number, facets, count[points] - 1)
        return np.asarray(self._areas <= MAX_AREA_RATIO * others / number)

    @cached_property
    def _areas(self) -> Array:
        """(f,) areas of the facets, R^2."""
        hull = self._hull
        along = hull.points[hull.ends[:, 1]] - hull.points[hull.ends[:, 0]]
        parts = np.linalg.norm(along, axis=1)[:, None] * hull.margins / 2
        return np.bincount(hull.sides.ravel(), parts.ravel(), len(hull.normals)).astype(float)

    @cached_property
    def meshed(self) -> Flags:
        """(f,) whether each facet is a flat of a curved side."""
        return self._largest(self._chords) > 0

    @cached_property
    def depth(self) -> Array:
        """(e,) maximum barrier, R, across each edge that the mesh explains; 0 if it is sharp."""
        depth = np.zeros(len(self._angles))
        for edge in np.flatnonzero(self.curved).tolist():
            depth[edge] = max(self._depth_across(edge, facet) for facet in self._sides[edge])
        return depth

    @cached_property
    def share(self) -> Array:
        """(e,) ``depth`` of each edge, as a share of that of its facets in all directions."""
        whole = self.facet_depth[self._hull.sides].max(axis=1)
        return np.asarray(self.depth / np.maximum(whole, 1e-300))

    @cached_property
    def facet_depth(self) -> Array:
        """(f,) maximum depth, R, of each facet below its curved side; 0 if it is a flat side."""
        strips = STRIP_DEPTH * self._largest(self._chords * self._sagittas)
        triangles = TRIANGLE_DEPTH * np.einsum('fij,fij->f', *self._bending)
        return np.where(self._corners == 3, triangles, strips)

    @cached_property
    def typical_depth(self) -> Array:
        """(f,) depth, R, of each facet below its curved side, as if all flats were equal."""
        triangles = EQUAL_DEPTH / TRIANGLE_DEPTH * self.facet_depth
        return np.where(self._corners == 3, triangles, self.facet_depth)

    @cached_property
    def _bending(self) -> tuple[Array, Array]:
        """(f, 3, 3) curvature tensors, 1 / R, of triangles and their covariances, R^2.

        The curvature over a triangle is the sum over its edges of half the angle times the length
        times the square of the direction in which the surface turns, by area: see
        tessellation.sagittas.
        """
        hull = self._hull
        arms = hull.points[hull.ends[:, 1]] - hull.points[hull.ends[:, 0]]
        turn = np.diff(hull.normals[hull.sides], axis=1)[:, 0]
        turn /= np.maximum(np.linalg.norm(turn, axis=1, keepdims=True), 1e-300)
        bend = (hull.angles / 2 * np.linalg.norm(arms, axis=1))[:, None, None]
        bend = bend * turn[:, :, None] * turn[:, None, :]
        bending, covariance = np.zeros((2, len(hull.normals), 3, 3))
        for side in (0, 1):
            facets = hull.sides[:, side]
            np.add.at(bending, facets, bend * self._chords[:, side, None, None])
            # With the sides a, b and c of a triangle, its covariance is (a a + b b + c c) / 36.
            np.add.at(covariance, facets, arms[:, :, None] * arms[:, None, :] / 36)
        return bending / self._areas[:, None, None], covariance

    @cached_property
    def _chords(self) -> Flags:
        """(e, 2) whether the facet on each side of an edge is a flat of a curved side there."""
        widths = self.widths
        triangles = (self._corners == 3)[self._hull.sides].all(axis=1)
        ratio = np.where(self._inside & triangles, MAX_IRREGULARITY, MAX_CHORD_RATIO)[:, None]
        return self.curved[:, None] & (widths <= ratio * widths[:, ::-1])

    def _largest(self, values: npt.NDArray[Any]) -> Array:
        """Return the maximum of values (e, 2) at the sides of edges for each facet (f,), or 0."""
        largest = np.zeros(len(self._hull.normals))
        np.maximum.at(largest, self._hull.sides.ravel(), values.ravel())
        return largest

    def _depth_across(self, edge: int, facet: int) -> float:
        """Return the depth, R, of a facet below its curved side, across an edge."""
        hull = self._hull
        turn = hull.normals[sum(self._sides[edge]) - facet] - hull.normals[facet]
        if self._corners[facet] == 3:
            bending, covariance = (each[facet] for each in self._bending)
            turn /= np.linalg.norm(turn)
            return TRIANGLE_DEPTH * float((turn @ bending @ turn) * (turn @ covariance @ turn))
        depth = 0.0
        for other in hull.edges_of_facets[facet]:
            side = self._sides[other].index(facet)
            if self._chords[other, side]:
                turned = hull.normals[sum(self._sides[other]) - facet] - hull.normals[facet]
                cosine = turn @ turned / np.sqrt((turn @ turn) * (turned @ turned))
                if abs(cosine) > PARALLEL:
                    depth = max(depth, STRIP_DEPTH * float(self._sagittas[other, side]))
        return depth

    @cached_property
    def step(self) -> Array:
        """(f,) maximum angle, rad, of the steps of the curved side at each facet."""
        most = np.zeros(len(self._hull.normals))
        chosen = np.flatnonzero(self.curved)
        np.maximum.at(
            most, self._hull.sides[chosen].ravel(), np.repeat(self._hull.angles[chosen], 2)
        )
        return most

    @cached_property
    def _corners(self) -> Indices:
        return np.array([len(edges) for edges in self._hull.edges_of_facets])

    @cached_property
    def widths(self) -> Array:
        """(e, 2) how far the facets on both sides extend from each edge, R."""
        hull = self._hull
        first = hull.points[hull.ends[:, 0]]
        along = hull.points[hull.ends[:, 1]] - first
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        widths = np.empty(hull.sides.shape)
        corners = [hull.corners(facet) for facet in range(len(hull.normals))]
        for side in (0, 1):
            around = [corners[facet] for facet in hull.sides[:, side]]
            owner = np.repeat(np.arange(len(around)), [len(each) for each in around])
            arms = hull.points[np.concatenate(around)] - first[owner]
            across = (arms * arms).sum(axis=1) - (arms * along[owner]).sum(axis=1) ** 2
            furthest = np.zeros(len(around))
            np.maximum.at(furthest, owner, across)
            widths[:, side] = np.sqrt(furthest)
        return widths

    @cached_property
    def _sagittas(self) -> Array:
        """(e, 2) depth, R, of the flats on both sides of each edge below their curved side.

        The surface turns across a flat of width w by the share w / (w + v) of the angle to a flat
        of width v at both ends; an arc that turns by t rises by w t / 8 above its chord.
        """
        widths = self.widths
        share = widths / widths.sum(axis=1, keepdims=True)
        return np.asarray(widths * share * self._hull.angles[:, None] / 4)

    def _is_step(self, edge: int) -> bool:
        """Return whether an edge is one of three similar steps that follow each other."""
        after = [self._next_steps(edge, middle) for middle in self._sides[edge]]
        return all(after) or any(
            self._next_steps(other, beyond) for others in after for other, beyond in others
        )

    def _next_steps(self, edge: int, middle: int) -> list[tuple[int, int]]:
        """Return the edges where a similar step follows, and the facets beyond them.

        They are edges of the facet ``middle`` beside an edge, or of facets that noise separated
        from it.
        """
        hull = self._hull
        back = hull.normals[sum(self._sides[edge]) - middle] - hull.normals[middle]
        found, plane = [], [middle]
        for facet in plane:
            for other in hull.edges_of_facets[facet]:
                beyond = sum(self._sides[other]) - facet
                if self._angles[other] < NOISE_SHARE * self._angles[edge]:
                    if beyond not in plane and len(plane) < MAX_IN_PLANE:
                        plane.append(beyond)
                elif other != edge and self._small[other]:
                    ahead = hull.normals[beyond] - hull.normals[facet]
                    turn = ahead @ back / np.sqrt((ahead @ ahead) * (back @ back))
                    if turn < -AHEAD and self._alike((edge, middle), (other, facet)):
                        found.append((other, beyond))
        return found

    def _alike(self, one: tuple[int, int], other: tuple[int, int]) -> bool:
        """Return whether two steps, from a facet over an edge of it, and the flats are similar."""
        for (edge, facet), (next_edge, _) in ((one, other), (other, one)):
            side = self._sides[edge].index(facet)
            wide = self.widths[edge, 1 - side] / self.widths[edge, side]
            limit = MAX_RATIO if wide < WIDE else MAX_TANGENT_RATIO
            if self._angles[edge] > limit * self._angles[next_edge] or wide < 1 / MAX_RATIO:
                return False
        return True
