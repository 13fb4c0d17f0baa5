"""Orientations of a part: unit quaternions in the order x, y, z, w with w >= 0, tray from part."""

import warnings
from typing import Any, Protocol

import numpy as np

from resting_aspects_ros.arrays import Array

# Maximum deviation of the length of a quaternion from 1. Rounding to four decimals causes 1e-4.
LENGTH_TOLERANCE = 1e-3
# Maximum deviation of the cosine between two directions that are aligned.
ALIGNED = 1e-9


class Random(Protocol):
    """Independent random numbers, such as those of numpy's Generator."""

    def random(self, shape: Any, /) -> Any:
        """Return numbers that are uniform between 0 and 1."""

    def standard_normal(self, shape: Any, /) -> Any:
        """Return numbers from the standard normal distribution."""


def canonical(xyzw: Array) -> Array:
    """Return rotations (n, 4), of any length but zero, as unit quaternions with w >= 0."""
    unit = xyzw / np.linalg.norm(xyzw, axis=-1, keepdims=True)
    return np.asarray(np.where(unit[..., 3:] < 0, -unit, unit))


def composed(first: Array, second: Array) -> Array:
    """Return unit quaternions (n, 4) of the rotation ``second`` (4,) followed by ``first`` (n, 4).

    The result is bit for bit that of SciPy's Rotation.
    """
    return _unit(_product(_unit(first), second))


def product(first: Array, second: Array) -> Array:
    """Return unit quaternions (n, 4) of the rotations ``second``, each followed by ``first``.

    Row by row, so that the result of a row does not depend on the number of rows.
    """
    return canonical(_product(first, second))


def _product(first: Array, second: Array) -> Array:
    a, b, c, w = first.T
    x, y, z, v = second.T
    rows = (
        w * x + v * a + (b * z - c * y),
        w * y + v * b + (c * x - a * z),
        w * z + v * c + (a * y - b * x),
        w * v - a * x - b * y - c * z,
    )
    return np.stack(rows, axis=-1)


def _unit(xyzw: Array) -> Array:
    x, y, z, w = xyzw.T
    return np.asarray(xyzw / np.sqrt(x * x + y * y + z * z + w * w)[:, None])


def random_orientations(random: Random, n: int) -> Array:
    """Return quaternions (n, 4) that are independent and uniform on SO(3) (Haar measure).

    A normal vector in four dimensions has no preferred direction, so its direction is uniform on
    the unit quaternions (Muller 1959).
    """
    return canonical(random.standard_normal((n, 4)))


def down_in_part(xyzw: Array, normal: Array | None = None) -> Array:
    """Return the directions (..., 3) of gravity in the part frame, for orientations (..., 4).

    With the unit normal (3,) of an inclined plane, tray frame, the directions towards the plane,
    for orientations (n, 4).
    """
    if normal is not None:
        return -rotate(xyzw * [-1, -1, -1, 1], normal)
    # Gravity is -z in the tray; in the part it is minus the third row of the rotation matrix.
    x, y, z, w = np.moveaxis(np.asarray(xyzw, dtype=np.float64), -1, 0)
    row = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return -np.stack(row, axis=-1)


def angle_between(a: Array, b: Array) -> Array:
    """Return angles (...) between unit vectors (..., 3), rad, accurate also near 0 and pi."""
    difference, total = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return np.asarray(2 * np.arctan2(difference, total))


def orientation_with_down(down: Array) -> Array:
    """Return the shortest rotation (4,), tray from part, that makes ``down`` (3,) point down."""
    return rotation_between(down, np.array([0.0, 0.0, -1.0]))


def rotation_between(one: Array, other: Array) -> Array:
    """Return the shortest rotation, a quaternion (4,), that turns a unit vector into another."""
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        # SciPy before 1.12 warns that other rotations align the vectors as well.
        warnings.simplefilter('ignore', UserWarning)
        found = canonical(Rotation.align_vectors(other[None], one[None])[0].as_quat())
    if rotate(found, one) @ other > 1 - ALIGNED:
        return found
    # SciPy before 1.13 does not turn a vector into its opposite.
    axis, w = np.cross(one, other), 1 + float(one @ other)
    if w < ALIGNED:
        axis, w = np.cross(one, np.eye(3)[np.abs(one).argmin()]), 0.0
    return canonical(np.array([*axis, w]))


def rotate(xyzw: Array, points: Array) -> Array:
    """Return points (3,) or (n, 3) rotated by unit quaternions (4,) or (n, 4)."""
    # Element by element, because the rounding of SciPy's apply depends on the number of points:
    # the position of a drop would depend on the number of drops in the run.
    x, y, z, w = np.asarray(xyzw).T
    a, b, c = np.asarray(points).T
    # Twice axis x point; np.cross would take longer than all other operations.
    u, v, n = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return np.stack(
        [
            a + w * u + (y * n - z * v),
            b + w * v + (z * u - x * n),
            c + w * n + (x * v - y * u),
        ],
        axis=-1,
    )


def turned_about_vertical(xyzw: Array, angle: float) -> Array:
    """Return the orientation (4,) after a rotation of ``xyzw`` about the vertical, rad."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    return canonical((turn * Rotation.from_quat(xyzw)).as_quat())


def turned_down(xyzw: Array, down: Array) -> Array:
    """Return orientations (n, 4), rotated by the minimum that makes the directions point down.

    ``down`` are unit vectors (n, 3), part frame; none of them may point up in its orientation.
    """
    now = rotate(xyzw, down)
    # From u to -z the axis is u x -z; the quaternion (axis, 1 + u . -z) is not normalized.
    x, y, w = -now[:, 1], now[:, 0], 1 - now[:, 2]
    a, b, c, d = xyzw.T
    turned = (w * a + x * d + y * c, w * b - x * c + y * d, w * c + x * b - y * a)
    return canonical(np.stack([*turned, w * d - x * a - y * b], axis=-1))
