"""Alignment of outlines over yaw, and which outlines of a part look alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import minimize
from shapely import affinity

from resting_aspects_ros.core.vision.boundary import RAYS, Boundary, boundary_of, turn

if TYPE_CHECKING:  # outline.py uses this module
    from resting_aspects_ros.core.vision.outline import Outline

Array = npt.NDArray[np.float64]
# Yaw, rad, and shift (2,) of the centroid of a model relative to that of the seen outline, m.
Pose = tuple[float, Array]

# Maximum number of solutions of an alignment.
MAX_SOLUTIONS = 12
# Solutions with an overlap below the best one by more than this are not returned.
MAX_LOSS = 0.03
# Solutions closer than this, rad, are the same one.
SAME_YAW = 0.02
# Iterations of the refinement, and about how many points of the boundary it uses.
ITERATIONS, REFINED = 5, 100
# Yaws whose signatures match worse than the best by more than this share are not refined.
MAX_WORSE = 0.05
# Outlines with less overlap differ. Then it is maximized from the best TRIES of so many yaws, in
# steps of START (rad, and radii); of overlaps that are equal within EQUAL, the closest boundaries
# count.
ALIKE, YAWS, TRIES, START, EQUAL = 0.9, 36, 8, 0.1, 2e-3
# Differences between signatures below this are those of a round outline.
ROUND = 1e-6


@dataclass(frozen=True)
class Alignment:
    """The rotation and translation that bring a model outline onto a seen one.

    yaw : float
        rad, counter-clockwise, about the origin of the model; from -pi to pi.
    x, y : float
        Translation after the rotation, m: seen = R(yaw) model + (x, y).
    overlap : float
        Intersection over union.
    distance : float
        Symmetric Hausdorff distance of the boundaries, with their holes, m.
    """

    yaw: float
    x: float
    y: float
    overlap: float
    distance: float


@dataclass(frozen=True)
class LookAlike:
    """How well the outline of another symmetry class resembles an outline.

    symmetry_class : int
        The other class.
    overlap : float
        Maximum intersection over union over yaw and position.
    verdict : 'same', 'mirrored' or 'distinct'
        same: equal within SAME. mirrored: the mirror image is equal, but the outline is not.
    resolution : float
        Symmetric Hausdorff distance after the best alignment, m: a camera that does not resolve
        it cannot distinguish the outlines.
    """

    symmetry_class: int
    overlap: float
    verdict: Literal['same', 'mirrored', 'distinct']
    resolution: float


def align(model: shapely.Polygon, seen: shapely.Polygon) -> tuple[Alignment, ...]:
    """Return the alignments of a model outline with a seen one, the largest overlap first.

    Other solutions follow if their overlap is smaller by at most MAX_LOSS, such as those of a
    symmetric outline, up to MAX_SOLUTIONS; a round outline may have one. The yaws come from
    signatures about the centroids and are refined by the distances of the boundaries. Outlines
    that differ may overlap more at another yaw; see look_alikes.
    """
    one, other = boundary_of(model), boundary_of(seen)
    poses = _refined(one, other, _candidates(one, other))
    # Outlines that differ may overlap more if only their centroids coincide.
    poses += [(yaw, np.zeros(2)) for yaw in _candidates(one, other)[:1]]
    ranked = sorted(((_overlap(model, seen, *pose), pose) for pose in poses), key=lambda a: -a[0])
    found: list[Alignment] = []
    for overlap, (yaw, shift) in ranked:
        if overlap >= ranked[0][0] - MAX_LOSS and not any(
            abs(np.angle(np.exp(1j * (yaw - a.yaw)))) < SAME_YAW for a in found
        ):
            found.append(_alignment(one, other, yaw, shift, overlap))
    return tuple(found)


def same_outline(model: shapely.Polygon, seen: shapely.Polygon, play: float = 0.0) -> bool:
    """Return whether two outlines are equal after some rotation and translation.

    Their boundaries are closer than SAME times the larger radius about the centroid, in addition
    to the effect of the tessellation and to ``play``, m.
    """
    one, other = boundary_of(model), boundary_of(seen)
    poses = _refined(one, other, _candidates(one, other))
    return any(one.equals(other, *pose, play) for pose in poses)


def look_alikes(outlines: Sequence['Outline']) -> dict[int, tuple[LookAlike, ...]]:
    """Return, by symmetry class, how well each other class resembles it, best overlap first.

    Of a class whose outline changes while the part rolls or rocks, the most similar one counts.
    """
    found: dict[int, list[LookAlike]] = {outline.symmetry_class: [] for outline in outlines}
    for one, other in combinations(outlines, 2):
        pairs = list(product((one.polygon, *one.family), (other.polygon, *other.family)))
        best = max((_most_alike(a, b) for a, b in pairs), key=lambda a: a.overlap)
        verdict: Literal['same', 'mirrored', 'distinct'] = 'distinct'
        if any(same_outline(a, b) for a, b in pairs):
            verdict = 'same'
        elif any(same_outline(mirrored(a), b) for a, b in pairs):
            verdict = 'mirrored'
        for a, b in ((one, other), (other, one)):
            found[a.symmetry_class].append(
                LookAlike(b.symmetry_class, best.overlap, verdict, best.distance)
            )
    return {k: tuple(sorted(each, key=lambda a: -a.overlap)) for k, each in found.items()}


def _most_alike(model: shapely.Polygon, seen: shapely.Polygon) -> Alignment:
    """Return the alignment with the maximum overlap over all yaws and positions."""
    best = align(model, seen)[0]
    if best.overlap >= ALIKE:
        return best
    yaws = (best.yaw + 2 * np.pi * np.arange(YAWS) / YAWS).tolist()
    starts = sorted(yaws, key=lambda yaw: -_overlap(model, seen, yaw, np.zeros(2)))[:TRIES]
    found = [_with_maximum_overlap(model, seen, yaw, np.zeros(2)) for yaw in starts]
    # With one outline inside the other, many positions have the same overlap.
    found += [(_overlap(model, seen, yaw, np.zeros(2)), (yaw, np.zeros(2))) for yaw in starts]
    highest = max(overlap for overlap, _ in found)
    one, other = boundary_of(model), boundary_of(seen)
    ends = (
        _alignment(one, other, *pose, overlap)
        for overlap, pose in found
        if overlap >= highest - EQUAL
    )
    return min(ends, key=lambda a: a.distance)


def mirrored(polygon: shapely.Polygon) -> shapely.Polygon:
    """Return the mirror image of a polygon: x remains, y changes its sign."""
    return shapely.geometry.polygon.orient(affinity.scale(polygon, 1.0, -1.0, origin=(0, 0)))


def _candidates(model: Boundary, seen: Boundary) -> Array:
    """Return yaws (k,), rad, at which the signatures match, best first."""
    one, other = np.fft.rfft(model.signature()), np.fft.rfft(seen.signature())
    match = np.fft.irfft(one.conj() * other, RAYS)
    norms = (model.signature() ** 2).sum(axis=1) + (seen.signature() ** 2).sum(axis=1)
    off = (1 - 2 * match / norms[:, None]).mean(axis=0)
    before, after = np.roll(off, 1), np.roll(off, -1)
    low = np.flatnonzero((off <= before) & (off < after))
    if not len(low) or np.ptp(off) < ROUND:
        return np.zeros(1)
    low = low[np.argsort(off[low], kind='stable')][:MAX_SOLUTIONS]
    low = low[off[low] <= off[low[0]] + MAX_WORSE]
    curve = before[low] + after[low] - 2 * off[low]
    return np.asarray((low + (before[low] - after[low]) / (2 * curve)) * 2 * np.pi / RAYS)


def _refined(model: Boundary, seen: Boundary, yaws: Array) -> list[Pose]:
    """Return the yaws and shifts of the centroid that bring boundaries together.

    It minimizes the squared distances of the seen points to the lines of the nearest pieces of the
    model (Chen and Medioni 1992), because a seen outline can be noisy. Distances above the usual
    one have less weight (Cauchy), because outlines can differ in a detail.
    """
    shifts = np.zeros((len(yaws), 2))
    some = seen.points[:: max(1, len(seen.points) // REFINED)]
    scale = model.radius
    for _ in range(ITERATIONS):
        turns = np.stack([turn(yaw) for yaw in yaws])
        points = (some - shifts[:, None]) @ turns
        way, piece = model.nearest(points.reshape(-1, 2))
        normal = model.normals(piece)
        off = (way * normal).sum(axis=1).reshape(len(yaws), -1)
        normal = normal.reshape(points.shape)
        lever = (points[..., 0] * normal[..., 1] - points[..., 1] * normal[..., 0]) / scale
        design = np.concatenate([lever[..., None], normal], axis=2)
        usual = 2 * np.median(np.abs(off), axis=1, keepdims=True) + 1e-3 * scale
        weighted = design / (1 + (off / usual) ** 2)[..., None]
        square = weighted.swapaxes(1, 2) @ design + 1e-6 * len(some) * np.eye(3)
        step = np.linalg.solve(square, -weighted.swapaxes(1, 2) @ off[..., None])[..., 0]
        yaws = yaws + step[:, 0] / scale
        shifts = shifts + (turns @ step[:, 1:, None])[..., 0]
    return [(float(yaw), shift) for yaw, shift in zip(yaws, shifts, strict=True)]


def _overlap(model: shapely.Polygon, seen: shapely.Polygon, yaw: float, shift: Array) -> float:
    """Return the intersection over union."""
    move = boundary_of(seen).centre + shift - turn(yaw) @ boundary_of(model).centre
    moved = shapely.transform(model, lambda points: points @ turn(yaw).T + move)
    common = float(shapely.intersection(moved, seen).area)
    return common / (float(model.area) + float(seen.area) - common)


def _with_maximum_overlap(
    model: shapely.Polygon, seen: shapely.Polygon, yaw: float, shift: Array
) -> tuple[float, Pose]:
    """Return the local maximum of the overlap near a pose, and its pose."""
    scale = boundary_of(model).radius

    def loss(step: Array) -> float:
        return -_overlap(model, seen, yaw + step[0], shift + scale * step[1:])

    simplex = START * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    best = minimize(
        loss,
        np.zeros(3),
        method='Nelder-Mead',
        options={'initial_simplex': simplex, 'xatol': 1e-4, 'fatol': 1e-5},
    )
    return -float(best.fun), (yaw + float(best.x[0]), shift + scale * best.x[1:])


def _alignment(
    model: Boundary, seen: Boundary, yaw: float, shift: Array, overlap: float
) -> Alignment:
    matrix = turn(yaw)
    x, y = (seen.centre + shift - matrix @ model.centre).tolist()
    there, _ = seen.nearest(model.points @ matrix.T + shift)
    back, _ = model.nearest((seen.points - shift) @ matrix)
    distance = float(np.linalg.norm(np.concatenate([there, back]), axis=1).max())
    return Alignment(float(np.angle(np.exp(1j * yaw))), x, y, overlap, distance)
