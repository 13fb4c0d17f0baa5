"""The convex hull of a part, which is all that a flat surface can touch."""

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from resting_aspects_ros.core.errors import PartError

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# Distance between a plane and a vertex on it due to float32, as a share of the largest coordinate:
# both have errors of up to 6e-8 in each of three directions.
NOISE = 2e-7
# Maximum thickness of a flat mesh, as a share of the largest coordinate, and of its longest side.
# A smaller thickness cannot be distinguished from the tolerance within which facets are merged.
FLAT = 1e-6
THIN = 2e-5


# Maximum distance from the origin, in sizes of the part, up to which the noise is assumed to grow.
# Further away, exact coordinates must not be merged; for others there is a warning that they are
# coarse.
MAX_REACH = 50.0
# Maximum difference of the areas of rectangles that count as equal, as a share. All rectangles
# along the sides of an acute or a right triangle have the same area.
SAME_AREA = 1e-5


def convex_hull(vertices: Array, label: str) -> tuple[Array, Faces, Array]:
    """Return the corners of the convex hull, its triangles, and their normals.

    Vertices that are outside a facet or an edge only by the noise of float32 are omitted, so that
    a part has the same corners in every orientation. All vertices are inside the hull up to the
    noise.

    Parameters
    ----------
    vertices : (n, 3) float64
        m, in lexicographic order.

    Returns
    -------
    corners : (k, 3) float64
        m, in lexicographic order, independent of the order in the file.
    triangles : (f, 3) int64
        Rows of ``corners``, unordered.
    normals : (f, 3) float64
        Outward unit normals of the triangles.

    Raises
    ------
    PartError
        If all vertices are in a plane or on a line.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = np.ptp(vertices, axis=0).max()
    scaled = (vertices - middle) / size
    spread = np.linalg.eigh(np.cov(scaled.T))[1]
    extents = np.ptp(scaled @ spread, axis=0)
    reach = min(float(np.abs(vertices).max() / size), MAX_REACH)
    min_extent = max(FLAT * reach, THIN)
    dimensions = np.count_nonzero(extents > min_extent)
    hull = _qhull(scaled, NOISE * reach) if dimensions == 3 else None
    if hull is None:
        raise PartError(
            f'{label} has no volume: all its {len(vertices)} vertices lie '
            f'{"on a line" if dimensions < 2 else "in a plane"}, '
            f'within {min_extent:.1g} of its longest side'
        )
    corners = np.sort(hull.vertices)
    triangles = np.searchsorted(corners, hull.simplices)
    return vertices[corners], triangles, hull.equations[:, :3]


def _qhull(points: Array, noise: float) -> ConvexHull | None:
    """Return the hull with the noise as rounding error of Qhull, or without it if that fails."""
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


def smallest_rectangle(points: Array) -> tuple[Array, Array]:
    """Return the middle and the sides of the rectangle of minimum area around points of a plane.

    Of several with this area, it is the one with the shortest perimeter, and of these the one
    whose longer side has the smallest angle, from 0 to pi. So it does not depend on rounding.

    Parameters
    ----------
    points : (n, 2) float64
        m, not on a line.

    Returns
    -------
    middle : (2,) float64
        m.
    sides : (2, 2) float64
        The longer and the shorter side as vectors, m.
    """
    corners = points[ConvexHull(points).vertices]
    edges = np.diff(corners, axis=0, append=corners[:1])
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    axes = np.stack([edges, np.column_stack([-edges[:, 1], edges[:, 0]])], axis=1)
    places = axes @ corners.T
    sizes = np.ptp(places, axis=2)
    across = sizes[:, 0] < (1 - SAME_AREA) * sizes[:, 1]
    angles = np.arctan2(*edges.T[::-1]) + np.pi / 2 * across
    keys = np.round(angles % np.pi, 5) % np.round(np.pi, 5)
    for key in (sizes.prod(axis=1), sizes.sum(axis=1)):
        best = key[np.isfinite(keys)].min()
        keys[key > (1 + SAME_AREA) * best] = np.inf
    k = keys.argmin()
    middle = (places[k].min(axis=1) + places[k].max(axis=1)) / 2 @ axes[k]
    sides = sizes[k][:, None] * axes[k]
    return middle, sides[::-1] if across[k] else sides
