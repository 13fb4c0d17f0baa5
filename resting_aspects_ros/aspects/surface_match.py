"""Test whether a rotation maps the surface of a part onto itself, by distances both ways."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.part.hull import outward_hull
from resting_aspects_ros.part.near import TriangleTree, subdivide
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.tessellation import sagittas

# Maximum difference of the heights at which a part rests before and after a rotation, R and as a
# share of the height, in addition to the effect of the tessellation. It allows for inaccuracies of
# a part that is designed as symmetric, and a difference of 1 % of a length decides on which side a
# part rests.
SYMMETRY_TOLERANCE, HEIGHT_TOLERANCE = 2e-3, 5e-3
# Maximum distance of a rotated surface point from the surface, R. A sixth of the pitch of a
# modelled thread is less than this on standard nuts, and so is an engraving; a pocket, hole or
# boss that a feeder can use is deeper. For a slender or thin part it is less: R is at most this
# multiple of the least height at which the part rests.
SURFACE_TOLERANCE, MAX_SLENDER = 0.03, 4.0
# Triangles are subdivided until their edges are shorter than this, R, up to a maximum number, so
# that samples are evenly distributed and boxes are small.
MAX_EDGE, MAX_PIECES = 0.15, 60_000
# Maximum number of samples at corners of the mesh, and at the middles of pieces and other
# vertices.
MAX_CORNERS, MAX_OTHERS = 1500, 2500
# Maximum number of feet on the hull.
MAX_FEET = 200
# Maximum distance from the hull of a foot on it, R, due to rounding.
ON_HULL = 1e-5
# Number of samples that come first, each as far as possible from those before it.
SPREAD = 200
# Numbers of samples after which failed rotations are rejected; most fail at the first few.
STAGES = (5, 25, 125, 625)
# A side and the one to which it is mapped are within this angle, rad: noise turns each of them by
# up to the 3 degrees within which a pose belongs to an aspect.
SAME_SIDE = np.radians(6.0)
# Number of points that are processed at once, to limit the memory.
BATCH = 200_000
# Combines the indices of a cell, -2000 to 2000, and the direction of a normal, 0 to 4, in one
# number.
_CELL_CODE = np.array([4000**2 * 125, 4000 * 125, 125, 25, 5, 1])
# Sides of cells, R: the finest, the ratio of each step, and the number of steps up to about 3 R.
FINEST, COARSER, LARGEST = 1e-3, 1.4, 24
# Number of random rotations of each sample in the test for continuous symmetry.
TURNS = 3


class SurfaceMatch:
    """The surface of a part about its centre of mass, in units of R, and samples of it.

    The first samples are the feet of the part: the points of its hull that are beneath its centre
    of mass when it rests. Their distances from the centre are the heights at which it rests.
    """

    def __init__(self, part: Part, sides: Array, flats: Array) -> None:
        """Sample the surface at corners, vertices and points inside the triangles.

        ``sides`` (k, 3) and ``flats`` (m, 3) are unit directions, part frame; a symmetry maps each
        side to a flat of the same height.
        """
        vertices = (part.vertices - part.centre_of_mass) / part.hull_radius
        faces = part.faces
        skins, corner = sagittas(vertices, faces)
        twice = _normals(vertices[faces])
        solid = np.linalg.norm(twice, axis=1) > 0
        pieces, whole = subdivide(
            vertices[faces][solid], MAX_EDGE, max(MAX_PIECES, 2 * len(faces))
        )
        whole = np.flatnonzero(solid)[whole]
        self.triangles = vertices[faces][solid]
        self._tree = TriangleTree(pieces, skins[whole])
        twice = _normals(pieces)
        self._normals = twice / np.maximum(np.linalg.norm(twice, axis=1), 1e-300)[:, None]
        at_vertex = np.zeros(len(vertices))
        np.maximum.at(at_vertex, faces.ravel(), np.repeat(skins, 3))
        sharp, other = np.flatnonzero(corner), np.flatnonzero(~corner)
        sharp = sharp[_thinned(vertices[sharp], np.zeros((len(sharp), 3)), MAX_CORNERS)]
        points = np.concatenate([vertices[other], pieces.mean(axis=1)])
        normals = np.concatenate([np.zeros((len(other), 3)), self._normals])
        few = _thinned(points, normals, MAX_OTHERS)
        points = np.concatenate([vertices[sharp], points[few]])
        skins = np.concatenate(
            [at_vertex[sharp], np.concatenate([at_vertex[other], skins[whole]])[few]]
        )
        order = _spread_first(points)
        feet, depth = self._feet(part)
        self._points = np.concatenate([feet, points[order]])
        self._skins = np.concatenate([depth, skins[order]])
        self.order = np.arange(len(self._points))
        self._is_foot = self.order < len(feet)
        height = np.linalg.norm(feet, axis=1)
        # Feet of needles are exact within the rounding of the hull.
        self._tight = np.clip(HEIGHT_TOLERANCE * height, ON_HULL, SYMMETRY_TOLERANCE)
        # A simplified hull can err in both positions.
        self._tight += 2 * part.hull_error / part.hull_radius
        self._unit = min(1.0, MAX_SLENDER * float(height.min(initial=1.0)))
        self._sides, self._flats = sides, flats
        hull = (part.hull_vertices - part.centre_of_mass) / part.hull_radius
        self._heights = [(hull @ each.T).max(axis=0) for each in (sides, flats)]

    def _feet(self, part: Part) -> tuple[Array, Array]:
        """Set the tree of the hull; return the feet (k, 3) and their skins (k,), R."""
        corners, faces, _ = outward_hull(part.hull_vertices)
        corners = (corners - part.centre_of_mass) / part.hull_radius
        skins = sagittas(corners, faces)[0]
        triangles = corners[faces]
        twice = _normals(triangles)
        solid = np.linalg.norm(twice, axis=1) > 0
        triangles, skins, normals = triangles[solid], skins[solid], twice[solid]
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        self._hull = TriangleTree(triangles, skins)
        feet = np.einsum('ij,ij->i', normals, triangles[:, 0])[:, None] * normals
        # Skins are not used here, because a foot outside the hull is not one.
        bare = TriangleTree(triangles, np.zeros(len(triangles)))
        reach, none = np.full(len(feet), ON_HULL), np.zeros(len(feet))
        touching = np.flatnonzero(bare.near(feet, reach, none))
        few = touching[_thinned(feet[touching], normals[touching], MAX_FEET)]
        return feet[few], skins[few]

    def deviating(self, axis: Array | None) -> Flags:
        """Return which samples leave the surface after rotations about an axis (unit vector).

        Each sample is rotated by its own random angles, so that no finite order of rotation is
        mistaken for a continuous symmetry. Without an axis, the rotations are about random axes.
        """
        generator = np.random.default_rng(20)  # any angles are suitable; these are reproducible
        deviating = np.zeros(len(self._points), dtype=bool)
        for _ in range(TURNS):
            if axis is None:
                turns = Rotation.from_quat(generator.standard_normal((len(deviating), 4)))
            else:
                angles = generator.uniform(0, 2 * np.pi, len(deviating))
                turns = Rotation.from_rotvec(angles[:, None] * axis)
            moved = turns.apply(self._points)
            deviating |= ~self._near(moved, self.order, 0.0, SURFACE_TOLERANCE)
        return deviating

    def fits(
        self,
        rotations: Array,
        order: Indices,
        play: float = 0.0,
        reach: float = SURFACE_TOLERANCE,
    ) -> Flags:
        """Return which rotations, (k, 3, 3), and their inverses map the part onto itself.

        They map its feet onto its hull within the tolerance of heights + ``play``, R, and its
        surface onto itself within ``reach``, R, less for a slender part, or within ``play`` if
        that is more. Without ``play``, they map each side to a flat of the same height. ``order``
        is the order of the samples.
        """
        left = np.arange(len(rotations))
        if play == 0:
            left = left[self._permute(rotations)]
        bounds = [0, *(s for s in STAGES if s < len(order)), len(order)]
        for start, stop in pairwise(bounds):
            some = order[start:stop]
            block = max(1, BATCH // (2 * len(some)))
            parts = [left[i : i + block] for i in range(0, len(left), block)]
            held = [part[self._hold(rotations[part], some, play, reach)] for part in parts]
            left = np.concatenate(held) if held else left
        fits = np.zeros(len(rotations), dtype=bool)
        fits[left] = True
        return fits

    def _permute(self, rotations: Array) -> Flags:
        """Return which rotations, (k, 3, 3), map each side to a flat of the same height."""
        side, flat = self._heights
        alike = np.abs(side[:, None] - flat) <= HEIGHT_TOLERANCE * side[:, None]
        # One rotation at a time, which limits the memory.
        near = (self._sides @ r.T @ self._flats.T >= np.cos(SAME_SIDE) for r in rotations)
        return np.array([bool((each & alike).any(axis=1).all()) for each in near], dtype=bool)

    def refined(self, rotation: Array, order: Indices) -> Array:
        """Return the rotation that fits best, starting from one that nearly fits.

        It minimizes the squared distances to the planes of the nearest triangles (Chen and Medioni
        1992), in several iterations with decreasing reach.
        """
        points = self._points[order[~self._is_foot[order]][: 2 * SPREAD]]
        for reach in (0.04, 0.02, 0.01, 0.01):
            moved = points @ rotation.T
            index, piece, way = self._tree.nearest(moved, reach)
            normals = self._normals[piece]
            lever = np.cross(moved[index], normals)
            off = np.einsum('ij,ij->i', way, normals)
            turn = np.linalg.lstsq(lever, off, rcond=1e-3)[0]
            rotation = Rotation.from_rotvec(turn).as_matrix() @ rotation
        return rotation

    def _hold(self, rotations: Array, some: Indices, play: float, reach: float) -> Flags:
        there = np.einsum('kij,pj->kpi', rotations, self._points[some])
        back = np.einsum('kji,pj->kpi', rotations, self._points[some])
        points = np.concatenate([there, back], axis=1)
        samples = np.tile(some, 2 * len(rotations))
        near = self._near(points.reshape(-1, 3), samples, play, reach)
        return np.asarray(near.reshape(len(rotations), -1).all(axis=1))

    def _near(self, points: Array, samples: Indices, play: float, reach: float) -> Flags:
        """Return which points (n, 3), where rotated samples (n,) are, are near the part."""
        near = np.zeros(len(points), dtype=bool)
        foot, skins = self._is_foot[samples], self._skins[samples]
        tight = self._tight[samples[foot]] + play
        near[foot] = self._hull.near(points[foot], tight, skins[foot])
        loose = np.full(int((~foot).sum()), max(reach * self._unit, play))
        near[~foot] = self._tree.near(points[~foot], loose, skins[~foot])
        return near


def _normals(triangles: Array) -> Array:
    """Return the normals of triangles; their lengths are twice the areas."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a)


