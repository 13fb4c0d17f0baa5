"""The homography that maps the image of the surface to the tray, from pairs of points."""

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.rotations import Array

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


def checked_points(name: str, given: npt.ArrayLike) -> Array:
    """Return points as (n, 2) floats; raises InvalidValueError with the name."""
    try:
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        points = np.zeros(0)
    # OpenCV gives contours with the shape (n, 1, 2).
    if points.ndim == 3 and points.shape[1] == 1:
        points = points[:, 0]
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


def on_tray(homography: Array, pixels: Array) -> Array:
    """Return the points (n, 2) of the tray at pixels (n, 2), m; see checked_homography.

    Raises InvalidValueError if a pixel is beyond the horizon, or mirrored.
    """
    beyond = np.column_stack([pixels, np.ones(len(pixels))]) @ homography[2] <= 0
    if beyond.all() and len(pixels):
        raise InvalidValueError(MIRRORS)
    if beyond.any():
        raise InvalidValueError(
            f'invalid pixel {shown(pixels[beyond][0].tolist())}: expected pixels that show the '
            'tray, not beyond its horizon'
        )
    return mapped(homography, pixels)


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
