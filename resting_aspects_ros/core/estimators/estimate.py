"""The methods by name, and the distribution that each predicts."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators import weights
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.rotations import Array


@dataclass(frozen=True)
class Method:
    """A way to predict probabilities.

    weights : function
        Of a RestingShape; as core.estimators.weights has them.
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


METHODS = {
    'solid_angle': Method(
        weights.solid_angle,
        'solid angle',
        'that of its side, seen from the centre of mass',
        "Simpson's rule",
    ),
    'csa': Method(
        weights.csa,
        'centroid solid angle',
        'solid angle / height of the centre of mass',
        'Ngoi, Lim, Lee 1995',
    ),
    'crsa': Method(
        weights.crsa,
        'critical solid angle',
        '(solid angle - mean critical one) / height',
        'Ngoi, Lye, Chen 1996',
    ),
    'stability': Method(
        weights.stability,
        'stability',
        'area of the support / height of the centre of mass',
        'Chua, Tay 1998',
    ),
    'energy_barrier': Method(
        weights.energy_barrier,
        'energy barrier',
        'least energy that takes the part out of it',
        'Boothroyd, Ho 1977',
    ),
    'quasi_static': Method(
        weights.quasi_static,
        'quasi-static',
        'solid angle of all sides that lead to the aspect',
        'Goldberg, Mirtich, Zhuang, Craig et al. 1999',
    ),
    'rolling': Method(
        weights.rolling,
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
        raise InvalidValueError(
            f'method {method!r} is not known, allowed are {", ".join(METHODS)}'
        )


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
