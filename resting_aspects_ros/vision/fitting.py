"""Fit of outlines to seen ones: poses of least squares, residuals, and their probability."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from operator import attrgetter

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from shapely import affinity
from shapely.geometry.polygon import orient

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.vision.boundary import (
    RAYS,
    ROUGH,
    SAME,
    Boundary,
    common_area,
    nearest_on_pieces,
    normal_equations,
    placed,
    turn,
    turned,
)

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
    def spectrum(self) -> Array:
        """Fourier transform of the signature of the boundary."""
        return np.asarray(np.fft.rfft(self.boundary.signature))

    @cached_property
    def squares(self) -> Array:
        """(2,) float: sums of the squares of the signature."""
        return np.asarray((self.boundary.signature**2).sum(axis=1))

    @cached_property
    def stack(self) -> 'ShapeStack':
        """The shape alone, for fits."""
        return ShapeStack([self])


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
        return overlap_at(model, seen, self.yaw, np.array([self.x, self.y]))


def overlap_at(model: shapely.Polygon, seen: shapely.Polygon, yaw: float, move: Array) -> float:
    """Return the intersection over the union, the model being rotated, rad, and moved, m."""
    common = common_area(placed(model, float(move[0]), float(move[1]), yaw), seen)
    return common / (float(model.area) + float(seen.area) - common)


@lru_cache(maxsize=256)
def shape_of(polygon: shapely.Polygon) -> Shape:
    """Return the shape of a polygon; the latest ones are kept."""
    return Shape(polygon)


class ShapeStack:
    """The boundaries and samples of several shapes, for fits of many at once."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        boundaries = [shape.boundary for shape in shapes]
        first = np.cumsum([0, *(len(each.points) for each in boundaries)])
        self._points = np.concatenate([each.points for each in boundaries])
        self._along = np.concatenate([each.along for each in boundaries])
        self._squares = np.concatenate([each.squares for each in boundaries])
        self._normals = np.concatenate([each.normals for each in boundaries])
        self._sides = np.concatenate(
            [each.sides + k for each, k in zip(boundaries, first[:-1], strict=True)], axis=1
        )
        self._scale = np.array([each.radius for each in boundaries])
        self._centres = np.array([each.centre for each in boundaries])
        self._samples = [shape.samples for shape in shapes]
        # Points to be aligned are closer to their shape than to the next one.
        self._step = np.array([[10 * float(self._scale.max()), 0.0]])
        owner = np.repeat(np.arange(len(shapes)), np.diff(first))
        self._tree = cKDTree(self._points + owner[:, None] * self._step)

    def refined(
        self,
        which: Indices,
        seen: Shape,
        yaws: Array,
        iterations: int = ITERATIONS,
        most: int | None = None,
    ) -> list[Fit]:
        """Return the fit of each of the shapes ``which`` (j,) near a yaw (j,), rad.

        They minimize the squared distances of the seen samples to the lines of the nearest pieces
        of the shapes (Chen and Medioni 1992). After one step, only the ``most`` nearest ones are
        refined further.
        """
        shifts = np.zeros((len(yaws), 2))
        some = seen.samples[::EVERY]
        for step in range(iterations + 1):
            points = turned(some[None] - shifts[:, None], -yaws)
            way, piece = self._nearest(which, points)
            if step == 1 and most is not None and len(yaws) > most:
                nearest = (way**2).sum(axis=(1, 2))
                kept = np.sort(np.argsort(nearest, kind='stable')[:most])
                which, yaws, shifts = which[kept], yaws[kept], shifts[kept]
                points, way, piece = points[kept], way[kept], piece[kept]
            scale = self._scale[which]
            square, right = normal_equations(points, way, self._normals[piece], scale)
            if step < iterations:
                moved = np.asarray(np.linalg.solve(square, right[..., None]), np.float64)[..., 0]
                shifts = shifts - turned(moved[:, None, 1:], yaws)[:, 0]
                yaws = yaws - moved[:, 0] / scale
        stiffness = scale**2 / np.linalg.inv(square)[:, 0, 0]
        there, _ = self._nearest(which, turned(seen.samples[None] - shifts[:, None], -yaws))
        found = []
        for k, back in enumerate(self._backs(which, seen, yaws, shifts)):
            one = (there[k] ** 2).sum(axis=1)
            x, y = seen.boundary.centre + shifts[k] - turn(yaws[k]) @ self._centres[which[k]]
            found.append(
                Fit(
                    float(np.angle(np.exp(1j * yaws[k]))),
                    float(x),
                    float(y),
                    float((one.mean() + back.mean()) / 2),
                    float(np.sqrt(max(one.max(), back.max()))),
                    float(stiffness[k]),
                )
            )
        return found

    def _nearest(self, which: Indices, points: Array) -> tuple[Array, Indices]:
        """Return the ways (j, m, 2) from points (j, m, 2) to shapes, and the pieces (j, m)."""
        flat = points.reshape(-1, 2)
        owner = np.repeat(which, points.shape[1])
        near = self._tree.query(flat + owner[:, None] * self._step)[1]
        way, piece = nearest_on_pieces(
            flat, self._sides[:, near], self._points, self._along, self._squares
        )
        return way.reshape(points.shape), piece.reshape(points.shape[:2])

    def _backs(self, which: Indices, seen: Shape, yaws: Array, shifts: Array) -> list[Array]:
        """Return the squared distances of the samples of each shape from the seen boundary."""
        samples = [self._samples[k] for k in which]
        ends = np.cumsum([0, *map(len, samples)])
        owner = np.repeat(np.arange(len(which)), np.diff(ends))
        moved = turned(np.concatenate(samples)[:, None], yaws[owner])[:, 0] + shifts[owner]
        square = (seen.boundary.nearest(moved)[0] ** 2).sum(axis=1)
        return [square[a:b] for a, b in pairwise(ends)]


