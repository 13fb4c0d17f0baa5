"""Find the aspects of a part: the basins of its landscape, told apart, ordered, classed."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.core.aspects.joining import JoinedMinima, join_minima
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.aspects.symmetry import Symmetry, find_symmetry
from resting_aspects_ros.core.geometry.polyhedron import Indices, Polyhedron
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, angle_between, orientation_with_down, rotate

# Version of the rule that gives aspects their ids: counts under another one are not believed.
ASPECT_NUMBERING = 1
# Ids are ordered by centre of mass height in steps of this, R, and by share in steps of this.
ORDER_STEP = 1e-3
# Aspects of a part with an axis are alike if height, R, and cosine to the axis agree within this:
# what tessellation leaves.
ALIKE = 0.02
# Facets within this of the one on which the part rests are one with it for the support polygon:
# far below the angles that a part is built with.
SAME_FACET = np.radians(1.0)
# Directions on a circle are within this of its plane, as a share of the circle's radius.
_PLANAR = 0.1
# Directions all around a middle with some nearer to it than this share of the furthest fill a cap.
_HOLLOW = 0.5


@dataclass(frozen=True, eq=False)
class _UnnumberedAspect:
    """An aspect before it has a number: its minima, and what they are together."""

    minima: Indices  # the one that shows it first
    low: float  # height of the lowest of them, m
    height: float
    share: float
    sweep: Sweep
    axis: Array
    middle: Array  # of its directions; what a mesh does not change
    rolls: bool = False


def find_aspects(part: Part, landscape: Landscape | None = None) -> AspectSet:
    """The aspects of a part in the order of DESIGN's rule 4, with their symmetry classes.

    ``landscape`` is the part's, if somebody has it already: it takes a quarter of the time.
    """
    landscape = Landscape(part) if landscape is None else landscape
    joined = join_minima(landscape)
    found = _in_order([_found(landscape, part, group) for group in joined], part)
    owner = np.empty(len(landscape.minima), dtype=np.int64)
    for number, each in enumerate(found, start=1):
        owner[each.minima] = number
    barriers = _barriers(landscape, owner, found)
    aspects = tuple(
        _aspect(landscape, each, number, owner, barriers[number])
        for number, each in enumerate(found, start=1)
    )
    flat = [a.down_in_part for a in aspects if a.sweep is Sweep.POINT]
    symmetry = find_symmetry(part, np.array(flat).reshape(-1, 3))
    return _with_classes(
        AspectSet(part.part_sha256, aspects, symmetry), symmetry, part.hull_radius
    )


def _with_classes(aspects: AspectSet, symmetry: Symmetry, reach: float) -> AspectSet:
    """The aspects with their symmetry classes: those that a rotation maps onto each other."""
    group = np.arange(len(aspects))
    down = np.array([aspect.down_in_part for aspect in aspects.aspects]).reshape(-1, 3)
    for rotation in symmetry.rotations:
        for k, image in enumerate((aspects.locate(down @ rotation.T)[0] - 1).tolist()):
            group[group == max(group[k], group[image])] = min(group[k], group[image])
    if symmetry.axis is not None:
        # Any turn about the axis: those that stand to it alike, as the sides of a fine prism.
        lean = [(a.com_height / reach, a.down_in_part @ symmetry.axis) for a in aspects.aspects]
        for k, one in enumerate(lean):
            alike = np.abs(np.array(lean) - one).max(axis=1) < ALIKE
            first = group[alike].min()
            group[np.isin(group, group[alike])] = min(first, group[k])
    _, classes, sizes = np.unique(group, return_inverse=True, return_counts=True)
    # A minimum that the mesh makes halfway between two is joined with one of them.
    share = np.bincount(classes, weights=[a.basin_share for a in aspects.aspects]) / sizes
    return AspectSet(
        aspects.part_sha256,
        tuple(
            dataclasses.replace(
                a,
                basin_share=float(share[c]),
                symmetry_class=int(c) + 1,
                multiplicity=int(sizes[c]),
            )
            for a, c in zip(aspects.aspects, classes, strict=True)
        ),
        symmetry,
    )


def _found(landscape: Landscape, part: Part, joined: JoinedMinima) -> _UnnumberedAspect:
    minima = joined.minima
    directions = landscape.directions[minima]
    share = float(landscape.basin_shares[minima].sum())
    lowest = float(landscape.heights[minima[0]])
    # A flat side that takes in a flat of the fillet beside it is one that is much lower; and flats
    # that only noise parts are no curve.
    if joined.level == 1 or not joined.curved:
        return _UnnumberedAspect(
            minima, lowest, lowest, share, Sweep.POINT, np.zeros(3), directions[0]
        )
    level = directions[: joined.level]
    sweep, axis, middle = _sweep(level, joined.step, part.principal_axes)
    shown = _shown(level, middle, part.principal_axes)
    order = np.concatenate([[shown], np.delete(np.arange(len(minima)), shown)])
    rolls = bool(angle_between(level, level[shown]).max() > CURVED_STEP)
    height = joined.height * landscape.radius
    return _UnnumberedAspect(minima[order], lowest, height, share, sweep, axis, middle, rolls)


def _sweep(directions: Array, step: float, frame: Array) -> tuple[Sweep, Array, Array]:
    """What the directions of a curved aspect sweep, its axis, and their middle."""
    middle = directions.mean(axis=0)
    pole = middle / max(float(np.linalg.norm(middle)), 1e-300)
    size, axes = np.linalg.svd(directions - middle, full_matrices=False)[1:]
    if len(directions) == 2:
        axis = np.cross(*directions)
        return Sweep.ARC, _signed(axis / np.linalg.norm(axis), frame), middle
    if size[1] > _PLANAR * size[0] and angle_between(directions, pole).max() <= 1.5 * step:
        return Sweep.DOME, pole, middle
    along = directions @ axes.T
    if (np.abs([along.min(axis=0), along.max(axis=0)]) > np.cos(CURVED_STEP)).all():
        return Sweep.SPHERE, np.zeros(3), np.zeros(3)
    around = along - middle @ axes.T
    azimuth = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    # A flat breaks a ring; a step of the mesh does not.
    round_ = np.diff(azimuth, append=azimuth[0] + 2 * np.pi).max() <= 1.5 * CURVED_STEP
    radius = np.hypot(around[:, 0], around[:, 1])
    if round_ and radius.min() < _HOLLOW * radius.max():
        return Sweep.DOME, pole, middle
    flat = size[2] <= _PLANAR * size[1]
    if flat or (round_ and np.linalg.norm(middle) < _PLANAR):
        tilt = float(axes[2] @ middle)
        axis = axes[2] * np.sign(tilt) if abs(tilt) > ORDER_STEP else _signed(axes[2], frame)
        return (Sweep.RING if round_ else Sweep.ARC), axis, middle
    return Sweep.DOME, pole, middle


def _signed(axis: Array, frame: Array) -> Array:
    """The axis in the sense of the first axis of the part's frame that it is not square to."""
    along = axis @ frame
    return np.asarray(axis * np.sign(along[np.abs(along) > ORDER_STEP][0]))


