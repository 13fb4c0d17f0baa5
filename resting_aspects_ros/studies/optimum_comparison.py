"""Compare conditions by fresh drops, which did not take part in their selection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.statistics.intervals import containing
from resting_aspects_ros.studies.objectives import Array, Counts, Objective

DRAWS = 20_000


@dataclass(frozen=True)
class Estimated:
    """A value with its credible interval."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Advantage:
    """By how much the best conditions are better than others, and how certain that is.

    gain : Estimated
        Positive if the best conditions are better, even if less is better.
    certainty : float
        Posterior probability that they are better at all.
    """

    gain: Estimated
    certainty: float


def estimated(draws: Array, confidence: float) -> Estimated:
    """Return the mean and the central interval of draws."""
    tail = (1 - confidence) / 2
    lower, upper = np.quantile(draws, [tail, 1 - tail])
    mean = float(draws.mean())
    lower, upper = containing(mean, lower, upper)
    return Estimated(mean, float(lower), float(upper))


def posterior_values(
    objective: Objective, counts: Counts, rng: np.random.Generator, confidence: float
) -> Estimated:
    """Return the value of an objective at conditions with these fresh counts (c,)."""
    return estimated(objective.posterior(counts, rng, DRAWS), confidence)


def certainty_of_best(
    objective: Objective, best: Counts, others: Sequence[Counts], rng: np.random.Generator
) -> float:
    """Return the posterior probability that conditions are better than all others.

    All have fresh counts (c,).
    """
    first, *rest = (
        objective.sign * objective.posterior(each, rng, DRAWS) for each in (best, *others)
    )
    return float((first > np.max(rest, axis=0)).mean()) if rest else 1.0


def advantage(
    objective: Objective, best: Counts, other: Counts, rng: np.random.Generator, confidence: float
) -> Advantage:
    """Return by how much conditions with fresh counts (c,) are better than others.

    The drops of both are independent of each other and of the selection, so that the values are
    not those of the luckiest of many points (winner's curse).
    """
    draws = objective.sign * (
        objective.posterior(best, rng, DRAWS) - objective.posterior(other, rng, DRAWS)
    )
    return Advantage(estimated(draws, confidence), float((draws > 0).mean()))
