"""The convex hull of a part: vertices, facets, edges, and its simplification."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, KDTree, QhullError
from scipy.spatial.distance import cdist

from resting_aspects_ros.arrays import Array, Faces, Indices
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.near import TriangleTree
from resting_aspects_ros.rotations import angle_between

# -- Facets and edges -----------------------------------------------------------------------------


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

    def tops(self, edges: Indices) -> Array:
        """Return the feet (n, 3) of the perpendiculars from the origin on some edges (n,), R."""
        first, second = np.moveaxis(self.points[self.ends[edges]], -2, 0)
        return np.asarray(first + self.feet[edges][..., None] * (second - first))

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
    facets = members.tolist()
    rows = zip(facets, triangles.tolist(), neighbors.tolist(), strict=True)
    for one, corners, around in rows:
        for opposite, neighbor in enumerate(around):
            other = facets[neighbor]
            if one < other:
                edge = corners[opposite - 2], corners[opposite - 1]
                pieces.setdefault((one, other), []).append(edge)
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


# -- Solid angles ---------------------------------------------------------------------------------


def triangle_angles(a: Array, b: Array, c: Array) -> Array:
    """Return the solid angles (n,) of triangles seen from the origin, sr; negative if clockwise.

    The corners (n, 3) are at any distance but zero, and counter-clockwise as seen from the side
    away from the origin (Van Oosterom and Strackee 1983).
    """
    triple = (a * np.cross(b, c)).sum(axis=1)
    ra, rb, rc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    spread = (
        ra * rb * rc
        + (a * b).sum(axis=1) * rc
        + (b * c).sum(axis=1) * ra
        + (c * a).sum(axis=1) * rb
    )
    return np.asarray(2 * np.arctan2(triple, spread))


def facet_angles(body: Polyhedron) -> Array:
    """Return the solid angles (f,) of the facets seen from the origin, sr; their sum is 4 pi."""
    first, second = body.points[body.ends[:, 0]], body.points[body.ends[:, 1]]
    left, right = body.sides.T
    found = np.zeros(len(body.normals))
    # A fan around the foot of each facet. If the foot is outside, some triangles are negative.
    np.add.at(found, left, triangle_angles(body.normals[left], first, second))
    np.add.at(found, right, triangle_angles(body.normals[right], second, first))
    return found


def polygon_angle(polygon: Array, height: float) -> float:
    """Return the solid angle, sr, of a counter-clockwise polygon (k, 2) from above its origin."""
    # As the bottom of a body, the polygon is clockwise when seen from outside.
    around = np.column_stack([polygon[::-1], np.full(len(polygon), -height)])
    foot = np.broadcast_to([0.0, 0.0, -height], around.shape)
    return float(triangle_angles(foot, around, np.roll(around, -1, axis=0)).sum())


# -- Simplification -------------------------------------------------------------------------------


# Hulls with at most this number of corners are unchanged. Bullet tests every corner in every step:
# a drop of an egg with 1000, 2000 or 3000 corners takes 9, 14 or 21 ms, that of a box 2 ms. The
# error of a ball is 3e-3 with 2000 corners and 1.7e-3 with 3000; heights are distinguished from
# 1e-3 R.
MAX_CORNERS = 3000
# Lengths are in units of the maximum distance of a corner from the mean of all corners, about R.
# Corners are added until the others are outside by at most this, which does not affect the
# landscape (COPLANAR).
FINE = 1e-5
# Below this error a round that exceeds the maximum number of corners is not started: half a round
# would leave a cylinder with corners at its top that have no counterpart at its bottom.
GOOD = 5e-4
# A round adds corners that are further outside than this share of the maximum.
ROUND = 0.7
# Number of sides from which the first corners are selected.
SIDES = 300
# Maximum distance of corners in the plane of a side: the noise of float32.
IN_PLANE = 2e-6
# A wider side is flat: on a round side only sqrt(8 IN_PLANE) = 0.004 is in a plane.
WIDE = 0.01
# Tolerance of the outline of a flat side: 4^k times this, with the smallest k for which the
# corners suffice.
OUTLINE = 1e-4
# Number of random corners that are used in the rounds; the final error is that of all corners.
SAMPLES = 50_000


def simplify_hull(
    corners: Array, triangles: Indices, normals: Array, max_corners: int = MAX_CORNERS
) -> tuple[Array, float]:
    """Return the corners of a hull, or a selection if there are too many, and the error.

    Parameters
    ----------
    corners : (n, 3) float64
        m, all corners of the hull, in lexicographic order, like the result.
    triangles : (f, 3) int64
        Triangles of the hull, rows of ``corners``.
    normals : (f, 3) float64
        Outward unit normals of the triangles.
    max_corners : int
        Maximum number of corners that are kept.

    Returns
    -------
    kept : (k, 3) float64
        m.
    error : float
        m; the exact maximum distance of an omitted corner from the hull of the others.
    """
    if len(corners) <= max_corners:
        return corners, 0.0
    centre = corners.mean(axis=0)
    size = float(np.linalg.norm(corners - centre, axis=1).max())
    points = (corners - centre) / size
    kept = _first(points, triangles, normals, max_corners // 2)
    # Any permutation is suitable; this one is reproducible.
    samples = np.random.default_rng(23).permutation(len(points))[:SAMPLES]
    furthest = 0.0
    while True:
        tree = TriangleTree(points[kept[ConvexHull(points[kept]).simplices]])
        about = max(1.01 * furthest, GOOD)
        out, owner = tree.distances(points[samples], about)
        furthest = float(out.max())
        new = samples[_round(points[samples], out, owner, KDTree(points[kept]))]
        room = max_corners - len(kept)
        if furthest <= FINE or room <= 0 or (len(new) > room and furthest <= GOOD):
            break
        kept = np.union1d(kept, new[:room])
    about = max(1.01 * furthest, GOOD)
    return corners[kept], size * float(tree.distances(points, about)[0].max())


def _first(points: Array, triangles: Indices, normals: Array, max_corners: int) -> Indices:
    """Return the first corners: those of sides whose planes together approximate the hull."""
    columns = np.ascontiguousarray(points.T)
    depth = np.full(len(triangles), np.inf)  # of the lowest corner of each below the best plane
    side = int(np.einsum('fi,fi->f', normals, points[triangles[:, 0]]).argmin())
    ends, flats = [], []
    for _ in range(SIDES):
        reach = normals[side] @ columns
        corners = np.flatnonzero(reach >= reach.max() - IN_PLANE)
        arms = points[corners] - points[corners].mean(axis=0)
        flat = arms @ np.linalg.eigh(arms.T @ arms)[1][:, :0:-1]  # the longer direction first
        if np.ptp(flat[:, 1]) > WIDE:
            flats.append((corners, flat))
        else:
            ends += corners[_ends(*flat.T)].tolist()
        a, b, c = reach[triangles.T]
        np.minimum(depth, reach.max() - np.minimum(np.minimum(a, b), c), out=depth)
        side = int(depth.argmax())
        if depth[side] <= FINE:
            break
    for cut in OUTLINE * 4.0 ** np.arange(10):
        kept = np.unique(np.array(ends, dtype=np.int64))
        for corners, flat in flats:
            kept = np.union1d(kept, corners[_outline(flat, np.isin(corners, kept), cut)])
        if len(kept) <= max_corners:
            break
    return kept


def _ends(along: Array, across: Array) -> list[int]:
    """Return the corners at both ends of a strip, in the middle of its width; one for a spot."""
    off = np.abs(across - (across.max() + across.min()) / 2)
    if np.ptp(along) <= WIDE:
        return [int(np.hypot(along, off).argmin())]
    near = along <= along.min() + WIDE, along >= along.max() - WIDE
    return [int(np.where(end, off, np.inf).argmin()) for end in near]


def _outline(flat: Array, kept: npt.NDArray[np.bool_], cut: float) -> Indices:
    """Return the corners of the outline of a flat side (n, 2), including those kept already."""
    around = ConvexHull(flat).vertices.astype(np.int64)
    fixed = np.flatnonzero(kept[around])
    if len(fixed) < 2:
        fixed = np.unique([flat[around, 0].argmin(), flat[around, 0].argmax()])
    around = np.roll(around, -fixed[0])
    stops = [*(fixed - fixed[0]).tolist(), len(around)]
    polygon = flat[np.append(around, around[0])]
    bends = [k for a, b in pairwise(stops) for k in _bends(polygon, a, b, cut)]
    return around[stops[:-1] + bends]


def _bends(polygon: Array, first: int, last: int, cut: float) -> list[int]:
    """Return the corners that the tolerance requires between two others (Douglas, Peucker)."""
    if last - first < 2:
        return []
    (x, y), arms = polygon[last] - polygon[first], polygon[first + 1 : last] - polygon[first]
    off = np.abs(arms @ [-y, x]) / np.hypot(x, y)
    k = first + 1 + int(off.argmax())
    if off.max() <= cut:
        return []
    return [*_bends(polygon, first, k, cut), k, *_bends(polygon, k, last, cut)]


def _round(points: Array, out: Array, owner: Indices, kept: KDTree) -> Indices:
    """Return the furthest point outside each triangle, if it is far, in descending order.

    Of two points that are closer to each other than to those kept, only the first is returned.
    """
    order = np.argsort(-out, kind='stable')
    order = order[out[order] > ROUND * out[order[0]]]
    new = order[np.sort(np.unique(owner[order], return_index=True)[1])]
    near = np.asarray(kept.query(points[new])[0]) / 2
    close = np.tril(cdist(points[new], points[new]) < near[:, None], -1)
    return np.asarray(new[~close.any(axis=1)])


# -- The hull of a part ---------------------------------------------------------------------------


# Distance between a plane and a vertex on it due to float32, as a share of the largest coordinate:
# both have errors of up to 6e-8 in each of three directions.
NOISE = 2e-7
# Maximum thickness of a flat mesh, as a share of the largest coordinate, and of its longest side.
# A smaller thickness cannot be distinguished from the tolerance within which facets are merged.
FLAT = 1e-6
THIN = 2e-5


# Maximum distance from the origin, in sizes of the part, up to which the noise is assumed to grow.
# Further away, exact coordinates must not be merged; for others there is a warning that they are
# coarse.
MAX_REACH = 50.0
# Maximum difference of the areas of rectangles that count as equal, as a share. All rectangles
# along the sides of an acute or a right triangle have the same area.
SAME_AREA = 1e-5


def convex_hull(vertices: Array, label: str) -> tuple[Array, Faces, Array]:
    """Return the corners of the convex hull, its triangles, and their normals.

    Vertices that are outside a facet or an edge only by the noise of float32 are omitted, so that
    a part has the same corners in every orientation. All vertices are inside the hull up to the
    noise.

    Parameters
    ----------
    vertices : (n, 3) float64
        m, in lexicographic order.

    Returns
    -------
    corners : (k, 3) float64
        m, in lexicographic order, independent of the order in the file.
    triangles : (f, 3) int64
        Rows of ``corners``, unordered.
    normals : (f, 3) float64
        Outward unit normals of the triangles.

    Raises
    ------
    PartError
        If all vertices are in a plane or on a line.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = np.ptp(vertices, axis=0).max()
    scaled = (vertices - middle) / size
    spread = np.linalg.eigh(np.cov(scaled.T))[1]
    extents = np.ptp(scaled @ spread, axis=0)
    reach = min(float(np.abs(vertices).max() / size), MAX_REACH)
    min_extent = max(FLAT * reach, THIN)
    dimensions = np.count_nonzero(extents > min_extent)
    hull = _qhull(scaled, NOISE * reach) if dimensions == 3 else None
    if hull is None:
        raise PartError(
            f'{label} has no volume: all its {len(vertices)} vertices lie '
            f'{"on a line" if dimensions < 2 else "in a plane"}, '
            f'within {min_extent:.1g} of its longest side'
        )
    corners = np.sort(hull.vertices)
    triangles = np.searchsorted(corners, hull.simplices)
    return vertices[corners], triangles, hull.equations[:, :3]


