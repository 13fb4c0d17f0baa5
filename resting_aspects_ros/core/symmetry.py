"""The rotations that map a part onto itself, found from its surface.

A part seen by a camera or a chute looks the same after such a rotation, so aspects that one takes
to each other are of one class. Mirror images are left out: no rotation makes one.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotation_group import (
    LARGEST,
    contains,
    dihedral,
    generated,
    half_turns,
    turns,
)
from resting_aspects_ros.core.surface_match import SurfaceMatch

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Second moments of the surface that differ by less, as a share, may be those of a symmetric
# solid: a tessellation moves them by as much.
ALIKE = 0.02
# Orders of rotation that are looked for: a gear may have as many teeth.
HIGHEST_ORDER = 256
# Steps of the azimuth of an axis across, rad; and at least so many from one to the next.
STEP, STEPS = 0.01, 16
# Landmarks are right to 1e-3; so far may angles between them differ, rad.
LANDMARK_ANGLE = 5e-3
# What is nearly a symmetry before it is polished, R.
ROUGH = 0.01
# The same where axes are looked for in all directions, so many on half a sphere. They are within
# 0.03 of any axis, and a half turn about it moves twice as much.
DIRECTIONS, COARSE = 4000, 0.06
# Samples that do to choose candidates, and for products of rotations that all samples confirm.
SAMPLES = 300
# A candidate closer than this, rad, to one that failed is not tried; nor are more than so many.
TRIED, MOST_TRIED = 0.05, 100
# Candidates that are polished at most, in a search.
MOST_POLISHED = 20
# Directions that are tried as the axis of a body of revolution.
MOST_AXES = 12
# Cosine up to which two landmarks make a frame that their errors turn by little.
FAR_FROM_COLLINEAR = 0.99


@dataclass(frozen=True, eq=False)
class Symmetry:
    """The group of the rotations about the centre of mass that map a part onto itself.

    kind : 'finite', 'axial' or 'spherical'
        Axial: all turns about an axis. Spherical: all rotations.
    order : int
        finite: the number of rotations, the identity included; axial: 2 if the part can also be
        turned end for end, else 1; spherical: 1.
    axis : (3,) float or None
        axial: a unit vector, part frame.
    rotations : (order, 3, 3) float
        Matrices, part frame, the identity first. axial: one of each coset of the turns.
    """

    kind: Literal['finite', 'axial', 'spherical']
    order: int
    axis: Array | None
    rotations: Array


def find_symmetry(part: Part, landmarks: Array) -> Symmetry:
    """Find the symmetry of a part's surface about its centre of mass.

    Candidates come from second moments of the surface and from the landmarks; a rotation counts
    if it takes the surface onto itself, both ways, within SYMMETRY_TOLERANCE and what the
    tessellation explains. The inertia plays no part: it may be given, and be another solid's.

    Parameters
    ----------
    part : Part
    landmarks : (k, 3) float
        Unit directions, part frame, which the group permutes, right to 1e-3, as of flat aspects;
        may be empty.
    """
    match = SurfaceMatch(part)
    if not match.strays(None).any():
        return Symmetry('spherical', 1, None, np.eye(3)[None])
    axes, alone = _frame(match.triangles)
    for axis in _directions(axes if alone.any() else np.concatenate([axes, landmarks])):
        if _is_axial(match, axis):
            flip = half_turns(_across(axis)[:1])
            flips = match.fits(flip, match.order)
            rotations = np.concatenate([np.eye(3)[None], flip[flips]])
            return Symmetry('axial', len(rotations), axis, rotations)
    if alone.all():
        rotations = _from(match, half_turns(axes), ROUGH)
    elif alone.any():
        rotations = _about(match, axes[alone][0], axes[~alone])
    else:
        rotations = _polyhedral(match, axes, landmarks)
    return Symmetry('finite', len(rotations), None, rotations)


def _frame(triangles: Array) -> tuple[Array, Flags]:
    """Return axes (3, 3), a row each, and which of them no symmetry but a half turn can move.

    Of three matrices that turn with the surface the one that tells most: two second moments,
    weighted by 1 and by r^4, and the mean of r^2 times the position, times itself.
    """
    points, weights = _quadrature(triangles)
    square = np.einsum('ij,ij->i', points, points)
    moments = [
        np.einsum('i,ij,ik->jk', weights * square**power, points, points) for power in (0, 2)
    ]
    mean = (weights * square) @ points
    moments.append(np.outer(mean, mean) / max(float(np.linalg.norm(mean)), ALIKE**2))
    size = float(np.trace(moments[0]))
    best = np.eye(3), np.zeros(3, dtype=bool)
    for moment in moments:
        values, axes = np.linalg.eigh(moment / max(float(np.trace(moment)), size * ALIKE))
        gaps = np.diff(values) > ALIKE
        alone = np.array([gaps[0], gaps.all(), gaps[1]])
        if not best[1].any() or alone.sum() > best[1].sum():
            best = axes.T, alone
    return best


def _quadrature(triangles: Array) -> tuple[Array, Array]:
    """Return points (n, 3) and weights (n,), of sum 1, that integrate degree 6 over triangles.

    Gauss's points of a square, its one side drawn together to a corner, so that a surface has the
    same moments however it is divided.
    """
    at, share = np.polynomial.legendre.leggauss(4)
    u, v = (side.ravel() for side in np.meshgrid((at + 1) / 2, (at + 1) / 2))
    weight = np.outer(share, share).ravel() * v
    barycentric = np.stack([1 - v, v * (1 - u), v * u], axis=1)
    a, b, c = np.moveaxis(triangles, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    weights = np.outer(area, weight).ravel()
    points = np.einsum('qc,mcj->mqj', barycentric, triangles).reshape(-1, 3)
    return points, weights / weights.sum()


def _directions(vectors: Array) -> Array:
    """Return the first few of vectors that are not along each other."""
    chosen: list[Array] = []
    for vector in vectors:
        if all(np.linalg.norm(np.cross(vector, other)) > STEP for other in chosen):
            chosen.append(vector / np.linalg.norm(vector))
        if len(chosen) == MOST_AXES:
            break
    return np.array(chosen)


def _across(axis: Array) -> Array:
    """Return two unit vectors, (2, 3), at right angles to an axis and to each other."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def _is_axial(match: SurfaceMatch, axis: Array) -> bool:
    some = turns(axis, np.array([0.3, 1.0, 2.2]))
    return bool(match.fits(some, match.order).all()) and not match.strays(axis).any()


