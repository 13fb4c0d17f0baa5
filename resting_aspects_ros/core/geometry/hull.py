"""The convex hull of a part: all of it that a flat surface meets."""

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from resting_aspects_ros.core.errors import PartError

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# What float32 leaves between a plane and a vertex on it, as a share of the largest coordinate:
# both are off by up to 6e-8 in each of three directions.
NOISE = 2e-7
# The thickness up to which a mesh is flat, as a share of the largest coordinate; and, wherever it
# lies, of its longest side: less cannot be told from the noise that facets are merged within.
FLAT = 1e-6
THIN = 2e-5


# Noise is taken to grow with the distance from the origin, in sizes of the part, up to here:
# beyond, coordinates that are exact must not be merged, and others are told to be coarse.
MAX_REACH = 50.0


def convex_hull(vertices: Array, label: str) -> tuple[Array, Faces, Array]:
    """Return the corners of the convex hull, its triangles, and their normals.

    Vertices that only noise of float32 lifts out of a facet or an edge are left out, so that a
    part has the same corners in every orientation; all lie inside the hull but for that noise.

    Parameters
    ----------
    vertices : (n, 3) float64
        m, in lexicographic order.

    Returns
    -------
    corners : (k, 3) float64
        m, in lexicographic order; so they do not depend on the order of a file.
    triangles : (f, 3) int64
        Rows of ``corners``, in no order.
    normals : (f, 3) float64
        Of the triangles, outward unit vectors.

    Raises
    ------
    PartError
        All vertices lie in a plane or on a line.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = np.ptp(vertices, axis=0).max()
    scaled = (vertices - middle) / size
    spread = np.linalg.eigh(np.cov(scaled.T))[1]
    extents = np.ptp(scaled @ spread, axis=0)
    reach = min(float(np.abs(vertices).max() / size), MAX_REACH)
    least = max(FLAT * reach, THIN)
    thick = np.count_nonzero(extents > least)
    hull = _qhull(scaled, NOISE * reach) if thick == 3 else None
    if hull is None:
        raise PartError(
            f'{label} has no volume: all its {len(vertices)} vertices lie '
            f'{"on a line" if thick < 2 else "in a plane"}, within {least:.1g} of its longest side'
        )
    corners = np.sort(hull.vertices)
    triangles = np.searchsorted(corners, hull.simplices)
    return vertices[corners], triangles, hull.equations[:, :3]


def _qhull(points: Array, noise: float) -> ConvexHull | None:
    """Let Qhull take the noise for its own of rounding, or do without where that is too much."""
    for options in (f'E{noise:.3e}', ''):
        try:
            return ConvexHull(points, qhull_options=options)
        except QhullError:
            continue
    return None


def outward_hull(hull_vertices: Array) -> tuple[Array, Faces, float]:
    """Return the hull as a closed surface (vertices, outward faces) and its volume, m^3."""
    hull = ConvexHull(hull_vertices)
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(hull_vertices[faces], 1, 0)
    inward = np.einsum('ij,ij->i', np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    return hull_vertices, np.where(inward[:, None], faces[:, ::-1], faces), float(hull.volume)
