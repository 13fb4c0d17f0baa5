"""The convex hull of a part: all of it that a flat surface meets."""

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from resting_aspects_ros.core.errors import PartError

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# Thickness / length below which a mesh is flat: float32 leaves 1e-7 of noise on a flat sheet.
FLAT = 1e-6


def convex_hull(vertices: Array, label: str) -> Array:
    """Return the vertices of the convex hull.

    Parameters
    ----------
    vertices : (n, 3) float64
        m, in lexicographic order, as the result is; so it does not depend on the order of a file.

    Raises
    ------
    PartError
        All vertices lie in a plane or on a line.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scaled = (vertices - middle) / np.ptp(vertices, axis=0).max()
    extents = np.ptp(scaled @ np.linalg.eigh(scaled.T @ scaled)[1], axis=0)
    thick = np.count_nonzero(extents > FLAT)
    try:
        if thick < 3:
            raise QhullError
        return vertices[np.sort(ConvexHull(scaled).vertices)]
    except QhullError:
        where = 'on a line' if thick == 1 else 'in a plane'
        raise PartError(
            f'{label} has no volume: all its {len(vertices)} vertices lie {where}, '
            f'within {FLAT:.0e} of its size'
        ) from None


def outward_hull(hull_vertices: Array) -> tuple[Array, Faces, float]:
    """Return the hull as a closed surface (vertices, outward faces) and its volume, m^3."""
    hull = ConvexHull(hull_vertices)
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(hull_vertices[faces], 1, 0)
    inward = np.einsum('ij,ij->i', np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return hull_vertices, np.where(inward[:, None], faces[:, ::-1], faces), float(hull.volume)
