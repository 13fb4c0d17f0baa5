"""The outlines of a part as a function of its roll, their fit, and a part that is looked for."""

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.vision.boundary import RAYS
from resting_aspects_ros.vision.fitting import (
    MAX_WORSE,
    Fit,
    OutlineNoise,
    Shape,
    ShapeStack,
    fit,
    known_likelihood,
    mismatch,
    shape_of,
)
from resting_aspects_ros.vision.location import Placement, Pose, vertical_order
from resting_aspects_ros.vision.outline import (
    Outline,
    angle_about,
    rolled,
    rolled_down,
    rolls_round,
    seen_outline,
    spread,
)

# -- Outlines that roll ---------------------------------------------------------------------------


# Root mean square distance of neighbours, R, that is not divided further, and the minimum step,
# rad. Outlines that are closer than the second value, R, are equal.
TOLERANCE, EQUAL, MIN_STEP = 5e-3, 3e-4, np.radians(0.5)
# Number of outlines at the start and at the end, and of a part that rolls in all directions.
START, END, DOME = 24, 64, 48
# With more triangles, the numbers are smaller in proportion, but at least MIN_VIEWS.
MANY_FACES, MIN_VIEWS = 50_000, 12


@dataclass(frozen=True, eq=False)
class Views:
    """The outlines of a class by roll; a single one if the part does not roll.

    aspect : Aspect
        The first one of the class.
    shapes : tuple of Shape
    orientations : (n, 4) float
        Unit quaternions xyzw, tray from part, at yaw 0.
    rolls : (n,) float
        rad, ascending; zeros if the part rolls in all directions.
    groups : (n,) int
        Number of the group of equal outlines with successive rolls.
    shares : (n,) float
        Share of the range of rolls that the group of each outline has.
    period : float
        Roll after which the outlines repeat, rad; 0 if they do not.
    """

    aspect: Aspect
    shapes: tuple[Shape, ...]
    orientations: Array
    rolls: Array
    groups: npt.NDArray[np.int64]
    shares: Array
    period: float = 0.0

    @cached_property
    def spectra(self) -> Array:
        """(n, 2, f) complex: the spectra of the signatures."""
        return np.stack([shape.spectrum for shape in self.shapes])

    @cached_property
    def squares(self) -> Array:
        """(n, 2) float: sums of the squares of the signatures."""
        return np.stack([shape.squares for shape in self.shapes])

    @cached_property
    def stack(self) -> ShapeStack:
        """The shapes, for fits of several of them at once."""
        return ShapeStack(self.shapes)

    def beside(self, k: int) -> list[int]:
        """Return the views before and after another one, fewer at the ends of the range."""
        return [n for step in (-1, 1) if (n := self.neighbour(k, step)) is not None]

    def neighbour(self, k: int, step: int) -> int | None:
        """Return the view before or after another one, None at the end of the range."""
        if len(self.shapes) < 3 or not self.rolls.any():
            return None
        other = k + step
        if self.period:
            return other % len(self.shapes)
        return other if 0 <= other < len(self.shapes) else None


def find_views(part: Part, aspects: AspectSet, outline: Outline) -> Views:
    """Return the outlines of a class by roll."""
    aspect = aspects[outline.aspect - 1]
    main = shape_of(outline.polygon)
    single = Views(
        aspect, (main,), aspect.orientation[None], np.zeros(1), np.zeros(1, np.int64), np.ones(1)
    )
    if aspect.sweep is Sweep.POINT or rolls_round(aspects.symmetry, aspect):
        return single
    fewer = max(1.0, len(part.faces) / MANY_FACES)
    if aspect.sweep not in (Sweep.ARC, Sweep.RING):
        downs = spread(aspect.directions, max(MIN_VIEWS, round(DOME / fewer)))
        orientations = np.array([rolled_down(aspect, down) for down in downs])
        shapes = tuple(Shape(seen_outline(part, each)) for each in orientations)
        number = np.arange(len(downs))
        shares = np.full(len(downs), 1 / len(downs))
        return Views(aspect, shapes, orientations, np.zeros(len(downs)), number, shares)
    low, high = _range(aspect)
    period = high - low if aspect.sweep is Sweep.RING else 0.0
    if period:
        # A body of revolution that does not roll about its own axis shows each outline once.
        if aspects.symmetry is not None and aspects.symmetry.axis is None:
            period /= max(1, vertical_order(aspects.symmetry, aspect.axis))
        high = low + period
    start = np.linspace(low, high, max(MIN_VIEWS, round(START / fewer)) + 1)
    count = max(MIN_VIEWS + 1, round(END / fewer))
    made = {float(roll): Shape(seen_outline(part, rolled(aspect, roll))) for roll in start}
    gaps = [(-made[a].distance(made[b]), a, b) for a, b in pairwise(start)]
    heapq.heapify(gaps)
    size = TOLERANCE * part.hull_radius
    done = []
    while gaps:
        gap, a, b = heapq.heappop(gaps)
        if -gap <= size or b - a < 2 * MIN_STEP or len(made) >= count:
            done.append((a, -gap))
            continue
        middle = float(a + b) / 2
        made[middle] = Shape(seen_outline(part, rolled(aspect, middle)))
        for one, other in ((a, middle), (middle, b)):
            heapq.heappush(gaps, (-made[one].distance(made[other]), one, other))
    differences = np.array([gap for _, gap in sorted(done)])
    if differences.max() < EQUAL * part.hull_radius:
        return single
    rolls = np.array(sorted(made))
    return _views(aspect, made, rolls, differences > EQUAL * part.hull_radius, period)


