"""The silhouette of a mesh: the union of its projected triangles, without effects of rounding."""

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.core.errors import PartError
from resting_aspects_ros.core.vision.sampled_union import sampled_union

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Gaps, slivers and deviations from a straight line up to this, R, are effects of rounding.
ROUNDING = 1e-5
# Coordinates of unions are rounded to this, R. Without a grid, a union can lose a polygon whose
# border differs from that of another one by 1e-16 (GEOS 3.14).
GRID = 1e-9
# Pieces of a silhouette are joined over gaps up to twice this, R, or left out if they are so
# small; holes that are so small are filled.
MAX_GAP = 1e-3
# The union of more triangles is found from samples, at this distance, R.
MANY_TRIANGLES, SAMPLE_STEP = 5_000, MAX_GAP / 2


def silhouette(corners: Array, faces: Indices, closed: bool, radius: float) -> shapely.Polygon:
    """Return the union of the projected triangles of a mesh as a polygon.

    Its exterior is counter-clockwise, its holes are clockwise. Gaps and slivers narrower than
    2 ROUNDING, and vertices closer than ROUNDING to a straight line, are removed. Pieces are
    joined over gaps of up to 2 MAX_GAP. If more than MANY_TRIANGLES are seen, corners are cut and
    gaps and slivers can be missed by up to SAMPLE_STEP.

    Parameters
    ----------
    corners : (n, 3) float
        m, with z up.
    faces : (m, 3) int
    closed : bool
        Whether the mesh is a closed solid with outward faces. Then upward faces are sufficient.
    radius : float
        R, m.

    Raises
    ------
    PartError
        If the silhouette has no area or several pieces.
    """
    plane = corners[:, :2] / radius
    a, b, c = (plane[faces[:, k]] for k in range(3))
    ab, ac = (b - a).T, (c - a).T
    twice = ab[0] * ac[1] - ab[1] * ac[0]
    if not closed:
        faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
        twice = np.abs(twice)
    faces = faces[twice > ROUNDING**2 * 1e-3]
    if len(faces) > MANY_TRIANGLES:
        try:
            return _scaled(_cleaned(sampled_union(plane, faces, SAMPLE_STEP)), radius)
        except PartError:
            pass  # a foil seen from its edge can lie between the samples
    exact = shapely.union_all(shapely.polygons(plane[faces]), grid_size=GRID)
    return _scaled(_cleaned(exact), radius)


def _scaled(outline: shapely.Polygon, factor: float) -> shapely.Polygon:
    return shapely.geometry.polygon.orient(shapely.transform(outline, lambda xy: xy * factor))


def _cleaned(union: shapely.Geometry) -> shapely.Polygon:
    """Return a union, in units of R, as one polygon without effects of rounding."""
    outline = _opened(_closed(union.simplify(ROUNDING), ROUNDING), ROUNDING).simplify(ROUNDING)
    if shapely.get_num_geometries(outline) > 1:
        outline = _closed(outline, MAX_GAP).simplify(ROUNDING)
        pieces = shapely.get_parts(outline)
        large = pieces[shapely.area(pieces) > MAX_GAP**2]
        outline = large[0] if len(large) == 1 else outline
    if outline.is_empty:
        raise PartError('invalid outline: expected an area, but the mesh is seen from its edge')
    if not isinstance(outline, shapely.Polygon):
        raise PartError(
            f'invalid outline of {shapely.get_num_geometries(outline)} separate pieces: '
            f'expected a part whose outline is connected'
        )
    holes = [hole for hole in outline.interiors if shapely.Polygon(hole).area > MAX_GAP**2]
    return shapely.Polygon(outline.exterior, holes)


def _closed(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, gap), -gap)


def _opened(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, -gap), gap)


def _offset(shape: shapely.Geometry, distance: float) -> shapely.Geometry:
    moved = shape.buffer(distance, join_style='mitre')
    if abs(moved.area - shape.area) > 2 * abs(distance) * shape.length:
        # A polygon was lost, as in a union without a grid.
        moved = shapely.set_precision(shape, GRID).buffer(distance, join_style='mitre')
    return moved
