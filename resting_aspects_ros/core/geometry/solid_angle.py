"""Solid angles of triangles, facets and polygons, seen from a point."""

import numpy as np

from resting_aspects_ros.core.geometry.polyhedron import Polyhedron
from resting_aspects_ros.core.rotations import Array


def triangle_angles(a: Array, b: Array, c: Array) -> Array:
    """(n,) solid angles of triangles seen from the origin, sr; negative where clockwise.

    Corners (n, 3) of any distance but zero, counter-clockwise as seen from the origin's far side.
    Van Oosterom and Strackee 1983.
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
    """(f,) solid angles of the facets of a body seen from the origin, sr; they add up to 4 pi."""
    first, second = body.points[body.ends[:, 0]], body.points[body.ends[:, 1]]
    left, right = body.sides.T
    found = np.zeros(len(body.normals))
    # A fan around the foot of each facet, which may be outside: then some triangles are negative.
    np.add.at(found, left, triangle_angles(body.normals[left], first, second))
    np.add.at(found, right, triangle_angles(body.normals[right], second, first))
    return found


def polygon_angle(polygon: Array, height: float) -> float:
    """Solid angle of a polygon, (k, 2) counter-clockwise, from a height above its origin, sr."""
    # Seen from outside of a body whose bottom it is, it is clockwise.
    around = np.column_stack([polygon[::-1], np.full(len(polygon), -height)])
    foot = np.broadcast_to([0.0, 0.0, -height], around.shape)
    return float(triangle_angles(foot, around, np.roll(around, -1, axis=0)).sum())
