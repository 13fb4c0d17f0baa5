"""Fit of the outlines of a part that rolls: yaw, position and roll."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.boundary import RAYS
from resting_aspects_ros.core.vision.fitting import (
    MAX_WORSE,
    Fit,
    Shape,
    fit,
    mismatch,
)
from resting_aspects_ros.core.vision.likelihood import OutlineNoise, known_likelihood
from resting_aspects_ros.core.vision.outline import rolled
from resting_aspects_ros.core.vision.rolling import Views

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
