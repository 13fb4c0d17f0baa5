"""Check the polygons that a vision system sends, in the tray frame and in m."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.schema import FileModel, validated

# Bounds of the extent of a polygon, m. Parts are larger than the first and lie on a tray.
MIN_EXTENT, MAX_EXTENT = 1e-5, 2.0
# Maximum distance of a polygon from the origin of the tray frame, m.
MAX_DISTANCE = 100.0
MAX_POINTS, MAX_HOLES = 100_000, 1000
# Maximum share of the area that the repair of a self-crossing polygon may change.
MAX_REPAIR = 0.01
# Reasons of GEOS for which a polygon with holes is not repaired.
MISPLACED_HOLES = ('hole lies outside shell', 'holes are nested')


class _Rings(FileModel):
    """The keys of a polygon."""

    outer: Any
    holes: Any = ()


Polygonal: TypeAlias = shapely.Polygon | Mapping[str, Any] | npt.ArrayLike


def observed_polygon(given: Polygonal) -> shapely.Polygon:
    """Return a valid polygon, the exterior counter-clockwise and the holes clockwise.

    Parameters
    ----------
    given : shapely.Polygon, (n, 2) array, or mapping
        A polygon, the points of its outer boundary, or a mapping with ``outer`` and, optionally,
        ``holes``, a list of (m, 2) arrays; m, tray frame (x right, y up seen from above). The
        direction and the first of the points are not significant; an edge from the last point to
        the first closes a boundary, whether the first point is repeated at the end or not.

    Raises
    ------
    InvalidValueError
        The mapping has other keys, or the polygon crosses itself (unless a repair changes its
        area by at most 1 %), is empty, tiny or huge, is probably in pixels or millimetres, has too
        many points, or has coordinates that are not finite numbers.
    """
    outer, holes = _rings(given)
    if len(holes) > MAX_HOLES:
        raise InvalidValueError(
            f'invalid number of holes {len(holes)}: expected at most {MAX_HOLES}'
        )
    ring = _ring('outer boundary', outer)
    _check_extent(ring)
    inner = [_ring(f'hole {k}', hole) for k, hole in enumerate(holes, start=1)]
    total = len(ring) + sum(map(len, inner))
    if total > MAX_POINTS:
        raise InvalidValueError(
            f'invalid polygon of {total} points: expected at most {MAX_POINTS}'
        )
    polygon = shapely.Polygon(ring, inner)
    if not polygon.is_valid:
        polygon = _repaired(polygon, ring, inner)
    if polygon.area < MIN_EXTENT**2:
        raise InvalidValueError(
            f'invalid polygon with an area of {polygon.area:.3g} m^2: expected a polygon that '
            f'encloses at least {MIN_EXTENT**2:g} m^2'
        )
    return orient(polygon)


def _rings(given: Polygonal) -> tuple[Any, list[Any]]:
    """Return the outer ring and the holes."""
    if isinstance(given, shapely.Polygon):
        return shapely.get_coordinates(given.exterior), [
            shapely.get_coordinates(hole) for hole in given.interiors
        ]
    if isinstance(given, shapely.Geometry):
        raise InvalidValueError(f'invalid polygon of type {given.geom_type}: expected one Polygon')
    if isinstance(given, Mapping):
        holes = given.get('holes', ())
        if 'outer' not in given or not isinstance(holes, list | tuple | np.ndarray):
            raise InvalidValueError(
                f'invalid polygon {shown(given)}: expected outer, a list of points, and '
                'optionally holes, a list of such lists'
            )
        validated(_Rings, given)
        return given['outer'], list(holes)
    return given, []


def _ring(name: str, points: Any) -> Array:
    """Return the points (n, 2) of a ring without repeated ones."""
    try:
        ring = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        ring = np.zeros(0)
    # OpenCV gives contours with the shape (n, 1, 2).
    if ring.ndim == 3 and ring.shape[1] == 1:
        ring = ring[:, 0]
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise InvalidValueError(
            f'invalid {name} {shown(points)}: expected a list of points [x, y] in m'
        )
    if len(ring) > MAX_POINTS + 1:
        raise InvalidValueError(
            f'invalid {name} of {len(ring)} points: expected at most {MAX_POINTS}'
        )
    bad = ~np.isfinite(ring).all(axis=1)
    if bad.any():
        k = int(bad.argmax())
        raise InvalidValueError(
            f'invalid point {k + 1} {shown(ring[k].tolist())} of the {name}: expected finite '
            'numbers'
        )
    closed = len(ring) > 1 and bool((ring[0] == ring[-1]).all())
    different = np.ones(len(ring), dtype=np.bool_)
    different[1:] = (ring[1:] != ring[:-1]).any(axis=1)
    ring = ring[different]
    if len(ring) - closed < 3:
        raise InvalidValueError(
            f'invalid {name} of {max(len(ring) - closed, 0)} different points: expected at least 3'
        )
    return ring


def _check_extent(ring: Array) -> None:
    size = np.ptp(ring, axis=0)
    extent = float(size.max())
    if extent < MIN_EXTENT:
        raise InvalidValueError(
            f'invalid polygon {extent:.3g} m long: expected at least {MIN_EXTENT:g} m'
        )
    if extent > MAX_EXTENT:
        raise InvalidValueError(
            f'invalid polygon {extent:.4g} m long: expected at most {MAX_EXTENT:g} m; its '
            'coordinates are probably in pixels or millimetres, and must be in m'
        )
    if np.abs(ring).max() > MAX_DISTANCE:
        raise InvalidValueError(
            f'invalid polygon at {shown(ring[0].tolist())} m: expected one within '
            f'{MAX_DISTANCE:g} m of the origin of the tray frame'
        )


def _repaired(polygon: shapely.Polygon, ring: Array, holes: list[Array]) -> shapely.Polygon:
    """Return the largest piece of the valid polygon; raises InvalidValueError if it differs."""
    reason = shapely.is_valid_reason(polygon).partition('[')[0].lower()
    pieces = shapely.get_parts(shapely.make_valid(polygon))
    pieces = [each for each in pieces if isinstance(each, shapely.Polygon)]
    if reason in MISPLACED_HOLES:  # which a repair would remove, if they are small
        pieces = []
    enclosed = _enclosed(ring) - sum(map(_enclosed, holes))
    if pieces:
        largest = max(pieces, key=lambda each: each.area)
        # The second sum is that of a figure of eight, whose loops cancel in the first.
        total = sum(each.area for each in pieces)
        if max(abs(largest.area - enclosed), total - largest.area) <= MAX_REPAIR * enclosed:
            return largest
    raise InvalidValueError(
        f'invalid polygon ({reason}): expected a boundary that does not cross itself, with its '
        'holes inside it'
    )


def _enclosed(ring: Array) -> float:
    x, y = (ring - ring[0]).T
    return abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2
