"""Fits of what a pinhole camera sees of a class, projected from the place where it is seen.

The image of a part depends on where it lies: beside the foot point of the camera, the sides of the
part are seen, too. So each hypothesis is the solid itself, projected to the surface: first at yaws
around the circle, then again at each pose that fits best, until the pose no longer moves.
"""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.vision.boundary import RAYS, turn
from resting_aspects_ros.vision.camera import Pinhole
from resting_aspects_ros.vision.fitting import (
    MAX_WORSE,
    Fit,
    OutlineNoise,
    Shape,
    mismatch,
    refined,
)
from resting_aspects_ros.vision.location import vertical_order
from resting_aspects_ros.vision.outline import rolled, silhouette
from resting_aspects_ros.vision.rolling import (
    REACH,
    KnownPart,
    ViewFit,
    Views,
    view_starts,
    weighted,
)

# Number of yaws at which a part is projected first, and maximum number of those that are refined.
YAWS, TRIED = 8, 6
# Maximum number of projections of each of these, and the movement that ends them, noise.
STEPS, STILL = 4, 0.5
# Yaws and rolls closer than this are the same, rad.
SAME_TURN = 0.02
# First step of the search of the roll, rad, how often it is divided, and by which factor.
FIRST_ROLL, ROLL_STEPS, SMALLER = 0.2, 3, 3.0


def perspective_fits(
    known: KnownPart, k: int, seen: Shape, camera: Pinhole, noise: OutlineNoise, count: float
) -> tuple[tuple[float, ViewFit], ...]:
    """Return log likelihoods and fits of class ``k``, the most probable first.

    ``seen`` is the image of the part on the surface; ``count`` is its number of independent
    errors.
    """
    return _ClassFits(known, k, seen, camera, noise, count).found()


@dataclass(frozen=True)
class _Place:
    """Camera pose of a part: yaw, rad, and x, y, m."""

    yaw: float
    x: float
    y: float


