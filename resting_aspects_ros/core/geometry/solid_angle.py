"""Solid angles of triangles, facets and polygons."""

import numpy as np

from resting_aspects_ros.core.geometry.polyhedron import Polyhedron
from resting_aspects_ros.core.rotations import Array


def triangle_angles(a: Array, b: Array, c: Array) -> Array:
    """Return the solid angles (n,) of triangles seen from the origin, sr; negative if clockwise.

    The corners (n, 3) are at any distance but zero, and counter-clockwise as seen from the side
    away from the origin (Van Oosterom and Strackee 1983).
    """
    triple = (a * np.cross(b, c)).sum(axis=1)
    ra, rb, rc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    spread = (
        ra * rb * rc
        + (a * b).sum(axis=1) * rc
        + (b * c).sum(axis=1) * ra
        + (c * a).sum(axis=1) * rb
    )
    return np.asarray(2 * np.arctan2(triple, spread))


def facet_angles(body: Polyhedron) -> Array:
    """Return the solid angles (f,) of the facets seen from the origin, sr; their sum is 4 pi."""
    first, second = body.points[body.ends[:, 0]], body.points[body.ends[:, 1]]
    left, right = body.sides.T
    found = np.zeros(len(body.normals))
    # A fan around the foot of each facet. If the foot is outside, some triangles are negative.
    np.add.at(found, left, triangle_angles(body.normals[left], first, second))
    np.add.at(found, right, triangle_angles(body.normals[right], second, first))
    return found


def polygon_angle(polygon: Array, height: float) -> float:
    """Return the solid angle, sr, of a counter-clockwise polygon (k, 2) from above its origin."""
    # As the bottom of a body, the polygon is clockwise when seen from outside.
    around = np.column_stack([polygon[::-1], np.full(len(polygon), -height)])
    foot = np.broadcast_to([0.0, 0.0, -height], around.shape)
    return float(triangle_angles(foot, around, np.roll(around, -1, axis=0)).sum())