def _thinned(points: Array, normals: Array, max_points: int) -> Indices:
    """Return at most ``max_points`` points, one for each cell and direction of the normal.

    So the walls of a small pocket in a large face keep their samples.
    """

    def chosen(step: int) -> Indices:
        cells = np.floor(points / (FINEST * COARSER**step)).astype(np.int64)
        code = np.column_stack([cells, direction]) @ _CELL_CODE
        return np.sort(np.unique(code, return_index=True)[1])

    direction = (np.round(1.5 * normals) + 2).astype(np.int64)
    if len(points) <= max_points:
        return np.arange(len(points))
    # Search for the finest cells that are few enough; larger cells are fewer.
    low, high = -1, LARGEST
    best = chosen(high)
    while high - low > 1:
        step = (low + high) // 2
        found = chosen(step)
        if len(found) <= max_points:
            high, best = step, found
        else:
            low = step
    return best


def _spread_first(points: Array) -> Indices:
    """Return the order of points in which each of the first is far from those before it."""
    apart = np.linalg.norm(points, axis=1)
    first: list[int] = []
    for count in range(min(SPREAD, len(points))):
        first.append(int(apart.argmax()))
        distance = np.linalg.norm(points - points[first[-1]], axis=1)
        apart = np.minimum(apart, distance) if count else distance
    rest = np.setdiff1d(np.arange(len(points)), first)
    # Permuted, so that each stage is a representative sample.
    scattered = np.random.default_rng(21).permutation(rest)
    return np.concatenate([np.array(first, dtype=np.int64), scattered])