def _from(match: SurfaceMatch, candidates: Array, play: float) -> Array:
    """Return the group that those of the candidates generate that fit when they are polished.

    play : float
        By how much the candidates may miss before that, R.
    """
    generators: list[Array] = []
    group = tried = np.eye(3)[None]
    few = match.order[:SAMPLES]
    for candidate in candidates[match.fits(candidates, few, play)]:
        if len(group) == LARGEST or len(tried) > MOST_TRIED:
            break
        if contains(group, candidate) or contains(tried, candidate, TRIED):
            continue
        tried = np.concatenate([tried, candidate[None]])
        polished = match.polished(candidate, match.order)
        both = np.stack([polished, candidate])
        for rotation in both[match.fits(both, match.order)]:
            if contains(group, rotation):
                break
            larger = generated(np.array([*generators, rotation]))
            if larger is not None and match.fits(larger, few).all():
                group = larger
                generators.append(rotation)
                break
    return group


def _about(match: SurfaceMatch, axis: Array, hints: Array) -> Array:
    """Return the group of a part which no rotation gives another axis than this.

    hints : (k, 3) float
        Axes across, to begin with in the search for one that the part can be flipped about.
    """
    order = match.telling(match.strays(axis))
    n = _cyclic_order(match, axis, order)
    return dihedral(axis, n, _flip(match, axis, n, hints, order))


def _cyclic_order(match: SurfaceMatch, axis: Array, order: Indices) -> int:
    """Return the largest n for which a turn by 1 / n fits: the product of its prime powers."""
    n = 1
    for prime in range(2, HIGHEST_ORDER + 1):
        if any(prime % smaller == 0 for smaller in range(2, prime)):
            continue
        power = prime
        while power <= HIGHEST_ORDER and _has_order(match, axis, power, order):
            power *= prime
        n *= power // prime
    return n


def _has_order(match: SurfaceMatch, axis: Array, n: int, order: Indices) -> bool:
    # Not only the smallest turn, which may fit because it moves nothing by much.
    steps = 2 ** np.arange(np.ceil(np.log2(n)))[::-1]
    return all(match.fits(turn[None], order)[0] for turn in turns(axis, 2 * np.pi * steps / n))


def _flip(match: SurfaceMatch, axis: Array, n: int, hints: Array, order: Indices) -> Array | None:
    """Return a half turn about an axis across that fits, (3, 3), if there is one."""
    across = _across(axis)
    count = max(STEPS, int(np.ceil(np.pi / n / STEP)))
    azimuths = np.pi / n * np.arange(count) / count
    axes = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1) @ across
    # An axis is off by half a step at most, and a half turn about it by twice that.
    rough = axes[match.fits(half_turns(axes), order, np.pi / n / count)]
    rough = rough[:: int(np.ceil(len(rough) / MOST_POLISHED)) or 1]
    for candidate in (*hints, *rough):
        polished = match.polished(half_turns(candidate[None])[0], order)
        # Of a half turn about u, R + 1 is 2 u u^T.
        near = (polished + np.eye(3)) @ candidate
        near -= (near @ axis) * axis
        flip = half_turns((near / np.linalg.norm(near))[None])
        if match.fits(flip, order)[0]:
            return np.asarray(flip[0])
    return None


def _polyhedral(match: SurfaceMatch, axes: Array, landmarks: Array) -> Array:
    """Return the group of a part that has no axis of its own, as a cube or an icosahedron."""
    pairs = _pair_rotations(landmarks)
    if len(pairs):
        return _from(match, np.concatenate([half_turns(axes), pairs]), ROUGH)
    return _from(match, _everywhere(), COARSE)


def _pair_rotations(landmarks: Array) -> Array:
    """Return rotations (k, 3, 3) from one pair of landmarks to all with the same angle."""
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
    """Return right-handed frames (k, 3, 3) of pairs of directions, columns, halfway first."""
    x, z = first + second, np.cross(first, second)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _everywhere() -> Array:
    """Return rotations (k, 3, 3) of orders 2 to 5 about axes in all directions, half of them.

    Directions on a Fibonacci spiral.
    """
    z = (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(DIRECTIONS)
    ring = np.sqrt(1 - z**2)
    axes = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    # In any order, so that the first few are spread.
    axes = np.random.default_rng(22).permutation(axes)
    angles = 2 * np.pi / np.array([2.0, 3.0, 4.0, 5.0])
    return np.asarray(
        Rotation.from_rotvec((angles[:, None] * axes[:, None]).reshape(-1, 3)).as_matrix()
    )
