"""The rotations that map a part onto itself, found from its surface.

Such a rotation does not change how a part appears to a camera or a chute, so the aspects that it
maps to each other form one class. Reflections are excluded, because a part cannot be reflected.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.geometry.rotation_group import (
    LARGEST,
    contains,
    dihedral,
    generated,
    half_turns,
    pair_rotations,
    sample_rotations,
    surface_frame,
    turns,
)
from resting_aspects_ros.core.geometry.surface_match import SURFACE_TOLERANCE, SurfaceMatch
from resting_aspects_ros.core.part import Part

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

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
