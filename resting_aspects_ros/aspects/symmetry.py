"""The rotations that map a part onto itself, found from its surface."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.aspects.surface_match import SURFACE_TOLERANCE, SurfaceMatch
from resting_aspects_ros.part.part import Part

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
        points, weights = _quadrature(triangles[first : first + BATCH])
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


def _quadrature(triangles: Array) -> tuple[Array, Array]:
    """Return points (n, 3) and weights (n,) that integrate degree 6 over triangles.

    They are Gauss points of a square with one side collapsed to a corner. So the moments of a
    surface do not depend on its division into triangles.
    """
    at, share = np.polynomial.legendre.leggauss(4)
    u, v = (side.ravel() for side in np.meshgrid((at + 1) / 2, (at + 1) / 2))
    weight = np.outer(share, share).ravel() * v
    barycentric = np.stack([1 - v, v * (1 - u), v * u], axis=1)
    corners = np.ascontiguousarray(np.moveaxis(triangles, 1, 0))
    a, b, c = corners
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    points = (barycentric @ corners.reshape(3, -1)).reshape(-1, 3)
    return points, np.outer(weight, area).ravel()


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


def _cyclic_order(match: SurfaceMatch, axis: Array, order: Indices) -> int:
    """Return the largest n for which a rotation by 1 / n fits, from its prime powers.

    Or an order whose smallest rotation fits and generates the others, such as that of a nut.
    """
    n = 1
    for prime in range(2, HIGHEST_ORDER + 1):
        if any(prime % smaller == 0 for smaller in range(2, prime)):
            continue
        power = prime
        while power <= HIGHEST_ORDER and _has_order(match, axis, power, order):
            power *= prime
        n *= power // prime
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
