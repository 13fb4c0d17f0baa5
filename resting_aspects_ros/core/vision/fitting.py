"""Fit of an outline to a seen one: poses of least squares and their residuals.

The yaws come from the signatures of the boundaries and are refined by the distances of the
boundaries. What depends on only one of the two outlines is computed once, by Shape.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.alignment import normal_equations, turned
from resting_aspects_ros.core.vision.boundary import RAYS, Boundary, turn
from resting_aspects_ros.core.vision.common_area import common_area

# Number of points on a boundary at equal distances along it.
SAMPLES = 240
# Maximum number of yaws that are tried, and of those that are refined, the nearest ones after one
# step; every how many points and how often.
MAX_TRIED, MAX_YAWS, EVERY, ITERATIONS = 12, 4, 2, 4
# Yaws whose signatures match worse than the best by more than this share are not tried.
MAX_WORSE = 0.05
# Yaws closer than this are the same, rad; signatures that vary less are round.
SAME_YAW, ROUND = 0.02, 1e-6


class Shape:
    """A polygon with what its fits need.

    polygon : shapely.Polygon
    boundary : Boundary
        About the centroid of the polygon.
    samples : (m, 2) float
        Points on all rings at equal distances, relative to the centroid, m.
    area, perimeter, moment : float
        m^2, m, and the polar moment of the area about the centroid, m^4.
    lever : float
        Perimeter times the root mean square of the squared radius on the boundary, m^3.
    """

    def __init__(self, polygon: shapely.Polygon) -> None:
        self.polygon = polygon = orient(polygon)  # signatures depend on the direction of rings
        self.boundary = Boundary(polygon)
        self.area, self.perimeter = float(polygon.area), float(polygon.length)
        rings = [polygon.exterior, *polygon.interiors]
        points = [_points_on(ring, SAMPLES / self.perimeter) for ring in rings]
        self.samples = np.concatenate(points) - self.boundary.centre
        self.moment = sum(_moment(ring, self.boundary.centre) for ring in rings)
        self.lever = self.perimeter * np.sqrt(((self.samples**2).sum(axis=1) ** 2).mean())

    def difference(self, other: 'Shape') -> float:
        """Return a lower bound of the root mean square distance after the best fit, m.

        A boundary that moves by a distance d changes the area by the integral of d, and the polar
        moment of the area about its centroid by that of d times the squared radius, to first
        order; both are bounded by the root mean square of d (Cauchy and Schwarz).
        """
        areas = abs(self.area - other.area) / max(self.perimeter, other.perimeter)
        moments = abs(self.moment - other.moment) / max(self.lever, other.lever)
        return float(max(areas, moments))

    def distance(self, other: 'Shape') -> float:
        """Return the root mean square distance of the boundaries about their centroids, m."""
        there, _ = other.boundary.nearest(self.samples)
        back, _ = self.boundary.nearest(other.samples)
        return float(np.sqrt(((there**2).sum(axis=1).mean() + (back**2).sum(axis=1).mean()) / 2))

    @cached_property
    def signature(self) -> Array:
        """(2, RAYS) float: the signature of the boundary."""
        return self.boundary.signature()

    @cached_property
    def spectrum(self) -> Array:
        """Fourier transform of the signature."""
        return np.asarray(np.fft.rfft(self.signature))

    @cached_property
    def squares(self) -> Array:
        """(2,) float: sums of the squares of the signature."""
        return np.asarray((self.signature**2).sum(axis=1))


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose of a model on an observed polygon: a local minimum of the residuals.

    yaw : float
        rad, from -pi to pi.
    x, y : float
        m, so that seen = R(yaw) model + (x, y).
    square : float
        Mean square of the distances between the boundaries, of both directions, m^2.
    largest : float
        Largest of these distances, m.
    stiffness : float
        Half the second derivative of the mean square over yaw, (x, y) being optimal, m^2.
    """

    yaw: float
    x: float
    y: float
    square: float
    largest: float
    stiffness: float

    def overlap(self, model: shapely.Polygon, seen: shapely.Polygon) -> float:
        """Return the intersection over the union of the polygons."""
        move = np.array([self.x, self.y])
        moved = shapely.transform(model, lambda points: points @ turn(self.yaw).T + move)
        common = common_area(moved, seen)
        return common / (float(model.area) + float(seen.area) - common)


@lru_cache(maxsize=256)
def shape_of(polygon: shapely.Polygon) -> Shape:
    """Return the shape of a polygon; the latest ones are kept."""
    return Shape(polygon)


def fit(model: Shape, seen: Shape, order: int = 1) -> tuple[Fit, ...]:
    """Return the fits of a model to a seen outline, the least residual first.

    ``order`` is the yaw symmetry of the model (0: round): of solutions that differ by a rotation
    of the model onto itself, one is returned.
    """
    return refined(model, seen, candidate_yaws(model, seen, order), order)


