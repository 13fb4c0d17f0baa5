"""Cameras above the tray: from pixels to the tray and the robot, and what a pinhole camera sees.

The perspective image of a part depends on where it lies: beside the foot point of the camera, the
sides of the part are seen, too. So each hypothesis is the solid itself, projected to the surface:
first at yaws around the circle, then again at each pose that fits best, until the pose no longer
moves.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.rotations import canonical, rotate
from resting_aspects_ros.vision.boundary import RAYS, turn
from resting_aspects_ros.vision.fitting import (
    MAX_WORSE,
    Fit,
    OutlineNoise,
    Shape,
    mismatch,
)
from resting_aspects_ros.vision.location import Pose, vertical_order
from resting_aspects_ros.vision.outline import rolled, silhouette
from resting_aspects_ros.vision.rolling import (
    REACH,
    KnownPart,
    ViewFit,
    Views,
    view_starts,
    weighted,
)

# -- Homography -----------------------------------------------------------------------------------


MIN_PAIRS = 4
# Points are degenerate if the second smallest singular value of the system of equations is smaller
# than this share of the largest: three points on a line or two equal ones leave a freedom.
DEGENERATE = 1e-4
# Marks farther from the origin of the tray than this, m, are given in another unit.
MAX_DISTANCE = 10.0
# The corners of the largest image, px.
LARGEST_IMAGE = 20_000.0 * np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
MIRRORS = (
    'invalid homography that mirrors the image: expected pixels with u to the right and v down, '
    'seen by a camera above the tray, and points [x, y] with z up; a mirrored image shows a part '
    'as if it were turned over'
)


def find_homography(pixels: npt.ArrayLike, points: npt.ArrayLike) -> Array:
    """Return the homography (3, 3) from the image to the surface, from pairs of points.

    With more than four pairs, the sum of the squared distances on the tray is minimized. The start
    is the direct linear transform of normalized points (Hartley 1997).

    Parameters
    ----------
    pixels : (n, 2) float
        u to the right, v down, px.
    points : (n, 2) float
        The same points in the tray frame, m; z = 0.

    Raises
    ------
    InvalidValueError
        There are fewer than four pairs, the points are degenerate (three of four on one line, or
        equal, or on both sides of the horizon), or the image is mirrored: v is not down, x and y
        are exchanged, or the camera is below the tray. Points of the tray are more than 10 m from
        the origin, and so probably in mm.
    """
    source, target = checked_points('pixels', pixels), checked_points('points', points)
    if len(source) != len(target) or len(source) < MIN_PAIRS:
        raise InvalidValueError(
            f'invalid pairs, {len(source)} pixels and {len(target)} points: expected at least '
            f'{MIN_PAIRS} of each'
        )
    farthest = float(np.abs(target).max())
    if farthest > MAX_DISTANCE:
        raise InvalidValueError(
            f'invalid points up to {farthest:.4g} m from the origin of the tray frame: expected '
            f'at most {MAX_DISTANCE:g} m; they are probably in mm, and must be in m'
        )
    before, after = _normalization(source), _normalization(target)
    a, b = mapped(before, source), mapped(after, target)
    ones, zeros = np.ones((len(a), 1)), np.zeros((len(a), 3))
    u = np.hstack([a, ones])
    rows = np.vstack([np.hstack([u, zeros, -b[:, :1] * u]), np.hstack([zeros, u, -b[:, 1:] * u])])
    _, sizes, vectors = np.linalg.svd(rows)
    if sizes[7] < DEGENERATE * sizes[0]:
        raise _degenerate()
    start = vectors[-1]
    if len(source) > MIN_PAIRS:

        def error(values: Array) -> Array:
            return np.asarray((mapped(values.reshape(3, 3), a) - b).ravel())

        start = least_squares(error, start / np.linalg.norm(start), x_scale='jac').x
    found = start.reshape(3, 3)
    stretch = np.linalg.svd(found, compute_uv=False)
    behind = np.ptp(np.sign(np.column_stack([a, ones]) @ found[2])) != 0
    if stretch[2] < DEGENERATE * stretch[0] or behind:
        raise _degenerate()
    return checked_homography(np.linalg.inv(after) @ found @ before, source)


def _degenerate() -> InvalidValueError:
    return InvalidValueError(
        'invalid point pairs: expected four that are different and of which no three are on one '
        'line, in the same order in the image and on the tray'
    )


def given_points(given: npt.ArrayLike) -> Array:
    """Return points as floats, (n, 2) unless they are no list of points."""
    try:
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.zeros(0)
    # OpenCV gives contours with the shape (n, 1, 2).
    return points[:, 0] if points.ndim == 3 and points.shape[1] == 1 else points


def checked_points(name: str, given: npt.ArrayLike) -> Array:
    """Return points as (n, 2) floats; raises InvalidValueError with the name."""
    points = given_points(given)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise InvalidValueError(
            f'invalid {name} of shape {points.shape}: expected (n, 2) finite numbers'
        )
    return points


def checked_homography(homography: npt.ArrayLike, pixels: Array | None = None) -> Array:
    """Return a homography that is positive, (u, v, 1) -> w > 0, where it does not mirror.

    Its last entry is 1 or -1, if possible. The Jacobian of the mapping has the determinant
    det(H) / w^3, so the pixels on one side of the horizon, w = 0, are mirrored. The homography is
    refused if the pixels (n, 2) that are used are mirrored; by default, if all of an image are.
    """
    found = np.asarray(homography, dtype=np.float64)
    if found.shape != (3, 3) or not np.isfinite(found).all() or np.linalg.det(found) == 0:
        raise InvalidValueError(
            f'invalid homography {shown(found.tolist())}: expected an invertible 3 x 3 matrix'
        )
    found = -found * np.sign(np.linalg.det(found)) / (abs(found[2, 2]) or 1.0)
    used = LARGEST_IMAGE if pixels is None else pixels
    if (np.column_stack([used, np.ones(len(used))]) @ found[2]).max() <= 0:
        raise InvalidValueError(MIRRORS)
    return np.asarray(found)


def mapped(homography: npt.ArrayLike, points: Array) -> Array:
    """Return the images (n, 2) of points (n, 2)."""
    images = np.column_stack([points, np.ones(len(points))]) @ np.asarray(homography).T
    return np.asarray(images[:, :2] / images[:, 2:])


def _normalization(points: Array) -> Array:
    """Return the matrix that moves the mean to 0 and scales the mean distance to sqrt(2)."""
    mean = points.mean(axis=0)
    size = float(np.linalg.norm(points - mean, axis=1).mean()) / np.sqrt(2)
    if size == 0:
        raise _degenerate()
    scaled = np.array([[1, 0, -mean[0]], [0, 1, -mean[1]], [0, 0, size]]) / size
    return np.asarray(scaled, dtype=np.float64)


# -- Camera ---------------------------------------------------------------------------------------


# Maximum deviation of a rotation matrix from an orthonormal one.
RIGID = 1e-6


@dataclass(frozen=True, eq=False)
class Telecentric:
    """A camera whose rays are vertical: heights have no effect.

    homography : (3, 3) float
        Maps (u, v, 1) px to (x, y, 1) m up to a factor.
    """

    homography: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'homography', checked_homography(self.homography))

    def to_tray(self, pixels: npt.ArrayLike) -> Array:
        """Return the points (n, 2) of the surface, m, that are seen at pixels (n, 2).

        Raises InvalidValueError if a pixel is beyond the horizon of the tray, or mirrored.
        """
        given = checked_points('pixels', pixels)
        beyond = np.column_stack([given, np.ones(len(given))]) @ self.homography[2] <= 0
        if beyond.all() and len(given):
            raise InvalidValueError(MIRRORS)
        if beyond.any():
            raise InvalidValueError(
                f'invalid pixel {shown(given[beyond][0].tolist())}: expected pixels that show the '
                'tray, not beyond its horizon'
            )
        return mapped(self.homography, given)

    def to_image(self, points: npt.ArrayLike) -> Array:
        """Return the pixels (n, 2) at which points (n, 2) of the surface, m, are seen."""
        return mapped(np.linalg.inv(self.homography), checked_points('points', points))


@dataclass(frozen=True, eq=False)
class Pinhole(Telecentric):
    """A camera with a centre of projection: high points appear magnified about its foot point.

    homography : (3, 3) float
        Maps (u, v, 1) px to (x, y, 1) m of the surface, up to a factor.
    position : (3,) float
        Centre of projection in the tray frame, m: the foot point x, y and the height H.
    """

    position: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            position = np.asarray(self.position, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            position = np.zeros(0)
        if position.shape != (3,) or not np.isfinite(position).all() or position[2] <= 0:
            given = position.tolist() if position.size else self.position
            raise InvalidValueError(
                f'invalid position of the camera {shown(given)}: expected x, y and a height above '
                '0 m'
            )
        object.__setattr__(self, 'position', position)

    def projected(self, polygon: shapely.Polygon, height: float) -> shapely.Polygon:
        """Return the outline of a part of a height from its image on the surface.

        It is exact if all edges of the silhouette are at ``height``: those of a prism below the
        camera, whose top edge is seen. An edge of the silhouette at another height z is displaced
        radially by at most r (height - z) / H, with its distance r from the foot point; for a
        prism beside the foot point this is r height / H at its near side, where the camera sees
        the bottom edge.

        Parameters
        ----------
        polygon : Polygon
            The image of the part on the surface, m, tray frame.
        height : float
            Height of the edge of the silhouette above the surface, m.

        Raises
        ------
        InvalidValueError
            The height is negative or not below the camera.
        """
        x, y, top = self.position
        if not 0 <= height < top:
            raise InvalidValueError(
                f'invalid height {height:.4g} m: expected 0 or more, and less than the height '
                f'{top:g} m of the camera'
            )
        foot, factor = np.array([x, y]), (top - height) / top
        return shapely.transform(polygon, lambda points: foot + factor * (points - foot))

    def moved(self, foot: npt.ArrayLike) -> 'Pinhole':
        """Return the camera above another point of the surface, m."""
        return Pinhole(self.homography, np.append(foot, self.position[2]))

    def seen(self, points: npt.ArrayLike) -> Array:
        """Return where points (n, 3), m, tray frame, appear on the surface, (n, 2) m."""
        given = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        top = self.position[2]
        if not (given[:, 2] < top).all():
            raise InvalidValueError(
                f'invalid points: expected heights below {top:g} m, the camera'
            )
        foot = self.position[:2]
        return np.asarray(foot + (given[:, :2] - foot) * (top / (top - given[:, 2]))[:, None])


def surface_pinhole(position: npt.ArrayLike) -> Pinhole:
    """Return a pinhole camera at a position (3,), m, whose pixels are points of the surface, m."""
    return Pinhole(np.diag([1.0, -1.0, 1.0]), np.asarray(position, dtype=np.float64))


def transformed_pose(matrix: npt.ArrayLike, pose: Pose) -> Pose:
    """Return a pose in another frame, such as that of the robot.

    Parameters
    ----------
    matrix : (4, 4) float
        Robot from tray: a rotation and a translation, m.
    pose : Pose
        Pose of a part, tray frame.

    Raises
    ------
    InvalidValueError
        The matrix is not that of a rigid motion.
    """
    given = np.asarray(matrix, dtype=np.float64)
    if (
        given.shape != (4, 4)
        or not np.isfinite(given).all()
        or not np.allclose(given[:3, :3] @ given[:3, :3].T, np.eye(3), atol=RIGID)
        or np.linalg.det(given[:3, :3]) < 0
        or not np.allclose(given[3], (0, 0, 0, 1), atol=RIGID)
    ):
        raise InvalidValueError(
            f'invalid transform {shown(given.tolist())}: expected a 4 x 4 matrix of a rotation '
            'and a translation in m, with the last row 0 0 0 1'
        )
    rotation = Rotation.from_matrix(given[:3, :3])
    return Pose(
        pose.aspect,
        given[:3, :3] @ pose.position + given[:3, 3],
        canonical((rotation * Rotation.from_quat(pose.orientation)).as_quat()),
        pose.yaw_known,
    )


# -- What a camera sees ---------------------------------------------------------------------------


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
            (one,) = model.stack.refined(np.zeros(1, np.int64), self._seen, np.array([place.yaw]))
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
