"""What each method takes for the weight of an aspect; probabilities are proportional to them.

Each takes a RestingShape and returns (k,) weights by id, or raises NotDefinedError. Seen from the
centre of mass, the face of aspect i has the solid angle Omega_i and is at the distance h_i; r_ij
is the distance of the centre of mass from its edge j, and A_i its area.
"""

import numpy as np

from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.solid_angle import polygon_angle


def solid_angle(shape: RestingShape) -> Array:
    """Omega_i."""
    return shape.face_angles


def csa(shape: RestingShape) -> Array:
    """Omega_i / h_i: the centroid solid angle."""
    return np.asarray(shape.face_angles / _heights(shape))


def crsa(shape: RestingShape) -> Array:
    """(Omega_i - mean over j of Omega_crit,ij) / h_i: the critical solid angle.

    Omega_crit,ij is that of the face seen from the height r_ij above its foot, to which the centre
    of mass rises when the part tips over edge j. Each edge counts as much, however short: a
    corner that is rounded in many steps weighs more than a sharp one.
    """
    critical = [_critical(polygon, height) for polygon, height in shape.polygons()]
    return np.asarray(np.maximum(shape.face_angles - critical, 0.0) / _heights(shape))


def stability(shape: RestingShape) -> Array:
    """A_i / h_i."""
    return np.array([_area(polygon) / height for polygon, height in shape.polygons()])


def energy_barrier(shape: RestingShape) -> Array:
    """The least energy that takes the part out of the aspect, m g = 1."""
    return np.array([aspect.least_barrier for aspect in shape.aspects.aspects])


def quasi_static(shape: RestingShape) -> Array:
    """Omega of all facets of the hull that lead to the aspect.

    A facet on which the part cannot stay hands its share over the edge beyond which the centre of
    mass is, or over the corner, from facet to facet until it can.
    """
    count = len(shape.aspects)
    found = np.bincount(shape.aspect_of_facets, weights=shape.facet_angles, minlength=count)
    return np.asarray(found, dtype=np.float64)


def rolling(shape: RestingShape) -> Array:
    """The area of all directions of gravity from which the part rolls into the aspect, exactly."""
    return np.array([aspect.basin_share for aspect in shape.aspects.aspects])


def _heights(shape: RestingShape) -> Array:
    return np.array([aspect.com_height for aspect in shape.aspects.aspects])


def _critical(polygon: Array, height: float) -> float:
    """Mean over the edges of the critical solid angle, sr."""
    along = np.roll(polygon, -1, axis=0) - polygon
    across = polygon[:, 0] * along[:, 1] - polygon[:, 1] * along[:, 0]
    over_edges = np.hypot(height, across / np.linalg.norm(along, axis=1))
    return float(np.mean([polygon_angle(polygon, float(r)) for r in over_edges]))


def _area(polygon: Array) -> float:
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)
