"""Fits of what a pinhole camera sees of a class, projected from the place where it is seen.

The image of a part depends on where it lies: beside the foot point of the camera, the sides of the
part are seen, too. So each hypothesis is the solid itself, projected to the surface: first at yaws
around the circle, then again at each pose that fits best, until the pose no longer moves.
"""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.rotations import Array, rotate
from resting_aspects_ros.core.vision.boundary import RAYS, turn
from resting_aspects_ros.core.vision.camera import Pinhole
from resting_aspects_ros.core.vision.fitting import MAX_WORSE, Fit, Shape, mismatch, refined
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.core.vision.likelihood import OutlineNoise
from resting_aspects_ros.core.vision.outline import rolled
from resting_aspects_ros.core.vision.part_turns import vertical_order
from resting_aspects_ros.core.vision.rolling import Views
from resting_aspects_ros.core.vision.rolling_fit import ViewFit, weighted
from resting_aspects_ros.core.vision.silhouette import silhouette

# Number of yaws and of rolls at which a part is projected first, and of those that are refined.
YAWS, ROLLS, TRIED = 12, 12, 6
# Maximum number of projections of each of these, and the movement that ends them, noise.
STEPS, STILL = 4, 0.1
# Yaws closer than this are the same, rad.
SAME_YAW = 0.02
# How often the step of the roll is divided, and by which factor.
ROLL_STEPS, SMALLER = 3, 3.0


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
        fits: list[ViewFit] = []
        for view, place in self._starts():
            one = self._fit(view, place)
            if not any(_same(one, other, self._order) for other in fits):
                fits.append(one)
        return weighted(fits, self._order, self._noise, self._count)

    def _starts(self) -> list[tuple[int, _Place]]:
        """Return views and places at which the signatures match best, the best first."""
        count = -(-YAWS // self._order) if self._order else 1
        step = 2 * np.pi / max(self._order, 1) / count
        rows = []
        for view in np.unique(np.linspace(0, len(self._views.shapes) - 1, ROLLS).astype(int)):
            scores = [self._score(int(view), n * step, step) for n in range(count)]
            for n, (off, place) in enumerate(scores):
                if off <= min(scores[n - 1][0], scores[(n + 1) % count][0]):
                    rows.append((off, int(view), place))
        rows.sort(key=lambda row: row[0])
        return [row[1:] for row in rows[:TRIED] if row[0] <= rows[0][0] + MAX_WORSE]

    def _score(self, view: int, yaw: float, step: float) -> tuple[float, _Place]:
        """Return the least difference of the signatures within half a step of a yaw, and where."""
        top = self._camera.position[2]
        foot, com = self._camera.position[:2], self._height(self._views.orientations[view])
        centre = foot + (self._seen.boundary.centre - foot) * (top - com) / top
        inner = self._views.shapes[view].boundary.centre
        x, y = centre - turn(yaw) @ inner
        model = self._projected(self._views.orientations[view], _Place(yaw, x, y))
        off = mismatch(model.spectrum, model.squares, self._seen)
        middle, reach = (int(np.ceil(each * RAYS / (2 * np.pi))) for each in (yaw, step / 2))
        near = np.arange(middle - reach, middle + reach + 1) % RAYS
        best = int(near[off[near].argmin()])
        yaw = best * 2 * np.pi / RAYS
        x, y = centre - turn(yaw) @ inner
        return float(off[best]), _Place(yaw, float(x), float(y))

    def _fit(self, view: int, place: _Place) -> ViewFit:
        """Return the fit near a place, and near the roll of a view if the part rolls."""
        views = self._views
        orientation, roll = views.orientations[view], float(views.rolls[view])
        one, shape = self._settled(orientation, place)
        share = float(views.shares[view])
        if not views.rolls.any():
            return ViewFit(one, shape, orientation, roll, share)
        step, curve = _roll_step(views), 0.0
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
        corners[:, 2] += self._height(orientation)
        foot = turn(-place.yaw) @ (self._camera.position[:2] - (place.x, place.y))
        corners[:, :2] = self._camera.moved(foot).seen(corners)
        closed = not np.isnan(self._part.volume)
        return Shape(silhouette(corners, self._part.faces, closed, self._part.hull_radius))

    def _height(self, orientation: Array) -> float:
        """Return the height of the centre of mass above the surface, m."""
        up = rotate(orientation, self._part.hull_vertices - self._part.centre_of_mass)
        return -float(up[:, 2].min())


def _same(one: ViewFit, other: ViewFit, order: int) -> bool:
    turned = abs(np.angle(np.exp(1j * max(order, 1) * (one.fit.yaw - other.fit.yaw))))
    near = order == 0 or turned < max(order, 1) * SAME_YAW
    return bool(near and abs(one.roll - other.roll) < SAME_YAW)


def _roll_step(views: Views) -> float:
    """Return the distance of the rolls at which a part is projected first, rad."""
    return (views.period or float(np.ptp(views.rolls))) / ROLLS


def _limited(views: Views, roll: float) -> float:
    """Return a roll within the range of an arc."""
    if views.period:
        return float(roll)
    return float(np.clip(roll, views.rolls.min(), views.rolls.max()))
