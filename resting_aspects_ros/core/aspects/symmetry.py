"""The rotations that map a part onto itself, found from its surface.

A part seen by a camera or a chute looks the same after such a rotation, so aspects that one takes
to each other are of one class. Mirror images are left out: no rotation makes one.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.geometry.rotation_group import (
    LARGEST,
    contains,
    dihedral,
    everywhere,
    generated,
    half_turns,
    pair_rotations,
    surface_frame,
    turns,
)
from resting_aspects_ros.core.geometry.surface_match import SurfaceMatch
from resting_aspects_ros.core.part import Part

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Orders of rotation that are looked for: a gear may have as many teeth.
HIGHEST_ORDER = 256
# Steps of the azimuth of an axis across, rad; and at least so many from one to the next.
STEP, STEPS = 0.01, 16
# What is nearly a symmetry before it is polished, R.
ROUGH = 0.01
# The same of rotations that are looked for everywhere, R.
ROUGH_ANYWHERE = 0.06
# Samples that do to choose candidates, and for products of rotations that all samples confirm.
SAMPLES = 300
# A candidate closer than this, rad, to one that failed is not tried; nor are more than so many.
TRIED, MAX_TRIED = 0.05, 100
# So many of them tell whether nearly all rotations fit roughly.
FEW_ANYWHERE = 60
# Candidates that are polished at most, in a search.
MAX_POLISHED = 20
# Directions that are tried as the axis of a body of revolution.
MAX_AXES = 12


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
    axes, alone = surface_frame(match.triangles)
    for axis in _directions(axes if alone.any() else np.concatenate([axes, landmarks])):
        if _is_axial(match, axis):
            return _axial(match, axis)
    if alone.all():
        rotations = _from(match, half_turns(axes), ROUGH)
    elif alone.any():
        axis = axes[alone][0]
        order = np.argsort(~match.strays(axis), kind='stable')  # those that tell most come first
        n = _cyclic_order(match, axis, order)
        if n > HIGHEST_ORDER:
            # Some sample strays at some angle, but no turn to speak of shows.
            return _axial(match, axis)
        rotations = dihedral(axis, n, _flip(match, axis, n, axes[~alone], order))
    else:
        rotations = _polyhedral(match, axes, landmarks)
    return Symmetry('finite', len(rotations), None, rotations)


def _directions(vectors: Array) -> Array:
    """Return the first few of vectors that are not along each other."""
    chosen: list[Array] = []
    for vector in vectors:
        if all(np.linalg.norm(np.cross(vector, other)) > STEP for other in chosen):
            chosen.append(vector / np.linalg.norm(vector))
        if len(chosen) == MAX_AXES:
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


def _axial(match: SurfaceMatch, axis: Array) -> Symmetry:
    flip = half_turns(_across(axis)[:1])
    rotations = np.concatenate([np.eye(3)[None], flip[match.fits(flip, match.order)]])
    return Symmetry('axial', len(rotations), axis, rotations)


def _from(match: SurfaceMatch, candidates: Array, play: float) -> Array:
    """Return the group that those of the candidates generate that fit when they are polished.

    Before that they may miss by the play, R.
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
    """Return a half turn about an axis across, of the hints first, that fits, if there is one."""
    across = _across(axis)
    count = max(STEPS, int(np.ceil(np.pi / n / STEP)))
    azimuths = np.pi / n * np.arange(count) / count
    axes = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1) @ across
    # An axis is off by half a step at most, and a half turn about it by twice that.
    rough = axes[match.fits(half_turns(axes), order[:SAMPLES], np.pi / n / count)]
    rough = rough[:: int(np.ceil(len(rough) / MAX_POLISHED)) or 1]
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
    pairs = pair_rotations(landmarks)
    if len(pairs):
        return _from(match, np.concatenate([half_turns(axes), pairs]), ROUGH)
    candidates = everywhere()
    some = candidates[:: len(candidates) // FEW_ANYWHERE]
    if match.fits(some, match.order[:SAMPLES], ROUGH_ANYWHERE).mean() > 0.5:
        # Nearly a ball: all fits roughly, and to tell them apart would take minutes.
        return np.eye(3)[None]
    return _from(match, candidates, ROUGH_ANYWHERE)