def fit(model: Shape, seen: Shape, order: int = 1) -> tuple[Fit, ...]:
    """Return the fits of a model to a seen outline, the least residual first.

    ``order`` is the yaw symmetry of the model (0: round): of solutions that differ by a rotation
    of the model onto itself, one is returned.
    """
    yaws = candidate_yaws(model, seen, order)
    which = np.zeros(len(yaws), dtype=np.int64)
    found: list[Fit] = []
    for one in sorted(
        model.stack.refined(which, seen, yaws, most=MAX_YAWS), key=attrgetter('square')
    ):
        if not any(_same(one.yaw, other.yaw, order) for other in found):
            found.append(one)
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
    count = max(3, round(density * ring.length))
    places = (np.arange(count) + 0.5) / count
    points = shapely.line_interpolate_point(ring, places, normalized=True)
    return np.asarray(shapely.get_coordinates(points))


def _moment(ring: shapely.LinearRing, centre: Array) -> float:
    """Return the polar moment of the area inside a ring, negative if it is clockwise, m^4."""
    points = shapely.get_coordinates(ring) - centre
    a, b = points[:-1], points[1:]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return float((cross * ((a**2 + a * b + b**2).sum(axis=1))).sum() / 12)


def _same(one: float, other: float, order: int) -> bool:
    return order == 0 or abs(np.angle(np.exp(1j * order * (one - other)))) < order * SAME_YAW


# -- Matches --------------------------------------------------------------------------------------


# Yaw, rad, and shift (2,) of the centroid of a model relative to that of the seen outline, m.
Pose = tuple[float, Array]

# If the overlap after the best fit is below ALIKE, the outlines differ. The overlap is then
# computed at YAWS yaws and maximized from the best TRIES of them, in steps of START (rad, and
# radii), with outlines that are simplified to within COARSE, radii. Of overlaps that are equal
# within EQUAL, the one with the closest boundaries counts.
ALIKE, YAWS, TRIES, START, COARSE, EQUAL = 0.9, 36, 4, 0.1, 1e-3, 2e-3


def same_outline(model: shapely.Polygon, seen: shapely.Polygon, play: float = 0.0) -> bool:
    """Return whether two outlines are equal after some rotation and translation.

    Their boundaries are closer than SAME times the larger radius about the centroid, in addition
    to the effect of the tessellation and to ``play``, m.
    """
    one, other = shape_of(model), shape_of(seen)
    a, b = one.boundary, other.boundary
    # Boundaries that are so close enclose areas that differ by at most this times a perimeter.
    reach = SAME * max(a.radius, b.radius) + play + a.skins.max() + b.skins.max()
    if abs(one.area - other.area) > 1.1 * reach * max(one.perimeter, other.perimeter):
        return False
    return any(a.equals(b, *_pose(each, one, other), play) for each in fit(one, other))


def best_overlap(model: shapely.Polygon, seen: shapely.Polygon) -> tuple[float, float]:
    """Return the maximum intersection over union over all yaws and positions, and the distance.

    The distance is the symmetric Hausdorff distance of the boundaries, with their holes, in that
    pose, m.
    """
    one, other = (_simplified(each, ROUGH) for each in (model, seen))
    poses = [_pose(each, one, other) for each in fit(one, other)]
    # Outlines that differ may overlap more if only their centroids coincide.
    yaw = float(candidate_yaws(one, other)[0])
    poses.append((yaw, np.zeros(2)))
    found = [(_overlap(one, other, *pose), pose) for pose in poses]
    highest = max(overlap for overlap, _ in found)
    if highest < ALIKE:
        a, b = (_simplified(each, COARSE) for each in (model, seen))
        yaws = (yaw + 2 * np.pi * np.arange(YAWS) / YAWS).tolist()
        starts = sorted(yaws, key=lambda angle: -_overlap(a, b, angle, np.zeros(2)))[:TRIES]
        # With one outline inside the other, many positions have the same overlap.
        tried = [(angle, np.zeros(2)) for angle in starts]
        tried += [_pose_of_maximum_overlap(a, b, angle) for angle in starts]
        found += [(_overlap(one, other, *pose), pose) for pose in tried]
        highest = max(overlap for overlap, _ in found)
    ends = [row for row in found if row[0] >= highest - EQUAL]
    return highest, min(_distance(one, other, *pose) for _, pose in ends)