def _views(
    aspect: Aspect,
    made: dict[float, Shape],
    rolls: Array,
    differs: npt.NDArray[np.bool_],
    period: float,
) -> Views:
    """Return the views with their shares; ``differs`` says which neighbours do."""
    steps = np.diff(rolls)
    cell = (np.append(steps, 0) + np.append(0, steps)) / 2 / steps.sum()
    group = np.append(0, np.cumsum(differs))
    if period:  # the last view is the first one
        cell[0] += cell[-1]
        group[group == group[-1]] = group[0]
        rolls, cell, group = rolls[:-1], cell[:-1], group[:-1]
    shares = np.bincount(group, cell)[group]
    shapes = tuple(made[float(roll)] for roll in rolls)
    orientations = np.array([rolled(aspect, roll) for roll in rolls])
    return Views(aspect, shapes, orientations, rolls, group, shares, period)


def _range(aspect: Aspect) -> tuple[float, float]:
    """Return the first and the last roll of a sweep about an axis, rad; 0 is between them."""
    if aspect.sweep is Sweep.RING:
        return 0.0, 2 * np.pi
    axis, start = aspect.axis, aspect.down_in_part
    angles = np.sort([angle_about(axis, d, start) % (2 * np.pi) for d in aspect.directions])
    gap = int(np.diff(angles, append=angles[0] + 2 * np.pi).argmax())
    if gap == len(angles) - 1:
        return float(angles[0]), float(angles[-1])
    return float(angles[gap + 1] - 2 * np.pi), float(angles[gap])


# -- Fit ------------------------------------------------------------------------------------------


# Fits are left out whose likelihood is smaller than the largest by more than this logarithm.
NEGLIGIBLE = 12.0
# Number of starts of a fit, yaw and roll, and maximum number of steps over the roll from each.
TRIED, STEPS = 6, 4
# Iterations of the refinement of each: the yaw is almost known.
ITERATIONS = 2
# Starts whose distance exceeds that of the nearest by more than this share of the radius are
# left out.
REACH = 0.01
# Yaws closer than this are the same start, rad.
SAME_START = 0.1


@dataclass(frozen=True, eq=False)
class ViewFit:
    """A fit of an outline of a class, between the views if the part rolls.

    fit : Fit
    shape : Shape
        The nearest view.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part, at yaw 0.
    roll : float
        rad.
    share : float
        Prior probability of the rolls that agree with the fit, if the errors have the given sd.
    """

    fit: Fit
    shape: Shape
    orientation: Array
    roll: float
    share: float


def class_fits(
    views: Views, order: int, seen: Shape, noise: OutlineNoise, count: float
) -> tuple[tuple[float, ViewFit], ...]:
    """Return log likelihoods and fits of a class, the most probable first.

    ``order`` is the yaw symmetry of its outline; ``count`` is the number of independent errors.
    """
    if len(views.shapes) == 1:
        fits = [
            ViewFit(one, views.shapes[0], views.orientations[0], 0.0, 1.0)
            for one in fit(views.shapes[0], seen, order)
        ]
    else:
        order = 1  # each outline has its own
        fits = view_fits(views, seen, noise.sd, count)
    return weighted(fits, order, noise, count)


