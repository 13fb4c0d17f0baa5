"""Counts of the parts that a machine has supplied, combined with the simulation.

The shares of the symmetry classes have a Dirichlet distribution. The simulated drops are its
prior, with the weight of a limited number of drops: the simulation has a systematic error, which
more drops do not reduce.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    Array,
    Counts,
    Interval,
    check_confidence,
    containing,
)

# The weight of the simulation in drops. In the comparison with measurements of
# docs/explanation/validation.md, the squared deviation of a simulated share p is 0.016 p (1 - p)
# on average, which is the variance of a share that is counted in 60 parts.
PRIOR_WEIGHT = 60.0
MAX_WEIGHT = 1e9


@dataclass(frozen=True, eq=False)
class LiveCounts:
    """Counted parts and simulated drops by symmetry class, and the distribution of the shares.

    ids : tuple of int
        Numbers of the c symmetry classes.
    simulated : (c,) int
        Simulated drops in each class, at least one in total.
    observed : (c,) int
        Newly supplied parts that were counted in each class; each part is counted once.
    weight : float
        Weight of the simulated drops together, in parts; above 0. It is never more than their
        number.
    """

    ids: tuple[int, ...]
    simulated: Counts
    observed: Counts
    weight: float = PRIOR_WEIGHT

    def __post_init__(self) -> None:
        check_weight(self.weight)

    @property
    def parts(self) -> int:
        """Number of counted parts."""
        return int(self.observed.sum())

    @property
    def prior_weight(self) -> float:
        """Weight that the simulated drops have, in parts."""
        return float(min(self.weight, self.simulated.sum()))

    @property
    def concentration(self) -> Array:
        """(c,) parameters of the Dirichlet distribution of the shares.

        The prior has the shares of the simulation by Jeffreys' estimate, so that a class that was
        never simulated can still be counted.
        """
        prior = self.simulated + 0.5
        return np.asarray(prior / prior.sum() * self.prior_weight + self.observed)

    def intervals(self, confidence: float = CONFIDENCE) -> list[Interval]:
        """Return the mean share of each class, with its equal-tailed credible interval.

        That of a class that was never seen is extended to the mean, which is above it.
        """
        check_confidence(confidence)
        a = self.concentration
        b = a.sum() - a
        tail = (1 - confidence) / 2
        mean = a / a.sum()
        lower, upper = containing(mean, betaincinv(a, b, tail), betaincinv(a, b, 1 - tail))
        rows = zip(mean.tolist(), lower.tolist(), upper.tolist(), strict=True)
        return [Interval(*row) for row in rows]


def check_weight(weight: float) -> None:
    """Raise InvalidValueError unless the weight of the simulation is within its limits."""
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if not (number and 0 < weight <= MAX_WEIGHT):
        raise InvalidValueError(
            f'invalid prior weight {shown(weight)}: expected more than 0, at most {MAX_WEIGHT:g}'
        )
