"""Find the aspects of a part: group the minima of its landscape, number and classify them."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import ConvexHull

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import (
    Aspect,
    AspectSet,
    Sweep,
    with_symmetry_classes,
)
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.aspects.symmetry import find_symmetry
from resting_aspects_ros.part.hull import Polyhedron, coplanar_facets
from resting_aspects_ros.part.mass import gauss_number, powers_up_to, surface_points
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.tessellation import CURVED_STEP, CurvedEdges
from resting_aspects_ros.rotations import (
    angle_between,
    orientation_with_down,
    rotate,
    turned_about_vertical,
)

# -- Heading --------------------------------------------------------------------------------------


# Orders n of the moments, in the order in which they are tried for the angle.
_ORDERS = (2, 1, 3, 4, 5, 6)
_HIGHEST = max(_ORDERS)
# Moments below this share of the area define no angle. A tessellation changes them by about 1e-3.
_VANISHING = 0.02
# The same for the orders of the second kind, and their number.
_SMALL, _FINE_ORDERS = 2e-3, 24
# Moments above this share of the area select one of several angles.
_NOISE = 1e-4
# With fewer triangles, which can be large, integrals of high order are exact.
_FEW_FACES = 4000


@dataclass(frozen=True, eq=False)
class SurfaceMoments:
    """The moments of the surface of a part about its centre of mass, in the axes of its frame.

    tensors : list of arrays
        Of order 0 to 6. Element (i, j, ...) is the integral of r_i r_j ... dA divided by the area,
        with r in units of R.
    corners : (f, 3, 3) float
        Corners r of the triangles.
    """

    tensors: list[Array]
    corners: Array

    @cached_property
    def fine_points(self) -> tuple[Array, Array]:
        """Points r (3, m) with weights (m,), for integrals of high order."""
        few = len(self.corners) < _FEW_FACES
        number = _FINE_ORDERS // 2 + 1 if few else gauss_number(len(self.corners), _HIGHEST)
        return _shares_of_area(self.corners, number)


def surface_moments(part: Part) -> SurfaceMoments:
    """Return the moments of the surface of a part."""
    corners = ((part.vertices - part.centre_of_mass) / part.hull_radius)[part.faces]
    points, weight = _shares_of_area(corners, gauss_number(len(corners), _HIGHEST))
    x, y, z = (powers_up_to(each, _HIGHEST) for each in points)
    found: dict[tuple[int, ...], float] = {}
    tensors = []
    for order in range(_HIGHEST + 1):
        tensor = np.empty((3,) * order)
        for index in product(range(3), repeat=order):
            a, b, c = (index.count(axis) for axis in range(3))
            if (a, b, c) not in found:
                found[a, b, c] = float((x[a] * y[b] * z[c]) @ weight)
            tensor[index] = found[a, b, c]
        tensors.append(tensor)
    return SurfaceMoments(tensors, corners)


def heading(moments: SurfaceMoments, orientation: Array) -> float:
    """Return by which angle about the vertical to rotate a part, rad; 0 if it looks round.

    Parameters
    ----------
    moments : SurfaceMoments
        See surface_moments.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part.
    """
    axes = rotate(orientation, np.eye(3)).T  # rows: axes of the tray in the part frame
    across, up = axes[0] + 1j * axes[1], axes[2]

    def moment(n: int, k: int) -> complex:
        value = moments.tensors[n + k].astype(np.complex128)
        for axis in (*(across,) * n, *(up,) * k):
            value = value @ axis
        return complex(value)

    pairs = [(n, k) for n in _ORDERS for k in range(_HIGHEST - n + 1)]
    found = [(n, moment(n, k)) for n, k in pairs]
    first = next(((n, c) for n, c in found if abs(c) > _VANISHING), None)
    if first is None:
        points, weights = moments.fine_points
        plane = across @ points
        plane /= np.abs(moments.corners @ across).max()
        fine = ((n, complex(weights @ plane**n)) for n in range(1, _FINE_ORDERS + 1))
        first = next(((n, c) for n, c in fine if abs(c) > _SMALL), None)
    if first is None:
        return 0.0
    n, c = first
    # With n = 4 and more, flats rather than corners are on the x axis.
    target = 0.0 if n < 4 else math.pi
    angles = [(target - float(np.angle(c)) + 2 * math.pi * j) / n for j in range(n)]
    for order, value in found:
        if len(angles) > 1 and abs(value) > _NOISE:
            angles = _selected(angles, order, float(np.angle(value)))
    return angles[0]


def _selected(angles: Sequence[float], n: int, phase: float) -> list[float]:
    """Return the angles at which a moment of order n is closest to the positive real axis.

    Of two that are equally close, it is the one with a positive imaginary part.
    """
    ends = np.exp(1j * (phase + n * np.array(angles)))
    nearest = [a for a, end in zip(angles, ends, strict=True) if end.real > ends.real.max() - 1e-3]
    ends = np.exp(1j * (phase + n * np.array(nearest)))
    return [a for a, end in zip(nearest, ends, strict=True) if end.imag > ends.imag.max() - 1e-3]


def _shares_of_area(corners: Array, number: int) -> tuple[Array, Array]:
    """Return points (3, m) and weights (m,) for integrals over triangles, divided by the area."""
    points, weights, area = surface_points(corners, number)
    return points, np.outer(weights, area / area.sum()).ravel()


# -- Joining of minima ----------------------------------------------------------------------------


# Barriers below this share of the height of the centre of mass in the higher minimum are noise:
# the part leaves the minimum if it is tilted by 2.6 degrees.
NOISE_BARRIER = 1e-3

# Depth of a flat below a curved side as a multiple of the barrier to the next flat, at most: 4 for
# an equilateral triangle on a sphere.
MAX_RISE = 4.0
# A part that must roll by more than this angle before it reaches the exit of a minimum can rest
# there, however low the barrier is: a ball with a small flat.
PLATEAU = CURVED_STEP


@dataclass(frozen=True, eq=False)
class JoinedMinima:
    """Minima that belong to one aspect.

    minima : (k,) int
        Their indices in the landscape, lowest first.
    drained : (d,) int
        Minima without an aspect, from which noise moves a part into these.
    curved : bool
        Whether they are flats of a curved side.
    step : float
        Maximum step of the mesh of the curved side, rad; 0 without a curved side.
    level : int
        Number of minima that are as low as the lowest, apart from effects of the mesh and noise;
        the others are on a slope.
    height : float
        Height of the centre of mass, R: that of the lowest minimum, or for a curved side that of
        the highest saddle within the level, because the edges of a mesh are on the true surface
        and its flats below.
    rest : float
        Height, R, of the highest minimum of the level that is below the lowest exit.
    ignored : float
        Highest barrier, R, that was ignored to join the minima.
    """

    minima: Indices
    drained: Indices
    curved: bool
    step: float
    level: int
    height: float
    rest: float
    ignored: float


class _Groups:
    """The groups of minima while they are joined; a group has the number of its lowest one."""

    def __init__(self, landscape: Landscape) -> None:
        self.low = landscape.heights / landscape.radius  # of each minimum
        self.number = np.arange(len(self.low))  # of the group of each minimum
        self.drained = np.zeros(len(self.low), dtype=np.bool_)
        self.curved = self.drained.copy()
        self.noisy = self.drained.copy()  # whether noise is all that separated minima of a group
        self.ignored = np.zeros(len(self.low))

    def pair(self, between: Indices) -> tuple[int, int]:
        """Return the lower and the higher group on the sides of a saddle."""
        one, other = self.number[between].tolist()
        return (one, other) if self.low[one] <= self.low[other] else (other, one)

    def join(self, lower: int, higher: int, barrier: float) -> None:
        """Join the higher group into the lower one across an ignored barrier."""
        self.ignored[lower] = max(self.ignored[lower], self.ignored[higher], barrier)
        self.number[self.number == higher] = lower


# Cached because a run of drops needs them for both its aspects and its job.
@lru_cache(maxsize=1)
def join_minima(landscape: Landscape) -> list[JoinedMinima]:
    """Return the aspects as groups of minima; each minimum is in one group.

    The saddles are processed in ascending order, so that the barrier of a group is that of its
    lowest minimum (persistence: Edelsbrunner, Letscher, Zomorodian 2002). Flats of curved sides
    are joined first: otherwise all flats of a ball would be joined to a flat side beside it, one
    after the other.
    """
    groups = _Groups(landscape)
    edges = CurvedEdges(landscape.hull)
    saddles = landscape.saddles
    heights = saddles.heights / landscape.radius
    explained = edges.depth[saddles.edges]
    explained += landscape.error * (explained > 0)
    meshed = edges.meshed[landscape.minima]
    # The lowest flat of a group can be deeper than those at the saddle.
    deep, share = edges.facet_depth[landscape.minima], edges.share[saddles.edges]
    for curved_only in (True, False):
        for k, (height, between) in enumerate(zip(heights, saddles.between, strict=True)):
            if curved_only and not meshed[between].all():
                continue
            lower, higher = groups.pair(between)
            barrier = height - groups.low[higher]
            by_mesh = barrier <= max(explained[k], share[k] * deep[higher])
            noise = max(NOISE_BARRIER * groups.low[higher], landscape.error)
            if lower == higher or not (by_mesh or (barrier <= noise and not curved_only)):
                continue
            level = groups.low[higher] - groups.low[lower] <= noise
            if not (curved_only or level) and _is_plateau(landscape, groups, higher, height):
                continue
            if by_mesh:
                groups.curved[lower] |= meshed[between].any()
            elif level:
                groups.noisy[lower] = True
            else:
                groups.drained |= groups.number == higher
            groups.curved[lower] |= groups.curved[higher] & (by_mesh | level)
            groups.noisy[lower] |= groups.noisy[higher] & level
            groups.join(lower, higher, barrier)
    return [_joined(landscape, groups, edges, int(k)) for k in np.unique(groups.number)]


def _is_plateau(landscape: Landscape, groups: _Groups, group: int, height: float) -> bool:
    """Return whether a part must roll by more than PLATEAU to leave a group at a height, R."""
    saddles = landscape.saddles
    inside = groups.number[saddles.between] == group
    limit = height + NOISE_BARRIER * groups.low[group]
    exits = (inside.sum(axis=1) == 1) & (saddles.heights <= limit * landscape.radius)
    own = np.flatnonzero((groups.number == group) & (groups.low <= limit))
    feet = saddles.directions(landscape.hull, np.flatnonzero(exits))
    nearest = (landscape.directions[own] @ feet.T).max(axis=1)
    return bool(nearest.min() < np.cos(PLATEAU))


def _joined(landscape: Landscape, groups: _Groups, edges: CurvedEdges, k: int) -> JoinedMinima:
    """Return a group with what follows from its minima."""
    own = groups.number == k
    minima = np.flatnonzero(own & ~groups.drained)
    low, saddles = groups.low, landscape.saddles
    facets = landscape.minima[minima]
    curved = bool(groups.curved[k])
    rise = min(float(edges.typical_depth[facets[0]]), MAX_RISE * float(groups.ignored[k]))
    rise *= curved
    leaves = own[saddles.between].sum(axis=1) == 1
    exit_ = saddles.heights[leaves].min(initial=np.inf) / landscape.radius
    top = low[k] + max(rise, NOISE_BARRIER * low[k] * (curved & groups.noisy[k]))
    level = low[minima] <= top
    inner = np.isin(saddles.between, minima[level]).all(axis=1)
    inner &= saddles.between[:, 0] != saddles.between[:, 1]
    heights = saddles.heights[inner] / landscape.radius
    heights = heights[heights <= max(top, low[k] + 2 * rise)]

    return JoinedMinima(
        minima=minima,
        drained=np.flatnonzero(own & groups.drained),
        curved=curved,
        step=float(edges.step[facets].max() * curved),
        level=int(level.sum()) if curved else 1,
        height=float(heights.max(initial=low[k]) if curved else low[k]),
        rest=float(low[minima[level & (low[minima] < exit_)]].max()),
        ignored=float(groups.ignored[k]),
    )


# -- Aspects --------------------------------------------------------------------------------------


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


class _Unnumbered(NamedTuple):
    """An aspect before its number, barrier and symmetry class are known, and its minima."""

    aspect: Aspect
    joined: JoinedMinima
    middle: Array  # mean of its directions, which does not depend on the mesh


# The aspects of the parts that still exist.
_found: WeakKeyDictionary[Part, AspectSet] = WeakKeyDictionary()


def find_aspects(part: Part, landscape: Landscape | None = None) -> AspectSet:
    """Return the numbered aspects of a part with their symmetry classes.

    They are found once for each part. ``landscape`` is the landscape of the part, if known
    already: computing it takes a quarter of the time.
    """
    found = _found.get(part)
    if found is None:
        found = _find_aspects(part, Landscape(part) if landscape is None else landscape)
        keep_aspects(part, found)
    return found


def keep_aspects(part: Part, aspects: AspectSet) -> None:
    """Keep the aspects of a part, such as those that another process found."""
    _found[part] = aspects


def _find_aspects(part: Part, landscape: Landscape) -> AspectSet:
    moments = surface_moments(part)
    joined = join_minima(landscape)
    found = _sorted_aspects([_unnumbered(landscape, part, g, moments) for g in joined], part)
    owner = np.empty(len(landscape.minima), dtype=np.int64)
    for number, each in enumerate(found, start=1):
        owner[each.joined.minima] = owner[each.joined.drained] = number
    barriers = _barriers(landscape, owner, [each.joined.rest for each in found])
    aspects = tuple(
        dataclasses.replace(
            each.aspect,
            id=number,
            symmetry_class=number,
            min_barrier=barriers[number][0],
            neighbour=barriers[number][1],
        )
        for number, each in enumerate(found, start=1)
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


def _unnumbered(
    landscape: Landscape, part: Part, joined: JoinedMinima, moments: SurfaceMoments
) -> _Unnumbered:
    """Return the aspect of a group of minima."""
    minima = joined.minima
    directions = landscape.directions[minima]
    # A flat side can include a flat of an adjacent fillet, but is much lower. Flats that are
    # separated only by noise are not a curved side.
    sweep, axis, middle, rolls = Sweep.POINT, np.zeros(3), directions[0], False
    links: list[tuple[int, int]] = []
    if joined.level > 1:
        level = directions[: joined.level]
        feet = _feet(landscape, minima[: joined.level])
        sweep, axis, middle = _sweep(level, feet, joined.step, part.principal_axes)
        # The representative one first, then the others of the level.
        first = _representative(level, middle, part.principal_axes)
        minima = np.concatenate([minima[[first]], np.delete(minima, first)])
        directions = landscape.directions[minima]
        rolls = bool(angle_between(level, directions[0]).max() > CURVED_STEP)
        links = _links(landscape, minima)
    orientation = orientation_with_down(directions[0])
    orientation = turned_about_vertical(orientation, heading(moments, orientation))
    polygon = _polygon(landscape.hull, int(landscape.minima[minima[0]])) * landscape.radius
    polygon = rotate(orientation, polygon)[:, :2]
    own = np.concatenate([joined.minima, joined.drained])
    aspect = Aspect(
        id=0,
        down_in_part=directions[0],
        com_height=joined.height * landscape.radius,
        orientation=orientation,
        support=polygon[ConvexHull(polygon).vertices],  # counter-clockwise
        basin_share=float(landscape.basin_shares[own].sum()),
        min_barrier=np.inf,
        neighbour=0,
        merged=joined.ignored * landscape.radius,
        symmetry_class=0,
        multiplicity=1,
        rolls=rolls,
        sweep=sweep,
        axis=axis,
        directions=directions,
        level=joined.level,
        links=np.array(links, dtype=np.int64).reshape(-1, 2),
    )
    return _Unnumbered(aspect, joined, middle)


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


def _sorted_aspects(aspects: list[_Unnumbered], part: Part) -> list[_Unnumbered]:
    """Return the aspects by centre of mass height, basin, and direction in the intrinsic frame.

    The keys are compared in steps, so that noise does not reorder equal aspects. Aspects with
    equal keys are mapped onto each other by a symmetry of the part.
    """
    keys: list[Callable[[_Unnumbered], float]] = [
        lambda each: each.aspect.com_height / part.hull_radius,
        lambda each: -each.aspect.basin_share,
        *(lambda each, axis=axis: -float(each.middle @ axis) for axis in part.principal_axes.T),
    ]
    groups = [aspects]
    for key in keys:
        groups = [step for group in groups for step in _grouped(group, key)]
    return [each for group in groups for each in group]


def _grouped(
    aspects: list[_Unnumbered], key: Callable[[_Unnumbered], float]
) -> list[list[_Unnumbered]]:
    """Return the aspects grouped by ascending steps of a key."""
    groups: list[list[_Unnumbered]] = []
    for each in sorted(aspects, key=key):
        if groups and key(each) - key(groups[-1][0]) <= ORDER_STEP:
            groups[-1].append(each)
        else:
            groups.append([each])
    return groups


def _barriers(
    landscape: Landscape, owner: Indices, rests: list[float]
) -> dict[int, tuple[float, int]]:
    """Return, by number, each aspect's minimum barrier, m, and the neighbour to which it leads.

    If several saddles are equally high, it is the neighbour with the lowest number. ``rests`` are
    those of JoinedMinima.
    """
    min_rises = dict.fromkeys(range(1, len(rests) + 1), (np.inf, 0))
    saddles = landscape.saddles
    for height, pair in zip(saddles.heights, owner[saddles.between], strict=True):
        for one, other in (pair, pair[::-1]):
            rise = float(height) - rests[one - 1] * landscape.radius
            if one == other:
                continue
            barrier, neighbour = min_rises[int(one)]  # of a lower saddle
            if not neighbour:
                min_rises[int(one)] = (rise, int(other))
            elif rise <= barrier + SAME_SADDLE * landscape.radius:
                min_rises[int(one)] = (barrier, min(neighbour, int(other)))
    return min_rises


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
