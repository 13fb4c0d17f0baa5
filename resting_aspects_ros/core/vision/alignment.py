"""A step of the alignment of points with the boundary of an outline."""

import numpy as np

from resting_aspects_ros.core.rotations import Array


def normal_equations(
    points: Array, ways: Array, normals: Array, scale: float | Array
) -> tuple[Array, Array]:
    """Return the equations of least squares for a turn about the centroid and a shift.

    The turn is multiplied by ``scale``, m, which may be (k,).

    Parameters
    ----------
    points, ways, normals : (k, m, 2) float
        Points, ways to the nearest pieces, and the normals of these, in the frame of the model.

    Returns
    -------
    square : (k, 3, 3) float
    right : (k, 3) float
    """
    off = (ways * normals).sum(axis=2)
    lever = points[..., 0] * normals[..., 1] - points[..., 1] * normals[..., 0]
    lever /= np.reshape(scale, (-1, 1))
    design = np.concatenate([lever[..., None], normals], axis=2)
    number = points.shape[1]
    square = np.einsum('kmi,kmj->kij', design, design) / number + 1e-9 * np.eye(3)
    return square, np.einsum('kmi,km->ki', design, off) / number


def turned(points: Array, yaws: Array) -> Array:
    """Return points (k, m, 2) rotated by yaws (k,)."""
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=2)
