"""Convex polygons that together are a polygon with holes; lengths are in hull radii."""

import numpy as np
import shapely

from resting_aspects_ros.core.rotations import Array

# A corner that lies deeper than this inside the convex hull is cut; a polygon without such corners
# is replaced by its hull.
CONVEX = 1e-3
# Pieces narrower than this are dropped.
SLIVER = 1e-3


def convex_polygons(polygon: shapely.Polygon, most: int) -> list[Array]:
    """Return convex polygons (k, 2), counterclockwise; none if there are more than ``most``.

    The polygon is cut along its own sides, beginning at the deepest corner.
    """
    left, found = [polygon], []
    while left:
        piece = left.pop()
        corner = _deepest(piece)
        if corner is None:
            found.append(_counterclockwise(np.array(piece.convex_hull.exterior.coords)[:-1]))
        else:
            left += _halves(piece, *corner)
        if len(found) + len(left) > most:
            return []
    return found


def _deepest(piece: shapely.Polygon) -> tuple[Array, Array] | None:
    """Return the corner deepest inside the hull and the direction of its side; None if convex."""
    hull = piece.convex_hull.exterior
    best, deepest = None, CONVEX
    for ring in (piece.exterior, *piece.interiors):
        points = np.array(ring.coords)[:-1]
        depths = shapely.distance(hull, shapely.points(points))
        k = int(np.argmax(depths))
        if depths[k] > deepest:
            deepest = float(depths[k])
            side = points[k] - points[k - 1]
            best = points[k], side / np.linalg.norm(side)
    return best


def _halves(piece: shapely.Polygon, point: Array, along: Array) -> list[shapely.Polygon]:
    """Return the pieces on both sides of a line through a point."""
    low, high = np.array(piece.bounds).reshape(2, 2)
    reach = 2 * float(np.linalg.norm(high - low)) * along
    found = []
    for across in (np.array([-reach[1], reach[0]]), np.array([reach[1], -reach[0]])):
        half = [point - reach, point + reach, point + reach + across, point - reach + across]
        parts = shapely.get_parts(shapely.intersection(piece, shapely.Polygon(half)))
        found += [
            part
            for part in parts
            if part.geom_type == 'Polygon' and not part.buffer(-SLIVER / 2).is_empty
        ]
    return found


def _counterclockwise(points: Array) -> Array:
    following = np.roll(points, -1, axis=0)
    area = (points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]).sum()
    return points if area > 0 else points[::-1]


def edge_planes(polygon: Array) -> tuple[Array, Array]:
    """Return outward normals (k, 2) and offsets (k,) of the sides of a convex polygon (k, 2)."""
    sides = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, (normals * polygon).sum(axis=1)


def polygon_from(polygon: Array, normals: Array, offsets: Array) -> Array:
    """Return the polygon (k, 2) in all half-planes ``normals @ x <= offsets``; (0, 2) if none.

    ``polygon`` (k, 2) determines how far it can extend.
    """
    low, high = polygon.min(axis=0) - 1.0, polygon.max(axis=0) + 1.0
    found = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for normal, offset in zip(normals, offsets, strict=True):
        found = _cut(found, normal, float(offset))
    return found


def clipped(points: Array, polygon: Array) -> Array:
    """Return those of the points (n, 2) that are inside a convex polygon."""
    normals, offsets = edge_planes(polygon)
    inside = (points @ normals.T - offsets < -SLIVER / 10).all(axis=1)
    return np.asarray(points[inside])


def _cut(polygon: Array, normal: Array, offset: float) -> Array:
    kept: list[Array] = []
    above = polygon @ normal - offset
    for k in range(len(polygon)):
        one, other = above[k], above[(k + 1) % len(polygon)]
        if one <= 0:
            kept.append(polygon[k])
        if (one <= 0) != (other <= 0):
            share = one / (one - other)
            kept.append(polygon[k] + share * (polygon[(k + 1) % len(polygon)] - polygon[k]))
    return np.array(kept).reshape(-1, 2)
