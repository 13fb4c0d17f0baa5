"""The rotations that map a part onto itself, tested by distances of its surface both ways.

Whether surfaces match and which rotations do so are one thought, of more than 600 lines.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.part.hull import outward_hull
from resting_aspects_ros.part.mass import surface_points
from resting_aspects_ros.part.near import TriangleTree, face_normals, subdivide
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.tessellation import sagittas

# -- Matched surfaces -----------------------------------------------------------------------------


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
POINT_BATCH = 200_000
# Combines the indices of a cell, -2000 to 2000, and the direction of a normal, 0 to 4, in one
# number.
_CELL_CODE = np.array([4000**2 * 125, 4000 * 125, 125, 25, 5, 1])
# Sides of cells, R: the finest, the ratio of each step, and the number of steps up to about 3 R.
FINEST, COARSER, CELL_STEPS = 1e-3, 1.4, 24
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
        twice = face_normals(vertices[faces])
        solid = np.linalg.norm(twice, axis=1) > 0
        pieces, whole = subdivide(
            vertices[faces][solid], MAX_EDGE, max(MAX_PIECES, 2 * len(faces))
        )
        whole = np.flatnonzero(solid)[whole]
        self.triangles = vertices[faces][solid]
        self._tree = TriangleTree(pieces, skins[whole])
        twice = face_normals(pieces)
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
        twice = face_normals(triangles)
        solid = np.linalg.norm(twice, axis=1) > 0
        triangles, skins, normals = triangles[solid], skins[solid], twice[solid]
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        self._hull = TriangleTree(triangles, skins)
        feet = np.einsum('ij,ij->i', normals, triangles[:, 0])[:, None] * normals
        # Skins are not used here, because a foot outside the hull is not one.
        bare = TriangleTree(triangles)
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
            block = max(1, POINT_BATCH // (2 * len(some)))
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
    low, high = -1, CELL_STEPS
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


# -- Rotation groups ------------------------------------------------------------------------------


# Second moments of the surface that differ by less, as a share, may be equal: the tessellation of
# a symmetric solid changes them by this much.
ALIKE = 0.02
# Number of triangles at a time, whose arrays fit into the cache of a processor.
BATCH = 1_000
# Maximum difference of equal angles between landmarks, rad; landmarks have errors of 1e-3.
LANDMARK_ANGLE = 5e-3
# Maximum cosine between two landmarks, so that their errors rotate their frame only slightly.
FAR_FROM_COLLINEAR = 0.99
# Number of directions on a hemisphere: every axis is within 0.03 of one, and the error of a half
# turn is twice that.
DIRECTIONS = 4000
# Rotations of a group that differ by less, rad, are equal. It is more than the error of rotations
# that are found on a mesh, and less than the steps of any polyhedral group.
SAME = 0.1
# The largest group that is neither cyclic nor dihedral: the icosahedron's.
LARGEST = 60


def surface_frame(triangles: Array) -> tuple[Array, Flags]:
    """Return axes (3, 3), one per row, and which of them only a half turn can move.

    They are those of the most significant of three matrices that rotate with the surface: two
    second moments, weighted by 1 and by r^4, and the outer product of the mean of r^2 times the
    position.
    """
    area, second, sixth, mean = 0.0, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for first in range(0, len(triangles), BATCH):
        # Exact, so that the moments do not depend on the division of a surface into triangles.
        points, weights, areas = surface_points(triangles[first : first + BATCH], 4)
        points, weights = points.T, np.outer(weights, areas).ravel()
        square = np.einsum('ij,ij->i', points, points)
        area += float(weights.sum())
        second += (weights[:, None] * points).T @ points
        sixth += ((weights * square**2)[:, None] * points).T @ points
        mean += (weights * square) @ points
    moments = [second / area, sixth / area]
    mean /= area
    moments.append(np.outer(mean, mean) / max(float(np.linalg.norm(mean)), ALIKE**2))
    size = float(np.trace(moments[0]))
    found = []
    for moment in moments:
        values, axes = np.linalg.eigh(moment / max(float(np.trace(moment)), size * ALIKE))
        gaps = np.diff(values) > ALIKE
        alone = np.array([gaps[0], gaps.all(), gaps[1]])
        found.append((axes.T, alone))
    return max(found, key=lambda each: each[1].sum())


def pair_rotations(landmarks: Array) -> Array:
    """Return rotations (k, 3, 3) from one pair of landmarks to all pairs with the same angle."""
    cosines = np.clip(landmarks @ landmarks.T, -1, 1)
    angles = np.arccos(cosines)
    first, second = np.nonzero(np.abs(cosines) < FAR_FROM_COLLINEAR)
    if not len(first):
        return np.zeros((0, 3, 3))
    of_pairs = angles[first, second]
    ranked = np.sort(of_pairs)
    alike = np.searchsorted(ranked, of_pairs + LANDMARK_ANGLE)
    alike -= np.searchsorted(ranked, of_pairs - LANDMARK_ANGLE)
    rare = np.abs(of_pairs - of_pairs[alike.argmin()]) <= LANDMARK_ANGLE
    frames = _frames(landmarks[first[rare]], landmarks[second[rare]])
    return np.asarray(frames @ frames[0].T)


def _frames(first: Array, second: Array) -> Array:
    """Return right-handed frames (k, 3, 3) of pairs of directions; the first axis is halfway."""
    x, z = first + second, np.cross(first, second)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def sample_rotations() -> Array:
    """Return rotations (k, 3, 3) of orders 2 to 5 about axes on a hemisphere.

    The axes are on a Fibonacci spiral.
    """
    z = (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(DIRECTIONS)
    ring = np.sqrt(1 - z**2)
    axes = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    # Permuted, so that the first few are evenly distributed.
    axes = np.random.default_rng(22).permutation(axes)
    angles = 2 * np.pi / np.array([2.0, 3.0, 4.0, 5.0])
    return np.asarray(
        Rotation.from_rotvec((angles[:, None] * axes[:, None]).reshape(-1, 3)).as_matrix()
    )


def turns(axis: Array, angles: Array) -> Array:
    """Return rotations (k, 3, 3) about a unit vector (3,) by angles (k,), rad."""
    return np.asarray(Rotation.from_rotvec(np.asarray(angles)[:, None] * axis).as_matrix())


def half_turns(axes: Array) -> Array:
    """Return half turns (k, 3, 3) about unit vectors (k, 3)."""
    return 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)


def dihedral(axis: Array, order: int, flip: Array | None) -> Array:
    """Return the cyclic group about an axis, (n, 3, 3), or with a flip (3, 3) the dihedral one."""
    cyclic = turns(axis, 2 * np.pi * np.arange(order) / order)
    cyclic[0] = np.eye(3)
    return cyclic if flip is None else np.concatenate([cyclic, cyclic @ flip])


def contains(group: Array, rotation: Array, within: float = SAME) -> bool:
    """Return whether a rotation is in a group, up to errors, rad."""
    return bool(_angles(group, rotation).min() < within)


def generated(generators: Array) -> Array | None:
    """Return the group (n, 3, 3) that rotations generate, identity first.

    They may have small errors. None if they do not generate a finite group, or if it is larger
    than that of the icosahedron: then one of them is not a symmetry of the solid.
    """
    group = [np.eye(3)]
    for element in group:
        for generator in generators:
            product = element @ generator
            if not contains(np.array(group), product):
                if len(group) == LARGEST:
                    return None
                group.append(product)
    return _closed(np.array(group))


def _closed(group: Array) -> Array | None:
    """Return the group without errors; None if it is not closed.

    Each element is replaced by the mean of g_k g_j^-1 over all pairs whose product is the element.
    A fixed point is closed up to rounding, and each iteration squares the error.
    """
    for _ in range(4):
        products = group[:, None] @ group.transpose(0, 2, 1)
        flat = products.reshape(-1, 3, 3)
        likeness = flat.reshape(-1, 9) @ group.reshape(-1, 9).T
        element = likeness.argmax(axis=1)
        apart = np.linalg.norm(flat - group[element], axis=(1, 2)) / np.sqrt(2)
        if apart.max() > SAME or (np.bincount(element) != len(group)).any():
            return None
        sums = np.zeros_like(group)
        np.add.at(sums, element, flat)
        u, _, v = np.linalg.svd(sums)
        group = u @ v
    group[0] = np.eye(3)
    return group


def _angles(group: Array, rotation: Array) -> Array:
    """Return the angles (n,) of the elements to a rotation, rad, as chords, for small angles."""
    return np.asarray(np.linalg.norm(group - rotation, axis=(1, 2)) / np.sqrt(2))


# -- Symmetry -------------------------------------------------------------------------------------


# Maximum order of rotation: a gear may have this number of teeth.
HIGHEST_ORDER = 256
# Steps of the azimuth of a perpendicular axis, rad, and their minimum number between two axes.
STEP, MIN_STEPS = 0.01, 16
# Maximum distance of a rotated surface point from the surface, R, for products of symmetries, and
# the highest order of a rotation about an axis that is found as such a product.
PRODUCT_TOLERANCE, HIGHEST_PRODUCT = 2 * SURFACE_TOLERANCE, 12
# Maximum deviation of a candidate before its refinement, R.
ROUGH = 0.01
# The same for candidates from a search over all rotations, R.
ROUGH_ANYWHERE = 0.06
# Number of samples that select candidates and check products of confirmed rotations.
SAMPLES = 300
# Candidates closer than this, rad, to a failed one are skipped; the second number is the maximum
# number of attempts.
TRIED, MAX_TRIED = 0.05, 100
# Number of rotations that determine whether nearly all rotations fit roughly.
FEW_ANYWHERE = 60
# Maximum number of candidates that are refined in a search.
MAX_REFINED = 20
# Maximum number of directions that are tried as the axis of a body of revolution.
MAX_AXES = 12


@dataclass(frozen=True, eq=False)
class Symmetry:
    """The group of the rotations about the centre of mass that map a part onto itself.

    kind : 'finite', 'axial' or 'spherical'
        Axial: all rotations about an axis. Spherical: all rotations.
    order : int
        finite: the number of rotations including the identity; axial: 2 if the part can also be
        turned end over end, else 1; spherical: 1.
    axis : (3,) float or None
        axial: a unit vector, part frame.
    rotations : (order, 3, 3) float
        Matrices, part frame, the identity first; axial: one of each coset of the rotations about
        the axis.
    """

    kind: Literal['finite', 'axial', 'spherical']
    order: int
    axis: Array | None
    rotations: Array


def find_symmetry(part: Part, landmarks: Array, flats: Array | None = None) -> Symmetry:
    """Return the symmetry of the surface of a part about its centre of mass.

    Candidates come from second moments of the surface and from the landmarks. A rotation is a
    symmetry if it and its inverse keep the heights at which the part rests, within 0.2 % of R and
    0.5 % of the height, and map the surface onto itself, within SURFACE_TOLERANCE, both plus the
    effect of the tessellation, and if it maps each landmark to a flat of the same height. A
    product of such rotations may deviate twice as much from the surface: of a thread, a turn by a
    sixth moves it by p / 6, a half turn by p / 2. The inertia is not used, because it may be given
    by the user.

    Parameters
    ----------
    part : Part
    landmarks : (k, 3) float
        Unit directions, part frame, of the flat sides on which the part rests, with errors up to
        1e-3; there may be none.
    flats : (m, 3) float, optional
        The directions of all flats of which these sides consist; by default the landmarks.
    """
    match = SurfaceMatch(part, landmarks, landmarks if flats is None else flats)
    if not len(landmarks) and not match.deviating(None).any():
        return Symmetry('spherical', 1, None, np.eye(3)[None])
    axes, alone = surface_frame(match.triangles)
    for axis in _directions(axes if alone.any() else np.concatenate([axes, landmarks])):
        if _is_axial(match, axis):
            return _axial(match, axis)
    if alone.all():
        rotations = _from(match, half_turns(axes), ROUGH)
    elif alone.any():
        axis = axes[alone][0]
        order = np.argsort(~match.deviating(axis), kind='stable')  # the most significant first
        n = _cyclic_order(match, axis, order)
        if n > HIGHEST_ORDER:
            # Some samples deviate at some angle, but no finite order is found.
            return _axial(match, axis)
        rotations = dihedral(axis, n, _flip(match, axis, n, axes[~alone], order))
    else:
        rotations = _polyhedral(match, axes, landmarks)
    return Symmetry('finite', len(rotations), None, rotations)


def _directions(vectors: Array) -> Array:
    """Return the first MAX_AXES vectors that are not parallel, as unit vectors."""
    chosen: list[Array] = []
    for vector in vectors:
        if all(np.linalg.norm(np.cross(vector, other)) > STEP for other in chosen):
            chosen.append(vector / np.linalg.norm(vector))
        if len(chosen) == MAX_AXES:
            break
    return np.array(chosen)


def _across(axis: Array) -> Array:
    """Return two unit vectors, (2, 3), perpendicular to an axis and to each other."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def _is_axial(match: SurfaceMatch, axis: Array) -> bool:
    some = turns(axis, np.array([0.3, 1.0, 2.2]))
    return bool(match.fits(some, match.order).all()) and not match.deviating(axis).any()


