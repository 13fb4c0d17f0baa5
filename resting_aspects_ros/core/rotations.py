"""Orientations of a part: unit quaternions in the order x, y, z, w with w >= 0, tray from part.

The one place where quaternions are made, brought to canonical form, and turned into directions.
SciPy is imported where it is needed: worker processes use this module without it, and start in a
fraction of the time.
"""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# How far the length of a quaternion may be from 1: four decimals of its numbers leave 1e-4.
LENGTH_TOLERANCE = 1e-3


def wxyz_from_xyzw(xyzw: Array) -> Array:
    """Reorder quaternions (..., 4) from x, y, z, w to w, x, y, z."""
    return np.roll(xyzw, 1, axis=-1)


def xyzw_from_wxyz(wxyz: Array) -> Array:
    """Reorder quaternions (..., 4) from w, x, y, z to x, y, z, w."""
    return np.roll(wxyz, -1, axis=-1)


def canonical(xyzw: Array) -> Array:
    """The same rotations (n, 4), given with any length but zero, as unit quaternions, w >= 0."""
    unit = xyzw / np.linalg.norm(xyzw, axis=-1, keepdims=True)
    return np.asarray(np.where(unit[..., 3:] < 0, -unit, unit))


def composed(first: Array, second: Array) -> Array:
    """(n, 4) unit quaternions of the unit rotation ``second`` (4,) followed by ``first`` (n, 4).

    Number by number as SciPy's Rotation does, bit for bit.
    """
    a, b, c, w = _unit(first).T
    x, y, z, v = second
    product = (
        w * x + v * a + (b * z - c * y),
        w * y + v * b + (c * x - a * z),
        w * z + v * c + (a * y - b * x),
        w * v - a * x - b * y - c * z,
    )
    return _unit(np.stack(product, axis=-1))


def _unit(xyzw: Array) -> Array:
    x, y, z, w = xyzw.T
    return np.asarray(xyzw / np.sqrt(x * x + y * y + z * z + w * w)[:, None])


def random_orientations(generator: np.random.Generator, n: int) -> Array:
    """(n, 4) quaternions, independent and uniform on SO(3) (Haar).

    A normal vector in four dimensions has no preferred direction, so its direction is uniform
    on the unit quaternions (Muller 1959).
    """
    return canonical(generator.standard_normal((n, 4)))


def down_in_part(xyzw: Array) -> Array:
    """(n, 3) unit vectors of gravity seen from the part: what is left of a pose without yaw."""
    # Gravity is -z in the tray; in the part it is minus the third row of the rotation matrix.
    x, y, z, w = np.moveaxis(np.asarray(xyzw, dtype=np.float64), -1, 0)
    row = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return -np.stack(row, axis=-1)


def angle_between(a: Array, b: Array) -> Array:
    """(...) angles between unit vectors (..., 3), rad; exact for small and large ones alike."""
    apart, along = np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)
    return np.asarray(2 * np.arctan2(apart, along))


def orientation_with_down(down: Array) -> Array:
    """(4,) quaternion, tray from part, that turns ``down`` (3,), part frame, to point down.

    The shortest such turn; a turn about the vertical could be added at will.
    """
    from scipy.spatial.transform import Rotation

    rotation, _ = Rotation.align_vectors(np.array([[0.0, 0.0, -1.0]]), down[None, :])
    return canonical(rotation.as_quat())


def rotate(xyzw: Array, points: Array) -> Array:
    """(n, 3) points turned by unit quaternions (4,) or (n, 4)."""
    # Number by number: SciPy's apply rounds by the number of points, so that a drop's position
    # would depend on how many others are asked for (rule 1).
    x, y, z, w = np.asarray(xyzw).T
    a, b, c = np.asarray(points).T
    # A turn by twice axis x point; np.cross takes longer than all the rest.
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
    """(4,) orientation of a part with orientation ``xyzw`` after a turn by ``angle``, rad."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    return canonical((turn * Rotation.from_quat(xyzw)).as_quat())


def turned_down(xyzw: Array, down: Array) -> Array:
    """(n, 4) orientations turned by as little as makes the given directions point down.

    Parameters
    ----------
    xyzw : (n, 4) float
        Unit quaternions, tray from part.
    down : (n, 3) float
        Unit vectors, part frame; none of them points up now.
    """
    now = rotate(xyzw, down)
    # From u to -z: the axis is u x -z, and the quaternion (axis, 1 + u . -z) of twice its length.
    x, y, w = -now[:, 1], now[:, 0], 1 - now[:, 2]
    a, b, c, d = xyzw.T
    turned = (w * a + x * d + y * c, w * b - x * c + y * d, w * c + x * b - y * a)
    return canonical(np.stack([*turned, w * d - x * a - y * b], axis=-1))