def refined(
    model: Shape, seen: Shape, yaws: Array, order: int = 1, iterations: int = ITERATIONS
) -> tuple[Fit, ...]:
    """Return the fits near yaws (k,), rad, the least residual first.

    They minimize the squared distances of the seen samples to the lines of the nearest pieces of
    the model (Chen and Medioni 1992).
    """
    shifts = np.zeros((len(yaws), 2))
    some = seen.samples[::EVERY]
    scale = model.boundary.radius
    for step in range(iterations + 1):
        points = turned(some[None] - shifts[:, None], -yaws)
        way, piece = model.boundary.nearest(points.reshape(-1, 2))
        if step == 1 and len(yaws) > MAX_YAWS:
            nearest = (way**2).sum(axis=1).reshape(len(yaws), -1).sum(axis=1)
            kept = np.sort(np.argsort(nearest, kind='stable')[:MAX_YAWS])
            yaws, shifts, points = yaws[kept], shifts[kept], points[kept]
            way = way.reshape(len(nearest), -1, 2)[kept].reshape(-1, 2)
            piece = piece.reshape(len(nearest), -1)[kept].ravel()
        normals = model.boundary.normals[piece].reshape(points.shape)
        square, right = normal_equations(points, way.reshape(points.shape), normals, scale)
        if step == iterations:
            break
        moved = np.asarray(np.linalg.solve(square, right[..., None]), np.float64)[..., 0]
        shifts = shifts - turned(moved[:, None, 1:], yaws)[:, 0]
        yaws = yaws - moved[:, 0] / scale
    stiffness = scale**2 / np.linalg.inv(square)[:, 0, 0]
    there, back = _distances(model, seen, yaws, shifts)
    squares = ((there**2).mean(axis=1) + (back**2).mean(axis=1)) / 2
    found: list[Fit] = []
    for k in np.argsort(squares, kind='stable'):
        yaw = float(np.angle(np.exp(1j * yaws[k])))
        if any(_same(yaw, other.yaw, order) for other in found):
            continue
        x, y = seen.boundary.centre + shifts[k] - turn(yaw) @ model.boundary.centre
        largest = float(max(there[k].max(), back[k].max()))
        found.append(Fit(yaw, float(x), float(y), float(squares[k]), largest, float(stiffness[k])))
    return tuple(found)


def mismatch(spectra: Array, squares: Array, seen: Shape) -> Array:
    """Return how much signatures (..., 2) differ from that of a seen outline, (..., RAYS).

    It is relative, for each rotation by 2 pi k / RAYS; ``spectra`` are those of the signatures,
    ``squares`` their sums of squares.
    """
    match = np.fft.irfft(spectra.conj() * seen.spectrum, RAYS)
    norms = squares + seen.squares
    return np.asarray((1 - 2 * match / norms[..., None]).mean(axis=-2))


def candidate_yaws(model: Shape, seen: Shape, order: int = 1) -> Array:
    """Return yaws (k,), rad, at which the signatures match, best first, one of each symmetry."""
    off = mismatch(model.spectrum, model.squares, seen)
    if order == 0 or np.ptp(off) < ROUND:
        return np.zeros(1)
    before, after = np.roll(off, 1), np.roll(off, -1)
    low = np.flatnonzero((off <= before) & (off < after))
    low = low[np.argsort(off[low], kind='stable')]
    low = low[off[low] <= off[low[0]] + MAX_WORSE]
    curve = before[low] + after[low] - 2 * off[low]
    chosen: list[float] = []
    for yaw in (low + (before[low] - after[low]) / (2 * curve)) * 2 * np.pi / RAYS:
        if not any(_same(yaw, other, order) for other in chosen):
            chosen.append(float(yaw))
        if len(chosen) == MAX_TRIED:
            break
    return np.array(chosen)


def _points_on(ring: shapely.LinearRing, density: float) -> Array:
    """Return points (m, 2) at equal distances along a ring, ``density`` of them in a metre."""
    corners = shapely.get_coordinates(ring)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    count = max(3, round(density * float(along[-1])))
    places = (np.arange(count) + 0.5) / count * along[-1]
    return np.stack([np.interp(places, along, axis) for axis in corners.T], axis=1)


def _moment(ring: shapely.LinearRing, centre: Array) -> float:
    """Return the polar moment of the area inside a ring, negative if it is clockwise, m^4."""
    points = shapely.get_coordinates(ring) - centre
    a, b = points[:-1], points[1:]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return float((cross * ((a**2 + a * b + b**2).sum(axis=1))).sum() / 12)


def _same(one: float, other: float, order: int) -> bool:
    return order == 0 or abs(np.angle(np.exp(1j * order * (one - other)))) < order * SAME_YAW


def _distances(model: Shape, seen: Shape, yaws: Array, shifts: Array) -> tuple[Array, Array]:
    """Return the distances (k, m) of the observed samples and of those of the model, m."""
    points = turned(seen.samples[None] - shifts[:, None], -yaws)
    there, _ = model.boundary.nearest(points.reshape(-1, 2))
    points = turned(np.broadcast_to(model.samples, (len(yaws), *model.samples.shape)), yaws)
    back, _ = seen.boundary.nearest((points + shifts[:, None]).reshape(-1, 2))
    return (
        np.linalg.norm(there, axis=1).reshape(len(yaws), -1),
        np.linalg.norm(back, axis=1).reshape(len(yaws), -1),
    )
