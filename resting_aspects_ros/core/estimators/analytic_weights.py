"""The weights of aspects by the analytic methods of the literature.

Notation: the face of aspect i has the area A_i and, seen from the centre of mass, the solid angle
Omega_i and the distance h_i; r_ij is the distance of the centre of mass from edge j of the face.
"""

import numpy as np

from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.geometry.solid_angle import polygon_angle
from resting_aspects_ros.core.rotations import Array


def solid_angle(shape: RestingShape) -> Array:
    """Return Omega_i."""
    return shape.face_angles


def csa(shape: RestingShape) -> Array:
    """Return Omega_i / h_i: the centroid solid angle."""
    return np.asarray(shape.face_angles / _heights(shape))


def crsa(shape: RestingShape) -> Array:
    """Return (Omega_i - mean over j of Omega_crit,ij) / h_i: the critical solid angle.

    Omega_crit,ij is the solid angle of the face seen from the height r_ij, to which the centre of
    mass rises when the part tips over edge j. All edges have the same weight, also short ones: a
    corner that is rounded in many steps has more weight than a sharp one.
    """
    critical = [_critical(polygon, height) for polygon, height in shape.polygons()]
    return np.asarray(np.maximum(shape.face_angles - critical, 0.0) / _heights(shape))


def stability(shape: RestingShape) -> Array:
    """Return A_i / h_i."""
    return np.array([_area(polygon) / height for polygon, height in shape.polygons()])


def energy_barrier(shape: RestingShape) -> Array:
    """Return the minimum energy that moves the part out of each aspect, with m g = 1."""
    return np.array([aspect.min_barrier for aspect in shape.aspects.aspects])


def quasi_static(shape: RestingShape) -> Array:
    """Return the sum of Omega over all facets of the hull that lead to each aspect.

    From an unstable facet the part tips over the edge, or the corner, beyond which its centre of
    mass is, from facet to facet, until it reaches a stable one.
    """
    count = len(shape.aspects)
    angles = np.bincount(shape.aspect_of_facets, weights=shape.facet_angles, minlength=count)
    return np.asarray(angles, dtype=np.float64)


def rolling(shape: RestingShape) -> Array:
    """Return the exact share of directions from which the part rolls into each aspect."""
    return np.array([aspect.basin_share for aspect in shape.aspects.aspects])


def _heights(shape: RestingShape) -> Array:
    return np.array([aspect.com_height for aspect in shape.aspects.aspects])


def _critical(polygon: Array, height: float) -> float:
    """Return the mean critical solid angle over the edges, sr."""
    along = np.roll(polygon, -1, axis=0) - polygon
    across = polygon[:, 0] * along[:, 1] - polygon[:, 1] * along[:, 0]
    over_edges = np.hypot(height, across / np.linalg.norm(along, axis=1))
    return float(np.mean([polygon_angle(polygon, float(r)) for r in over_edges]))


def _area(polygon: Array) -> float:
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)