class _ClassFits:
    def __init__(
        self,
        known: KnownPart,
        k: int,
        seen: Shape,
        camera: Pinhole,
        noise: OutlineNoise,
        count: float,
    ) -> None:
        self._part, self._views = known.part, known.views[k]
        self._seen, self._camera, self._noise, self._count = seen, camera, noise, count
        self._rolls = len(self._views.shapes) > 1
        down = self._views.aspect.down_in_part
        self._order = 1 if self._rolls else vertical_order(known.aspects.symmetry, down)

    def found(self) -> tuple[tuple[float, ViewFit], ...]:
        """Return log likelihoods and fits, the most probable first."""
        rows = [
            (view, *self._settled(self._views.orientations[view], place))
            for view, place in (self._rolled_starts() if self._rolls else self._starts())
        ]
        far = np.sqrt(min(one.square for _, one, _ in rows)) + REACH * self._seen.boundary.radius
        fits: list[ViewFit] = []
        for view, one, shape in rows:
            if np.sqrt(one.square) <= far:
                found = self._fit(view, one, shape)
                if not any(_same(found, other, self._order) for other in fits):
                    fits.append(found)
        return weighted(fits, self._order, self._noise, self._count)

    def _starts(self) -> list[tuple[int, _Place]]:
        """Return the places at which what the camera sees there matches best, the best first."""
        count = -(-YAWS // self._order) if self._order else 1
        step = 2 * np.pi / max(self._order, 1) / count
        scores = [self._score(n * step, step) for n in range(count)]
        rows = [
            scores[n]
            for n in range(count)
            if scores[n][0] <= min(scores[n - 1][0], scores[(n + 1) % count][0])
        ]
        rows.sort(key=lambda row: row[0])
        return [(0, place) for off, place in rows[:TRIED] if off <= rows[0][0] + MAX_WORSE]

    def _score(self, yaw: float, step: float) -> tuple[float, _Place]:
        """Return the least difference of the signatures within half a step of a yaw, and where."""
        model = self._projected(self._views.orientations[0], self._place(0, yaw))
        off = mismatch(model.spectrum, model.squares, self._seen)
        middle, reach = (int(np.ceil(each * RAYS / (2 * np.pi))) for each in (yaw, step / 2))
        near = np.arange(middle - reach, middle + reach + 1) % RAYS
        best = int(near[off[near].argmin()])
        return float(off[best]), self._place(0, best * 2 * np.pi / RAYS)

    def _rolled_starts(self) -> list[tuple[int, _Place]]:
        """Return views and places at which the outlines match best, as if seen from above."""
        above = Shape(self._camera.projected(self._seen.polygon, self._height(0)))
        return [(view, self._place(view, yaw)) for view, yaw in view_starts(self._views, above)]

    def _place(self, view: int, yaw: float) -> _Place:
        """Return where a view with a yaw, rad, has the centroid of what is seen."""
        foot, top = self._camera.position[:2], self._camera.position[2]
        share = (top - self._height(view)) / top
        centre = foot + (self._seen.boundary.centre - foot) * share
        x, y = centre - turn(yaw) @ self._views.shapes[view].boundary.centre
        return _Place(yaw, float(x), float(y))

    def _fit(self, view: int, one: Fit, shape: Shape) -> ViewFit:
        """Return a fit of a view, at the best roll near that of the view if the part rolls."""
        views = self._views
        roll, share = float(views.rolls[view]), float(views.shares[view])
        if not views.rolls.any():
            return ViewFit(one, shape, views.orientations[view], roll, share)
        step, curve = FIRST_ROLL, 0.0
        for _ in range(ROLL_STEPS):
            sides = []
            for other in (roll - step, roll + step):
                fit, _ = self._settled(rolled(views.aspect, other), one)
                sides.append(fit.square)
            before, after = sides
            curve = (before + after - 2 * one.square) / (2 * step**2)
            move = -np.sign(after - before) * step
            if curve > 0:
                move = float(np.clip((before - after) / (4 * step * curve), -step, step))
            moved = _limited(views, roll + move)
            near, nearer = self._settled(rolled(views.aspect, moved), one)
            if near.square < one.square:
                roll, one, shape = moved, near, nearer
            step /= SMALLER
        if curve > 0:
            whole = views.period or float(np.ptp(views.rolls))
            width = self._noise.sd * np.sqrt(2 * np.pi / (self._count * curve)) / whole
            share = min(share, float(width))
        return ViewFit(one, shape, rolled(views.aspect, roll), roll, share)

    def _settled(self, orientation: Array, place: _Place | Fit) -> tuple[Fit, Shape]:
        """Return the fit of a part to the image near a place, and what is seen of it there."""
        for _ in range(STEPS):
            model = self._projected(orientation, place)
            (one,) = refined(model, self._seen, np.array([place.yaw]))
            turned = model.boundary.radius * abs(np.angle(np.exp(1j * (one.yaw - place.yaw))))
            moved = np.hypot(one.x - place.x, one.y - place.y) + turned
            place = one
            if moved < STILL * self._noise.sd:
                break
        return one, model

    def _projected(self, orientation: Array, place: _Place | Fit) -> Shape:
        """Return what the camera sees of a part at a place, in the axes of the part at yaw 0."""
        corners = rotate(orientation, self._part.vertices - self._part.centre_of_mass)
        corners[:, 2] -= corners[:, 2].min()
        foot = turn(-place.yaw) @ (self._camera.position[:2] - (place.x, place.y))
        corners[:, :2] = self._camera.moved(foot).seen(corners)
        closed = not np.isnan(self._part.volume)
        return Shape(silhouette(corners, self._part.faces, closed, self._part.hull_radius))

    def _height(self, view: int) -> float:
        """Return the height of the centre of mass of a view above the surface, m."""
        up = rotate(self._views.orientations[view], self._part.hull_vertices)[:, 2]
        com = rotate(self._views.orientations[view], self._part.centre_of_mass[None])[0, 2]
        return float(com - up.min())


def _same(one: ViewFit, other: ViewFit, order: int) -> bool:
    turned = abs(np.angle(np.exp(1j * max(order, 1) * (one.fit.yaw - other.fit.yaw))))
    near = order == 0 or turned < max(order, 1) * SAME_TURN
    return bool(near and abs(one.roll - other.roll) < SAME_TURN)


def _limited(views: Views, roll: float) -> float:
    """Return a roll within the range of an arc."""
    if views.period:
        return float(roll)
    return float(np.clip(roll, views.rolls.min(), views.rolls.max()))
