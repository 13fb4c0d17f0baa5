"""The methods by name, and the distribution that each predicts."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators.analytic_weights import (
    crsa,
    csa,
    energy_barrier,
    quasi_static,
    rolling,
    solid_angle,
    stability,
)
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.rotations import Array


@dataclass(frozen=True)
class Method:
    """A method that predicts probabilities from the shape of a part.

    weights : function
        Returns the weights (k,) of the aspects by id, to which the probabilities are proportional,
        or raises NotDefinedError.
    label : str
        Display name.
    meaning : str
        Quantity to which the probability of an aspect is proportional.
    source : str
        Publication of the method.
    heading : str
        Its name as the heading of a column, in one or two short lines.
    """

    weights: Callable[[RestingShape], Array]
    label: str
    meaning: str
    source: str
    heading: str


METHODS = {
    'solid_angle': Method(
        solid_angle,
        'solid angle',
        'solid angle of its side, seen from the centre of mass',
        "Simpson's rule",
        'sol.\nang.',
    ),
    'csa': Method(
        csa,
        'centroid solid angle',
        'solid angle / height of the centre of mass',
        'Ngoi, Lim, Lee 1995',
        'csa',
    ),
    'crsa': Method(
        crsa,
        'critical solid angle',
        '(solid angle - mean critical solid angle) / height',
        'Ngoi, Lye, Chen 1996',
        'crsa',
    ),
    'stability': Method(
        stability,
        'stability',
        'area of the support / height of the centre of mass',
        'Chua, Tay 1998',
        'sta-\nbil.',
    ),
    'energy_barrier': Method(
        energy_barrier,
        'energy barrier',
        'minimum energy that moves the part out of it',
        'Boothroyd, Ho 1977',
        'bar-\nrier',
    ),
    'quasi_static': Method(
        quasi_static,
        'quasi-static',
        'solid angle of all sides that lead to the aspect',
        'Goldberg, Mirtich, Zhuang, Craig et al. 1999',
        'quasi\nstat.',
    ),
    'rolling': Method(
        rolling,
        'rolling',
        'directions from which the part rolls into the aspect',
        'Baktash, Sharp, Zhou, Crane, Jacobson 2025',
        'rol-\nling',
    ),
}


@dataclass(frozen=True, eq=False)
class Estimate:
    """The distribution that a method predicts; it has no drops.

    method : str
        One of METHODS.
    probabilities : (k,) float
        Probability of each aspect, by id from 1; their sum is 1.
    """

    aspects: AspectSet
    method: str
    probabilities: Array

    @property
    def source(self) -> str:
        """Publication of the method."""
        return METHODS[self.method].source

    def class_probabilities(self) -> Array:
        """Return the probability (c,) of each symmetry class, by number from 1."""
        numbers = [aspect.symmetry_class for aspect in self.aspects.aspects]
        return np.asarray(np.bincount(numbers, weights=self.probabilities)[1:])


def check_method(method: str) -> None:
    """Raise InvalidValueError if there is no such method."""
    if method not in METHODS:
        raise InvalidValueError(f'invalid method {method!r}: expected one of {", ".join(METHODS)}')


def estimate(shape: RestingShape, method: str) -> Estimate:
    """Return the distribution that a method predicts for a part.

    Aspects of one symmetry class are equally probable. If a part has only one aspect, its
    probability is 1 for every method.

    Raises
    ------
    InvalidValueError
        If there is no such method.
    NotDefinedError
        If the method is not defined for this part.
    """
    check_method(method)
    aspects = shape.aspects
    if len(aspects) == 1:
        return Estimate(aspects, method, np.ones(1))
    try:
        weights = METHODS[method].weights(shape)
    except NotDefinedError as error:
        raise NotDefinedError(f'{method} is not defined for {shape.part.name}: {error}') from error
    for members in aspects.classes():
        indices = [aspect.id - 1 for aspect in members]
        weights[indices] = weights[indices].mean()
    return Estimate(aspects, method, weights / weights.sum())


def estimate_each(
    shape: RestingShape, names: Iterable[str]
) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Return the estimates by method, and the reasons for methods that are not defined."""
    estimates: dict[str, Estimate] = {}
    reasons: dict[str, str] = {}
    for name in names:
        try:
            estimates[name] = estimate(shape, name)
        except NotDefinedError as error:
            reasons[name] = str(error)
    return estimates, reasons
