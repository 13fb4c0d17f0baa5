"""Find the aspects of a part: group the minima of its landscape, number and classify them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.aspects.aspect_set import (
    Aspect,
    AspectSet,
    Sweep,
    with_symmetry_classes,
)
from resting_aspects_ros.core.aspects.heading import SurfaceMoments, heading, surface_moments
from resting_aspects_ros.core.aspects.joining import JoinedMinima, join_minima
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.aspects.symmetry import find_symmetry
from resting_aspects_ros.core.geometry.polyhedron import Indices, Polyhedron, coplanar_facets
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import (
    Array,
    angle_between,
    orientation_with_down,
    rotate,
    turned_about_vertical,
)

# Version of the rule that numbers aspects. Counts under another version are not used.
ASPECT_NUMBERING = 4
# Ids are ordered by centre of mass height, R, and by share; both are compared in steps of this.
ORDER_STEP = 1e-3
# Maximum difference of the heights of saddles that count as equally high, hull radii.
SAME_SADDLE = 1e-5
# Maximum distance of directions on a circle from its plane, as a share of the radius.
_PLANAR = 0.1
# Directions around a centre fill a cap, not a ring, if the nearest is closer to the centre than
# this share of the furthest.
_RING_WIDTH = 0.5


@dataclass(frozen=True, eq=False)
class _UnnumberedAspect:
    """An aspect before it has a number: its minima and their common properties."""

    minima: Indices  # the representative one first, then those of the level
    drained: Indices
    level: int
    ignored: float  # m
    rest: float  # see JoinedMinima, m
    height: float
    share: float
    sweep: Sweep
    axis: Array
    middle: Array  # mean of its directions, which does not depend on the mesh
    rolls: bool = False


def find_aspects(part: Part, landscape: Landscape | None = None) -> AspectSet:
    """Return the numbered aspects of a part with their symmetry classes.

    ``landscape`` is the landscape of the part, if known already: computing it takes a quarter of
    the time.
    """
    landscape = Landscape(part) if landscape is None else landscape
    joined = join_minima(landscape)
    unnumbered = _sorted_aspects([_unnumbered(landscape, part, g) for g in joined], part)
    owner = np.empty(len(landscape.minima), dtype=np.int64)
    for number, each in enumerate(unnumbered, start=1):
        owner[each.minima] = owner[each.drained] = number
    barriers = _barriers(landscape, owner, unnumbered)
    moments = surface_moments(part)
    aspects = tuple(
        _aspect(landscape, each, number, barriers[number], moments)
        for number, each in enumerate(unnumbered, start=1)
    )
    flat = [a.directions for a in aspects if not a.sweep.curved]
    symmetry = find_symmetry(
        part,
        np.array([each[0] for each in flat]).reshape(-1, 3),
        np.concatenate([np.zeros((0, 3)), *flat]),
    )
    return with_symmetry_classes(
        AspectSet(part.part_sha256, aspects, symmetry), symmetry, part.hull_radius
    )


def _unnumbered(landscape: Landscape, part: Part, joined: JoinedMinima) -> _UnnumberedAspect:
    """Return the properties of a group of minima that are one aspect."""
    minima = joined.minima
    directions = landscape.directions[minima]
    own = np.concatenate([minima, joined.drained])
    share = float(landscape.basin_shares[own].sum())
    rest = joined.rest * landscape.radius
    ignored = joined.ignored * landscape.radius
    # A flat side can include a flat of an adjacent fillet, but is much lower. Flats that are
    # separated only by noise are not a curved side.
    if joined.level == 1:
        sweep, axis, middle = Sweep.POINT, np.zeros(3), directions[0]
        order, rolls = np.arange(len(minima)), False
    else:
        level = directions[: joined.level]
        feet = _feet(landscape, minima[: joined.level])
        sweep, axis, middle = _sweep(level, feet, joined.step, part.principal_axes)
        representative = _representative(level, middle, part.principal_axes)
        others = np.delete(np.arange(len(minima)), representative)
        order = np.concatenate([[representative], others])
        rolls = bool(angle_between(level, level[representative]).max() > CURVED_STEP)
    height = joined.height * landscape.radius
    return _UnnumberedAspect(
        minima[order],
        joined.drained,
        joined.level,
        ignored,
        rest,
        height,
        share,
        sweep,
        axis,
        middle,
        rolls,
    )


def _feet(landscape: Landscape, minima: Indices) -> Array:
    """Return the directions (n, 3) of gravity in the saddles between some minima."""
    inner = np.isin(landscape.saddles.between, minima).all(axis=1)
    return landscape.saddles.directions(landscape.hull, np.flatnonzero(inner))


def _sweep(
    directions: Array, feet: Array, step: float, frame: Array
) -> tuple[Sweep, Array, Array]:
    """Return the sweep of the directions of a curved aspect, its axis, and their mean.

    ``feet`` are the directions in the saddles between them.
    """
    middle = directions.mean(axis=0)
    pole = middle / max(float(np.linalg.norm(middle)), 1e-300)
    size, axes = np.linalg.svd(directions - middle, full_matrices=False)[1:]
    if len(directions) == 2:
        axis = np.cross(*directions)
        return Sweep.ARC, _signed(axis / np.linalg.norm(axis), frame), middle
    # An arc is curved towards the pole, but not across.
    beside = np.linalg.svd(directions - (directions @ pole)[:, None] * pole, compute_uv=False)
    if beside[1] > _PLANAR * beside[0] and angle_between(directions, pole).max() <= 1.5 * step:
        return Sweep.DOME, pole, middle
    along = directions @ axes.T
    if (np.abs([along.min(axis=0), along.max(axis=0)]) > np.cos(CURVED_STEP)).all():
        return Sweep.SPHERE, np.zeros(3), np.zeros(3)
    around = along - middle @ axes.T
    azimuth = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    steps = np.diff(azimuth, append=azimuth[0] + 2 * np.pi)
    # A flat side interrupts a ring; a step of the mesh, over which the part rolls, does not.
    across = np.arctan2(*((feet - middle) @ axes[:2].T).T[::-1])
    widest = int(steps.argmax())
    round_ = bool(((across - azimuth[widest]) % (2 * np.pi) < steps[widest]).any())
    radius = np.hypot(around[:, 0], around[:, 1])
    if round_ and radius.min() < _RING_WIDTH * radius.max():
        return Sweep.DOME, pole, middle
    flat = size[2] <= _PLANAR * size[1]
    if flat or (round_ and np.linalg.norm(middle) < _PLANAR):
        tilt = float(axes[2] @ middle)
        axis = axes[2] * np.sign(tilt) if abs(tilt) > ORDER_STEP else _signed(axes[2], frame)
        return (Sweep.RING if round_ else Sweep.ARC), axis, middle
    return Sweep.DOME, pole, middle


def _signed(axis: Array, frame: Array) -> Array:
    """Return the axis with a positive component along the first frame axis not normal to it."""
    along = axis @ frame
    return np.asarray(axis * np.sign(along[np.abs(along) > ORDER_STEP][0]))


def _representative(directions: Array, middle: Array, frame: Array) -> int:
    """Return the index of the direction that represents a curved aspect: the most central one."""
    if np.linalg.norm(middle) > _PLANAR:
        return int((directions @ middle).argmax())
    along = np.round(directions @ frame, 6)
    return max(range(len(directions)), key=lambda k: tuple(along[k]))


def _sorted_aspects(aspects: list[_UnnumberedAspect], part: Part) -> list[_UnnumberedAspect]:
    """Return the aspects by centre of mass height, basin, and direction in the intrinsic frame.

    The keys are compared in steps, so that noise does not reorder equal aspects. Aspects with
    equal keys are mapped onto each other by a symmetry of the part.
    """
    keys: list[Callable[[_UnnumberedAspect], float]] = [
        lambda each: each.height / part.hull_radius,
        lambda each: -each.share,
        *(lambda each, axis=axis: -float(each.middle @ axis) for axis in part.principal_axes.T),
    ]
    groups = [list(aspects)]
    for key in keys:
        groups = [step for group in groups for step in _grouped(group, key)]
    return [each for group in groups for each in group]


def _grouped(
    aspects: Sequence[_UnnumberedAspect], key: Callable[[_UnnumberedAspect], float]
) -> list[list[_UnnumberedAspect]]:
    """Return the aspects grouped by ascending steps of a key."""
    groups: list[list[_UnnumberedAspect]] = []
    for each in sorted(aspects, key=key):
        if groups and key(each) - key(groups[-1][0]) <= ORDER_STEP:
            groups[-1].append(each)
        else:
            groups.append([each])
    return groups


def _barriers(
    landscape: Landscape, owner: Indices, aspects: Sequence[_UnnumberedAspect]
) -> dict[int, tuple[float, int]]:
    """Return, by number, each aspect's minimum barrier, m, and the neighbour to which it leads.

    If several saddles are equally high, it is the neighbour with the lowest number.
    """
    min_rises = dict.fromkeys(range(1, len(aspects) + 1), (np.inf, 0))
    saddles = landscape.saddles
    for height, pair in zip(saddles.heights, owner[saddles.between], strict=True):
        for one, other in (pair, pair[::-1]):
            rise = float(height) - aspects[one - 1].rest
            if one == other:
                continue
            barrier, neighbour = min_rises[int(one)]  # of a lower saddle
            if not neighbour:
                min_rises[int(one)] = (rise, int(other))
            elif rise <= barrier + SAME_SADDLE * landscape.radius:
                min_rises[int(one)] = (barrier, min(neighbour, int(other)))
    return min_rises


def _aspect(
    landscape: Landscape,
    found: _UnnumberedAspect,
    number: int,
    barrier: tuple[float, int],
    moments: SurfaceMoments,
) -> Aspect:
    facet = int(landscape.minima[found.minima[0]])
    directions = landscape.directions[found.minima]
    orientation = orientation_with_down(directions[0])
    orientation = turned_about_vertical(orientation, heading(moments, orientation))
    polygon = rotate(orientation, _polygon(landscape.hull, facet) * landscape.radius)[:, :2]
    links = _links(landscape, found.minima) if found.sweep.curved else []
    return Aspect(
        id=number,
        down_in_part=directions[0],
        com_height=found.height,
        orientation=orientation,
        support=polygon[ConvexHull(polygon).vertices],  # counter-clockwise
        basin_share=found.share,
        min_barrier=barrier[0],
        neighbour=barrier[1],
        merged=found.ignored,
        symmetry_class=number,
        multiplicity=1,
        rolls=found.rolls,
        sweep=found.sweep,
        axis=found.axis,
        directions=directions,
        level=found.level,
        links=np.array(links, dtype=np.int64).reshape(-1, 2),
    )


def _links(landscape: Landscape, minima: Indices) -> list[tuple[int, int]]:
    """Return the pairs of minima of an aspect with a saddle of its curved side between them."""
    index = {int(minimum): k for k, minimum in enumerate(minima)}
    between = landscape.saddles.between
    inner = between[np.isin(between, minima).all(axis=1) & (between[:, 0] != between[:, 1])]
    a, b = np.moveaxis(landscape.directions[inner], 1, 0)
    pairs = inner[angle_between(a, b) <= CURVED_STEP].tolist()
    return sorted({(index[min(x, y)], index[max(x, y)]) for x, y in pairs})


def _polygon(hull: Polyhedron, facet: int) -> Array:
    """Return the corners (k, 3) of a facet and of those coplanar with it, in units of R."""
    corners = [hull.corners(each) for each in coplanar_facets(hull, facet)]
    return np.asarray(hull.points[np.unique(np.concatenate(corners))])