def _axial(match: SurfaceMatch, axis: Array) -> Symmetry:
    flip = half_turns(_across(axis)[:1])
    rotations = np.concatenate([np.eye(3)[None], flip[match.fits(flip, match.order)]])
    return Symmetry('axial', len(rotations), axis, rotations)


def _from(match: SurfaceMatch, candidates: Array, play: float) -> Array:
    """Return the group generated by the candidates that fit after their refinement.

    Before the refinement they may deviate by ``play``, R.
    """
    generators: list[Array] = []
    group = tried = np.eye(3)[None]
    few = match.order[:SAMPLES]
    for candidate in candidates[match.fits(candidates, few, play)]:
        if len(group) == LARGEST or len(tried) > MAX_TRIED:
            break
        if contains(group, candidate) or contains(tried, candidate, TRIED):
            continue
        tried = np.concatenate([tried, candidate[None]])
        refined = match.refined(candidate, match.order)
        both = np.stack([refined, candidate])
        for rotation in both[match.fits(both, match.order)]:
            if contains(group, rotation):
                break
            larger = generated(np.array([*generators, rotation]))
            if larger is not None and match.fits(larger, few, reach=PRODUCT_TOLERANCE).all():
                group = larger
                generators.append(rotation)
                break
    return group


def cyclic_order(has_order: Callable[[int], bool]) -> int:
    """Return the largest n for which a rotation by 1 / n fits, from its prime powers.

    Above HIGHEST_ORDER, no orders are distinguished.
    """
    n = 1
    for prime in range(2, HIGHEST_ORDER + 1):
        if any(prime % smaller == 0 for smaller in range(2, prime)):
            continue
        power = prime
        while power <= HIGHEST_ORDER and has_order(power):
            power *= prime
        n *= power // prime
        if n > HIGHEST_ORDER:
            break
    return n