def weighted(
    fits: Sequence[ViewFit], order: int, noise: OutlineNoise, count: float
) -> tuple[tuple[float, ViewFit], ...]:
    """Return log likelihoods and fits that are not negligible, the most probable first."""
    logs = [
        known_likelihood(one.fit, one.shape, order, noise, count) + float(np.log(one.share))
        for one in fits
    ]
    found = sorted(zip(logs, fits, strict=True), key=lambda row: -row[0])
    return tuple(row for row in found if row[0] > found[0][0] - NEGLIGIBLE)


def view_fits(views: Views, seen: Shape, sd: float, count: float) -> list[ViewFit]:
    """Return the fits of a class that rolls to a seen outline.

    ``sd`` is that of the boundary, m, with ``count`` independent errors.
    """
    near = _NearFits(views, seen)
    starts = view_starts(views, seen)
    first = near.all(starts)
    nearest = np.sqrt(min(one.square for one in first)) + REACH * seen.boundary.radius
    ends = [
        (k, one) for (k, _), one in zip(starts, first, strict=True) if one.square <= nearest**2
    ]
    moving = list(range(len(ends)))
    for _ in range(STEPS):
        # All starts take a step at once.
        near.all([(n, ends[i][1].yaw) for i in moving for n in views.beside(ends[i][0])])
        still = []
        for i in moving:
            k, best = ends[i]
            around = [(n, near(n, best.yaw)) for n in views.beside(k)]
            other, one = min(around, key=lambda row: row[1].square, default=(k, best))
            if other != k and one.square < best.square:
                ends[i] = (other, one)
                still.append(i)
        moving = still
    near.all([(n, best.yaw) for k, best in ends for n in views.beside(k)])
    fits: dict[tuple[int, int], ViewFit] = {}
    for k, best in ends:
        sides = [(n, near(n, best.yaw)) for n in views.beside(k)]
        equal = all(views.groups[n] == views.groups[k] for n, _ in sides)
        key = (-1 - int(views.groups[k]) if equal else k, round(best.yaw / SAME_START))
        if key not in fits:
            between = len(sides) == 2 and not equal
            fits[key] = (
                _between(views, k, best, sides, sd, count) if between else _at(views, k, best)
            )
    return list(fits.values())


class _NearFits:
    """The fits of views near yaws; those near the same yaw are computed once."""

    def __init__(self, views: Views, seen: Shape) -> None:
        self._views, self._seen = views, seen
        # By view: the yaw from which a fit began, and the fit.
        self._found: dict[int, list[tuple[float, Fit]]] = {}

    def __call__(self, k: int, yaw: float) -> Fit:
        """Return the fit of a view near a yaw, rad."""
        return self.all([(k, yaw)])[0]

    def all(self, pairs: Sequence[tuple[int, float]]) -> list[Fit]:
        """Return the fits of pairs of a view and a yaw, rad."""
        needed: list[tuple[int, float]] = []
        for k, yaw in pairs:
            same = any(k == n and _is_near(yaw, other) for n, other in needed)
            if not same and self._known(k, yaw) is None:
                needed.append((k, yaw))
        if needed:
            which, yaws = np.array([k for k, _ in needed]), np.array([yaw for _, yaw in needed])
            fits = self._views.stack.refined(which, self._seen, yaws, ITERATIONS)
            for (k, yaw), one in zip(needed, fits, strict=True):
                self._found.setdefault(k, []).append((yaw, one))
        found = [self._known(k, yaw) for k, yaw in pairs]
        return [one for one in found if one is not None]

    def _known(self, k: int, yaw: float) -> Fit | None:
        for begin, one in self._found.get(k, ()):
            if _is_near(yaw, one.yaw) or _is_near(yaw, begin):
                return one
        return None


def _is_near(one: float, other: float) -> bool:
    return abs(math.remainder(one - other, 2 * math.pi)) < 2 * np.pi / RAYS


def view_starts(views: Views, seen: Shape) -> list[tuple[int, float]]:
    """Return views and yaws whose signatures match better than those of their neighbours."""
    off = mismatch(views.spectra, views.squares, seen)
    low = (off <= np.roll(off, 1, axis=1)) & (off < np.roll(off, -1, axis=1))
    for step in (-1, 1):
        others = [views.neighbour(k, step) for k in range(len(off))]
        beside = np.array([np.inf if n is None else 0 for n in others])[:, None]
        beside = beside + off[[0 if n is None else n for n in others]]
        low &= off <= beside
    places = np.argwhere(low)
    values = off[low]
    order = np.argsort(values, kind='stable')[:TRIED]
    order = order[values[order] <= values[order[0]] + MAX_WORSE] if len(order) else order
    if not len(order):  # all outlines are round
        return [(int(off.min(axis=1).argmin()), 0.0)]
    return [(int(k), float(ray) * 2 * np.pi / RAYS) for k, ray in places[order]]


