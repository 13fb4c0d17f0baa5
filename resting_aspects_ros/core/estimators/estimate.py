"""The methods by name, and the distribution that each predicts.

Seen from the centre of mass, the face of aspect i has the solid angle Omega_i and is at the
distance h_i; r_ij is the distance of the centre of mass from its edge j, and A_i its area.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.geometry.solid_angle import polygon_angle
from resting_aspects_ros.core.rotations import Array


@dataclass(frozen=True)
class Method:
    """A way to predict probabilities.

    weights : function
        Of a RestingShape: (k,) weights by id, to which the probabilities are proportional, or
        NotDefinedError.
    label : str
        Its name for people.
    meaning : str
        What the probability of an aspect is in proportion to.
    source : str
        Where it is from.
    """

    weights: Callable[[RestingShape], Array]
    label: str
    meaning: str
    source: str


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
    return np.array([aspect.min_barrier for aspect in shape.aspects.aspects])


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


METHODS = {
    'solid_angle': Method(
        solid_angle,
        'solid angle',
        'that of its side, seen from the centre of mass',
        "Simpson's rule",
    ),
    'csa': Method(
        csa,
        'centroid solid angle',
        'solid angle / height of the centre of mass',
        'Ngoi, Lim, Lee 1995',
    ),
    'crsa': Method(
        crsa,
        'critical solid angle',
        '(solid angle - mean critical one) / height',
        'Ngoi, Lye, Chen 1996',
    ),
    'stability': Method(
        stability,
        'stability',
        'area of the support / height of the centre of mass',
        'Chua, Tay 1998',
    ),
    'energy_barrier': Method(
        energy_barrier,
        'energy barrier',
        'least energy that takes the part out of it',
        'Boothroyd, Ho 1977',
    ),
    'quasi_static': Method(
        quasi_static,
        'quasi-static',
        'solid angle of all sides that lead to the aspect',
        'Goldberg, Mirtich, Zhuang, Craig et al. 1999',
    ),
    'rolling': Method(
        rolling,
        'rolling',
        'directions from which the part rolls into the aspect',
        'Baktash, Sharp, Zhou, Crane, Jacobson 2025',
    ),
}


@dataclass(frozen=True, eq=False)
class Estimate:
    """A distribution that a method predicts: no drops, so no interval.

    method : str
        One of METHODS.
    probabilities : (k,) float
        Of each aspect, by id from 1; they add up to 1.
    """

    aspects: AspectSet
    method: str
    probabilities: Array

    @property
    def source(self) -> str:
        """Where the method is from."""
        return METHODS[self.method].source

    def of_classes(self) -> Array:
        """(c,) probability of each symmetry class, by number from 1."""
        numbers = [aspect.symmetry_class for aspect in self.aspects.aspects]
        return np.asarray(np.bincount(numbers, weights=self.probabilities)[1:])


def check_method(method: str) -> None:
    """Raises InvalidValueError if there is no such method."""
    if method not in METHODS:
        raise InvalidValueError(f'invalid method {method!r}: expected one of {", ".join(METHODS)}')


def estimate(shape: RestingShape, method: str) -> Estimate:
    """The distribution of a part by a method.

    Aspects that a rotation of the part onto itself takes to each other are equally probable. A
    part with one aspect rests in it, whatever the method.

    Raises
    ------
    InvalidValueError
        If there is no such method.
    NotDefinedError
        If the method says nothing about this part.
    """
    check_method(method)
    aspects = shape.aspects
    if len(aspects) == 1:
        return Estimate(aspects, method, np.ones(1))
    try:
        found = METHODS[method].weights(shape)
    except NotDefinedError as error:
        raise NotDefinedError(f'{method} is not defined for {shape.part.name}: {error}') from error
    for members in aspects.classes():
        places = [aspect.id - 1 for aspect in members]
        found[places] = found[places].mean()
    return Estimate(aspects, method, found / found.sum())


def estimate_each(
    shape: RestingShape, names: Iterable[str]
) -> tuple[dict[str, Estimate], dict[str, str]]:
    """By method what it says, and of those that say nothing, why."""
    found: dict[str, Estimate] = {}
    reasons: dict[str, str] = {}
    for name in names:
        try:
            found[name] = estimate(shape, name)
        except NotDefinedError as error:
            reasons[name] = str(error)
    return found, reasons