def _cyclic_order(match: SurfaceMatch, axis: Array, order: Indices) -> int:
    """Return the cyclic order about an axis.

    Or an order whose smallest rotation fits and generates the others, such as that of a nut.
    """
    n = cyclic_order(lambda power: _has_order(match, axis, power, order))
    for multiple in range(HIGHEST_PRODUCT, n, -1):
        if multiple % n == 0 and _generates(match, axis, multiple, order):
            return multiple
    return n


def _generates(match: SurfaceMatch, axis: Array, n: int, order: Indices) -> bool:
    """Return whether a rotation by 1 / n fits, and its powers as products of it."""
    powers = turns(axis, 2 * np.pi * np.arange(1, n) / n)
    return bool(
        match.fits(powers[:1], order)[0]
        and match.fits(powers, order, reach=PRODUCT_TOLERANCE).all()
    )


def _has_order(match: SurfaceMatch, axis: Array, n: int, order: Indices) -> bool:
    # Not only the smallest rotation, which may fit because it hardly moves the surface.
    steps = 2 ** np.arange(np.ceil(np.log2(n)))
    rotations = turns(axis, 2 * np.pi * steps / n)
    # First with few samples, because any of the rotations may fail.
    return all(match.fits(rotations, some).all() for some in (order[:SAMPLES], order))