def _at(views: Views, k: int, best: Fit) -> ViewFit:
    """Return the fit of a view."""
    roll, share = float(views.rolls[k]), float(views.shares[k])
    return ViewFit(best, views.shapes[k], views.orientations[k], roll, share)


def _between(
    views: Views, k: int, best: Fit, sides: list[tuple[int, Fit]], sd: float, count: float
) -> ViewFit:
    """Return the fit at the minimum of the parabola through a view and its neighbours."""
    (before, first), (after, last) = sides
    # Steps from this view.
    a, b = views.rolls[before] - views.rolls[k], views.rolls[after] - views.rolls[k]
    if views.period:
        a, b = -((-a) % views.period), b % views.period
    steps = np.array([a, 0.0, b])
    squares = np.array([first.square, best.square, last.square])
    parabola = np.linalg.inv(np.vander(steps))  # coefficients from values at the steps
    curve, slope, _ = parabola @ squares
    whole = views.period or float(np.ptp(views.rolls))
    if curve <= 0:
        return _at(views, k, best)
    step = float(np.clip(-slope / (2 * curve), a, b))
    weights = np.array([step**2, step, 1.0]) @ parabola

    def at(values: list[float]) -> float:
        return float(weights @ values)

    yaws = [float(np.angle(np.exp(1j * (each.yaw - best.yaw)))) for each in (first, best, last)]
    yaw = float(np.angle(np.exp(1j * (best.yaw + at(yaws)))))
    x, y = (at([getattr(each, name) for each in (first, best, last)]) for name in 'xy')
    square = max(at(squares.tolist()), 0.0)
    roll = float(views.rolls[k]) + step
    width = sd * np.sqrt(2 * np.pi / (count * curve)) / whole
    return ViewFit(
        replace(best, yaw=yaw, x=x, y=y, square=min(square, best.square)),
        views.shapes[k],
        rolled(views.aspect, roll),
        roll,
        min(float(width), float(views.shares[k])),
    )


# -- A known part ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class KnownPart:
    """A part that is looked for, with its outlines and the prior shares of its classes.

    shares : (c,) float
        In the order of the outlines; the sum is 1.
    """

    part: Part
    aspects: AspectSet
    outlines: tuple[Outline, ...]
    shares: Array

    @cached_property
    def placements(self) -> tuple[Placement, ...]:
        """One for each outline."""
        return tuple(Placement(self.part, self.aspects, each) for each in self.outlines)

    @cached_property
    def views(self) -> tuple[Views, ...]:
        """For each class, its outlines by roll."""
        found = tuple(find_views(self.part, self.aspects, each) for each in self.outlines)
        for views in found:
            _ = views.spectra  # computed now, so that the first identification is fast, too
        return found


# -- Candidates -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Candidate:
    """A class of a part that an observed polygon may show.

    part : str
    symmetry_class : int
    aspects : tuple of int
        The aspects of the class, which look the same.
    x, y, yaw : float
        Camera pose of the outline: projection of the centre of mass, m, and yaw, rad.
    overlap : float
        Intersection over union; the noise of the observed polygon is smoothed.
    distance : float
        Largest distance between the boundaries, m.
    residual : float
        Root mean square of the distances between the boundaries, m.
    log_likelihood : float
        Natural logarithm up to a constant that all answers share.
    prior, posterior : float
        Probabilities; those of all candidates, none and touching add up to 1.
    roll : float
        Angle by which the part has rolled about the axis of the aspect, rad: that of the first
        pose, one of several if the outline does not tell it. 0 if the part does not roll.
    poses : tuple of Pose
        All poses of the part that look like this, tray frame; the most probable first.
    """

    part: str
    symmetry_class: int
    aspects: tuple[int, ...]
    x: float
    y: float
    yaw: float
    overlap: float
    distance: float
    residual: float
    log_likelihood: float
    prior: float
    posterior: float
    roll: float
    poses: tuple[Pose, ...]
