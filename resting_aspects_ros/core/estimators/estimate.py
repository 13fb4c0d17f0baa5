"""The methods by name, and the distribution that each predicts."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

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
from resting_aspects_ros.core.estimators.learned import learned
from resting_aspects_ros.core.estimators.release import TYPICAL, Release
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, Interval, containing

LEARNED = 'learned'


@dataclass(frozen=True)
class Method:
    """A method that predicts probabilities.

    weights : function
        Returns the weights (k,) of the aspects of a RestingShape by id, to which the probabilities
        are proportional, or raises NotDefinedError. That of LEARNED has the conditions of the
        drops as its second argument.
    label : str
        Display name.
    meaning : str
        Quantity to which the probability of an aspect is proportional.
    source : str
        Publication of the method.
    heading : str
        Its name as the heading of a column, in one or two short lines.
    """

    weights: Callable[..., Array]
    label: str
    meaning: str
    source: str
    heading: str


def learned_shares(shape: RestingShape, release: Release = TYPICAL) -> Array:
    """Return exp(score_i): a score of features of the landscape and the conditions."""
    return learned(shape, release)[0]


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
    LEARNED: Method(
        learned_shares,
        'learned',
        'fitted to drops of random solids, for the conditions',
        'this suite, `make learned`',
        'lear-\nned',
    ),
}


@dataclass(frozen=True, eq=False)
class Estimate:
    """The distribution that a method predicts; it has no drops.

    method : str
        One of METHODS.
    probabilities : (k,) float
        Probability of each aspect, by id from 1; their sum is 1.
    weight : float
        Number of drops whose counts have the same uncertainty as the prediction; NaN if it is not
        known, which only LEARNED states. As a prior of counts it is Dirichlet, with weight times
        the probabilities as its parameters.
    """

    aspects: AspectSet
    method: str
    probabilities: Array
    weight: float = math.nan

    @property
    def source(self) -> str:
        """Publication of the method."""
        return METHODS[self.method].source

    def class_probabilities(self) -> Array:
        """Return the probability (c,) of each symmetry class, by number from 1."""
        numbers = [aspect.symmetry_class for aspect in self.aspects.aspects]
        return np.asarray(np.bincount(numbers, weights=self.probabilities)[1:])

    def interval(self, aspects: Sequence[int], confidence: float = CONFIDENCE) -> Interval:
        """Return the probability of any of the aspects, by id; its bounds are NaN if not known."""
        shares = self.probabilities[[k - 1 for k in aspects]]
        return share_interval(float(shares.sum()), self.weight, confidence)


def share_interval(share: float, weight: float, confidence: float = CONFIDENCE) -> Interval:
    """Return a predicted probability with its bounds, which are NaN if the weight is NaN."""
    share = min(float(share), 1.0)
    if math.isnan(weight):
        return Interval(share, math.nan, math.nan)
    a, b = weight * share, weight * (1 - share)
    if a <= 0 or b <= 0:
        return Interval(share, share, share)
    tail = (1 - confidence) / 2
    lower, upper = containing(share, betaincinv(a, b, tail), betaincinv(a, b, 1 - tail))
    return Interval(share, float(lower), float(upper))


def check_method(method: str) -> None:
    """Raise InvalidValueError if there is no such method."""
    if method not in METHODS:
        raise InvalidValueError(f'invalid method {method!r}: expected one of {", ".join(METHODS)}')


def estimate(shape: RestingShape, method: str, release: Release = TYPICAL) -> Estimate:
    """Return the distribution that a method predicts for a part.

    Aspects of one symmetry class are equally probable. If a part has only one aspect, its
    probability is 1 for every method. The conditions of the drops, ``release``, only matter for
    LEARNED.

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
    certainty = math.nan
    try:
        if method == LEARNED:
            weights, certainty = learned(shape, release)
        else:
            weights = METHODS[method].weights(shape)
    except NotDefinedError as error:
        raise NotDefinedError(f'{method} is not defined for {shape.part.name}: {error}') from error
    for members in aspects.classes():
        indices = [aspect.id - 1 for aspect in members]
        weights[indices] = weights[indices].mean()
    return Estimate(aspects, method, weights / weights.sum(), certainty)


def estimate_each(
    shape: RestingShape, names: Iterable[str], release: Release = TYPICAL
) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Return the estimates by method, and the reasons for methods that are not defined."""
    estimates: dict[str, Estimate] = {}
    reasons: dict[str, str] = {}
    for name in names:
        try:
            estimates[name] = estimate(shape, name, release)
        except NotDefinedError as error:
            reasons[name] = str(error)
    return estimates, reasons