def _flip(match: SurfaceMatch, axis: Array, n: int, hints: Array, order: Indices) -> Array | None:
    """Return a half turn about a perpendicular axis that fits, if any; hints are tried first."""
    across = _across(axis)
    count = max(MIN_STEPS, int(np.ceil(np.pi / n / STEP)))
    azimuths = np.pi / n * np.arange(count) / count
    axes = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1) @ across
    # The error of an axis is at most half a step, that of a half turn about it twice that.
    rough = axes[match.fits(half_turns(axes), order[:SAMPLES], np.pi / n / count)]
    rough = rough[:: int(np.ceil(len(rough) / MAX_REFINED)) or 1]
    for candidate in (*hints, *rough):
        refined = match.refined(half_turns(candidate[None])[0], order)
        # For a half turn R about u, R + 1 is 2 u u^T.
        near = (refined + np.eye(3)) @ candidate
        near -= (near @ axis) * axis
        flip = half_turns((near / np.linalg.norm(near))[None])
        if match.fits(flip, order)[0]:
            return np.asarray(flip[0])
    return None


def _polyhedral(match: SurfaceMatch, axes: Array, landmarks: Array) -> Array:
    """Return the group of a part without a unique axis, such as a cube or an icosahedron."""
    pairs = pair_rotations(landmarks)
    if len(pairs):
        return _from(match, np.concatenate([half_turns(axes), pairs]), ROUGH)
    candidates = sample_rotations()
    some = candidates[:: len(candidates) // FEW_ANYWHERE]
    if match.fits(some, match.order[:SAMPLES], ROUGH_ANYWHERE).mean() > 0.5:
        # Nearly a ball: all rotations fit roughly, and checking them would take minutes.
        return _from(match, half_turns(axes), ROUGH)
    return _from(match, candidates, ROUGH_ANYWHERE)
