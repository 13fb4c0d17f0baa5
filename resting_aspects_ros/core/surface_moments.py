"""Axes of a part from moments of its surface, which need no closed mesh."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

# Second moments of the surface that differ by less, as a share, may be those of a symmetric
# solid: a tessellation moves them by as much.
ALIKE = 0.02
# Triangles whose points are made at once, so that memory stays flat.
AT_ONCE = 20_000


def surface_frame(triangles: Array) -> tuple[Array, Flags]:
    """Return axes (3, 3), a row each, and which of them no symmetry but a half turn can move.

    Of three matrices that turn with the surface the one that tells most: two second moments,
    weighted by 1 and by r^4, and the mean of r^2 times the position, times itself.
    """
    area, second, sixth, mean = 0.0, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for first in range(0, len(triangles), AT_ONCE):
        points, weights = _quadrature(triangles[first : first + AT_ONCE])
        square = np.einsum('ij,ij->i', points, points)
        area += float(weights.sum())
        second += (weights[:, None] * points).T @ points
        sixth += ((weights * square**2)[:, None] * points).T @ points
        mean += (weights * square) @ points
    moments = [second / area, sixth / area]
    mean /= area
    moments.append(np.outer(mean, mean) / max(float(np.linalg.norm(mean)), ALIKE**2))
    size = float(np.trace(moments[0]))
    best = np.eye(3), np.zeros(3, dtype=bool)
    for moment in moments:
        values, axes = np.linalg.eigh(moment / max(float(np.trace(moment)), size * ALIKE))
        gaps = np.diff(values) > ALIKE
        alone = np.array([gaps[0], gaps.all(), gaps[1]])
        if not best[1].any() or alone.sum() > best[1].sum():
            best = axes.T, alone
    return best


def _quadrature(triangles: Array) -> tuple[Array, Array]:
    """Return points (n, 3) and weights (n,) that integrate degree 6 over triangles.

    Gauss's points of a square, its one side drawn together to a corner, so that a surface has the
    same moments however it is divided.
    """
    at, share = np.polynomial.legendre.leggauss(4)
    u, v = (side.ravel() for side in np.meshgrid((at + 1) / 2, (at + 1) / 2))
    weight = np.outer(share, share).ravel() * v
    barycentric = np.stack([1 - v, v * (1 - u), v * u], axis=1)
    a, b, c = np.moveaxis(triangles, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    weights = np.outer(area, weight).ravel()
    points = np.einsum('qc,mcj->mqj', barycentric, triangles).reshape(-1, 3)
    return points, weights