def _simplified(polygon: shapely.Polygon, tolerance: float) -> Shape:
    """Return the shape of a polygon without points that move its boundary by less, radii."""
    radius = shape_of(polygon).boundary.radius
    simple = polygon.simplify(tolerance * radius)
    return shape_of(simple if isinstance(simple, shapely.Polygon) else polygon)


def mirrored(polygon: shapely.Polygon) -> shapely.Polygon:
    """Return the mirror image of a polygon: x remains, y changes its sign."""
    return shapely.geometry.polygon.orient(affinity.scale(polygon, 1.0, -1.0, origin=(0, 0)))


def _pose(found: Fit, model: Shape, seen: Shape) -> Pose:
    moved = turn(found.yaw) @ model.boundary.centre - seen.boundary.centre
    return found.yaw, np.array([found.x, found.y]) + moved


def _overlap(model: Shape, seen: Shape, yaw: float, shift: Array) -> float:
    """Return the intersection over union."""
    move = seen.boundary.centre + shift - turn(yaw) @ model.boundary.centre
    return overlap_at(model.polygon, seen.polygon, yaw, move)


def _pose_of_maximum_overlap(model: Shape, seen: Shape, yaw: float) -> Pose:
    """Return the pose of the local maximum of the overlap near a yaw."""
    scale = model.boundary.radius

    def loss(step: Array) -> float:
        return -_overlap(model, seen, yaw + step[0], scale * step[1:])

    simplex = START * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    best = minimize(
        loss,
        np.zeros(3),
        method='Nelder-Mead',
        options={'initial_simplex': simplex, 'xatol': 1e-3, 'fatol': 1e-4},
    )
    return yaw + float(best.x[0]), scale * best.x[1:]


def _distance(model: Shape, seen: Shape, yaw: float, shift: Array) -> float:
    """Return the symmetric Hausdorff distance of the boundaries, m."""
    matrix, one, other = turn(yaw), model.boundary, seen.boundary
    there, _ = other.nearest(one.points @ matrix.T + shift)
    back, _ = one.nearest((other.points - shift) @ matrix)
    return float(np.linalg.norm(np.concatenate([there, back]), axis=1).max())


# -- Probability ----------------------------------------------------------------------------------


# Standard deviations of the noise that are possible for a known outline: log-normal around the
# given one with this factor, within these multiples of it.
UNCERTAIN, MIN_NOISE, MAX_NOISE = 2.0, 0.25, 1.5
# The least deviation of an unknown outline, as a multiple of the noise.
MIN_UNKNOWN = 2.0


@dataclass(frozen=True)
class OutlineNoise:
    """Errors of the boundary of an observed polygon.

    sd : float
        Standard deviation normal to the boundary, m: noise, resolution, calibration, lighting.
    correlation : float
        Distance along the boundary after which errors are independent, m: the integral of their
        autocorrelation from minus to plus infinity.
    """

    sd: float = 1e-4
    correlation: float = 1e-3

    def __post_init__(self) -> None:
        values = {'standard deviation': self.sd, 'correlation length': self.correlation}
        for name, value in values.items():
            if not 1e-7 <= value <= 0.1:
                raise InvalidValueError(
                    f'invalid {name} of the noise {shown(value)} m: expected 1e-7 to 0.1 m'
                )


def known_likelihood(
    one: Fit, model: Shape, order: int, noise: OutlineNoise, count: float
) -> float:
    """Return the log likelihood of a known outline, the noise and the yaw integrated out."""
    factors = np.geomspace(MIN_NOISE, MAX_NOISE, 10)
    weights = -0.5 * (np.log(factors) / np.log(UNCERTAIN)) ** 2
    return _integrated(one, model, order, noise.sd * factors, weights, noise, count)


def unknown_likelihood(
    one: Fit, model: Shape, noise: OutlineNoise, count: float, size: float
) -> float:
    """Return the log likelihood of an unknown outline, whose most similar known one is given."""
    largest = max(size / 2, 2 * MIN_UNKNOWN * noise.sd)
    levels = np.geomspace(MIN_UNKNOWN * noise.sd, largest, 40)
    return _integrated(one, model, 1, levels, np.zeros(40), noise, count)


def _integrated(
    one: Fit,
    model: Shape,
    order: int,
    levels: Array,
    weights: Array,
    noise: OutlineNoise,
    count: float,
) -> float:
    """Return the log of the mean likelihood over standard deviations, m, with log weights."""
    likelihood = -count * one.square / (2 * levels**2) - count * np.log(levels / noise.sd)
    least = (model.boundary.radius * 1e-3) ** 2
    width = levels * np.sqrt(2 * np.pi / (count * max(one.stiffness, least)))
    yaw = np.log(np.minimum(max(order, 1) * width / (2 * np.pi), 1.0)) if order else 0.0
    return log_sum(likelihood + yaw + weights) - log_sum(weights)


def log_sum(logs: npt.ArrayLike) -> float:
    """Return the logarithm of a sum, from the logarithms of its terms."""
    given = np.asarray(logs)
    return float(given.max() + np.log(np.exp(given - given.max()).sum()))