def _qhull(points: Array, noise: float) -> ConvexHull | None:
    """Return the hull with the noise as rounding error of Qhull, or without it if that fails."""
    for options in (f'E{noise:.3e}', ''):
        try:
            return ConvexHull(points, qhull_options=options)
        except QhullError:
            continue
    return None


def outward_hull(hull_vertices: Array) -> tuple[Array, Faces, float]:
    """Return the hull as a closed surface (vertices, outward faces) and its volume, m^3."""
    hull = ConvexHull(hull_vertices)
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(hull_vertices[faces], 1, 0)
    inward = np.einsum('ij,ij->i', np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return hull_vertices, np.where(inward[:, None], faces[:, ::-1], faces), float(hull.volume)


def smallest_rectangle(points: Array) -> tuple[Array, Array]:
    """Return the middle and the sides of the rectangle of minimum area around points of a plane.

    Of several with this area, it is the one with the shortest perimeter, and of these the one
    whose longer side has the smallest angle, from 0 to pi. So it does not depend on rounding.

    Parameters
    ----------
    points : (n, 2) float64
        m, not on a line.

    Returns
    -------
    middle : (2,) float64
        m.
    sides : (2, 2) float64
        The longer and the shorter side as vectors, m.
    """
    corners = points[ConvexHull(points).vertices]
    edges = np.diff(corners, axis=0, append=corners[:1])
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    axes = np.stack([edges, np.column_stack([-edges[:, 1], edges[:, 0]])], axis=1)
    places = axes @ corners.T
    sizes = np.ptp(places, axis=2)
    across = sizes[:, 0] < (1 - SAME_AREA) * sizes[:, 1]
    angles = np.arctan2(*edges.T[::-1]) + np.pi / 2 * across
    keys = np.round(angles % np.pi, 5) % np.round(np.pi, 5)
    for key in (sizes.prod(axis=1), sizes.sum(axis=1)):
        best = key[np.isfinite(keys)].min()
        keys[key > (1 + SAME_AREA) * best] = np.inf
    k = keys.argmin()
    middle = (places[k].min(axis=1) + places[k].max(axis=1)) / 2 @ axes[k]
    sides = sizes[k][:, None] * axes[k]
    return middle, sides[::-1] if across[k] else sides