def _shown(directions: Array, middle: Array, frame: Array) -> int:
    """Which direction of a curved aspect shows it: the one in its middle, if it has one."""
    if np.linalg.norm(middle) > _PLANAR:
        return int((directions @ middle).argmax())
    along = np.round(directions @ frame, 6)
    return max(range(len(directions)), key=lambda k: tuple(along[k]))


def _in_order(found: list[_UnnumberedAspect], part: Part) -> list[_UnnumberedAspect]:
    """By centre of mass height, then basin, then direction in the part's intrinsic frame.

    The keys are compared in steps, so that noise does not reorder aspects that are equal; those
    that no key tells apart are mapped onto each other by a symmetry of the part.
    """
    keys: list[Callable[[_UnnumberedAspect], float]] = [
        lambda each: each.height / part.hull_radius,
        lambda each: -each.share,
        *(lambda each, axis=axis: -float(each.middle @ axis) for axis in part.principal_axes.T),
    ]
    groups = [list(found)]
    for key in keys:
        groups = [step for group in groups for step in _steps(group, key)]
    return [each for group in groups for each in group]


def _steps(
    found: Sequence[_UnnumberedAspect], key: Callable[[_UnnumberedAspect], float]
) -> list[list[_UnnumberedAspect]]:
    """In ascending steps of a key."""
    groups: list[list[_UnnumberedAspect]] = []
    for each in sorted(found, key=key):
        if groups and key(each) - key(groups[-1][0]) <= ORDER_STEP:
            groups[-1].append(each)
        else:
            groups.append([each])
    return groups


