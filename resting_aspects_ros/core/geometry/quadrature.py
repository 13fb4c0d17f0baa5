"""Points and weights of integrals over triangles."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def triangle_points(number: int) -> tuple[Array, Array]:
    """Return barycentric points (p, 3) and weights (p,) for integrals over a triangle.

    They are products of ``number`` Gauss points on each side of a square that is mapped to the
    triangle, exact for polynomials of degree 2 number - 2. The weights add up to 1; with number 1
    the point is the centroid.
    """
    if number == 1:
        return np.full((1, 3), 1 / 3), np.ones(1)
    nodes, weights = np.polynomial.legendre.leggauss(number)
    nodes, weights = (nodes + 1) / 2, weights / 2
    u, v = (grid.ravel() for grid in np.meshgrid(nodes, nodes))
    across = v * (1 - u)
    share = np.outer(weights, weights).ravel() * (1 - u)
    return np.stack([1 - u - across, u, across], axis=1), share / share.sum()