def _barriers(
    landscape: Landscape, owner: Indices, found: Sequence[_UnnumberedAspect]
) -> dict[int, tuple[float, int]]:
    """Return, by number, each aspect's minimum barrier, m, and the neighbour to which it leads."""
    min_rises = dict.fromkeys(range(1, len(found) + 1), (np.inf, 0))
    saddles = landscape.saddles
    for height, pair in zip(saddles.heights, owner[saddles.between], strict=True):
        for one, other in (pair, pair[::-1]):
            rise = float(height) - found[one - 1].low
            if one != other and rise < min_rises[int(one)][0]:
                min_rises[int(one)] = (rise, int(other))
    return min_rises


def _aspect(
    landscape: Landscape,
    found: _UnnumberedAspect,
    number: int,
    owner: Indices,
    barrier: tuple[float, int],
) -> Aspect:
    facet = int(landscape.minima[found.minima[0]])
    directions = landscape.directions[found.minima]
    orientation = orientation_with_down(directions[0])
    polygon = rotate(orientation, _polygon(landscape.hull, facet) * landscape.radius)[:, :2]
    links = _links(landscape, owner == number, found.minima) if found.sweep.curved else []
    return Aspect(
        id=number,
        down_in_part=directions[0],
        com_height=found.height,
        orientation=orientation,
        support=polygon[ConvexHull(polygon).vertices],  # counter-clockwise
        basin_share=found.share,
        min_barrier=barrier[0],
        neighbour=barrier[1],
        symmetry_class=number,
        multiplicity=1,
        rolls=found.rolls,
        sweep=found.sweep,
        axis=found.axis,
        directions=directions,
        links=np.array(links, dtype=np.int64).reshape(-1, 2),
    )


def _links(
    landscape: Landscape, own: npt.NDArray[np.bool_], minima: Indices
) -> list[tuple[int, int]]:
    """Pairs of an aspect's minima with a saddle between them that its own curved side makes."""
    place = {int(minimum): k for k, minimum in enumerate(minima)}
    a, b = landscape.saddles.between.T
    inner = np.flatnonzero(own[a] & own[b] & (a != b))
    near = angle_between(landscape.directions[a[inner]], landscape.directions[b[inner]])
    pairs = landscape.saddles.between[inner[near <= CURVED_STEP]].tolist()
    return sorted({(place[min(x, y)], place[max(x, y)]) for x, y in pairs})


def _polygon(hull: Polyhedron, facet: int) -> Array:
    """(k, 3) corners of a facet and of those that are one with it, in units of R."""
    corners = np.unique(np.concatenate([hull.corners(each) for each in facets_at(hull, facet)]))
    return np.asarray(hull.points[corners])


def facets_at(hull: Polyhedron, facet: int) -> list[int]:
    """A facet and those that are one with it: within SAME_FACET of it, and joined to it."""
    normal = hull.normals[facet]
    one = [facet]
    for each in one:
        for edge in hull.edges_of_facets[each]:
            other = int(hull.sides[edge].sum()) - each
            near = angle_between(hull.normals[other], normal) <= SAME_FACET
            if near and other not in one:
                one.append(other)
    return one
