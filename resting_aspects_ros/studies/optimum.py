"""The best conditions that a search found, and what they were compared with."""

from collections.abc import Mapping
from dataclasses import dataclass

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.studies.design import Factor, Setting
from resting_aspects_ros.studies.objectives import Counts, Objective
from resting_aspects_ros.studies.optimum_comparison import Advantage, Estimated
from resting_aspects_ros.studies.optimum_facts import FactorFacts
from resting_aspects_ros.studies.optimum_problem import Amounts
from resting_aspects_ros.studies.optimum_profile import Profile

# Probability with which the best conditions are the winner.
WINNER = 0.95


@dataclass(frozen=True, eq=False)
class Candidate:
    """Conditions that are compared.

    setting : Setting
    values : dict of str to float or None
        Values of the factors, SI units; None for a default of the surroundings.
    counts : (c,) int or None
        Fresh drops by outcome: the groups of the objective, then all other ends; None if none
        were made.
    estimate : Estimated
        The value of the objective, by the fresh drops; without them by the surrogate.
    """

    setting: Setting
    values: Mapping[str, float | None]
    counts: Counts | None
    estimate: Estimated

    @property
    def drops(self) -> int:
        """Number of fresh drops."""
        return 0 if self.counts is None else int(self.counts.sum())


@dataclass(frozen=True, eq=False)
class OptimisePoint:
    """A point of the design or of the search: values of the factors, SI units, and counts (c,).

    round : int
        0 for the design, otherwise the round of the search.
    """

    values: Mapping[str, float]
    counts: Counts
    round: int


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best conditions within ranges, and how certain the answer is.

    Attributes
    ----------
    part : Part
    aspects : AspectSet
    objective : Objective
    factors : tuple of Factor
    facts : tuple of FactorFacts
        For each factor, how flat the optimum is and whether the factor matters.
    best : Candidate
        Of the compared conditions within the ranges, those with the best value in the fresh
        drops; these can be those of the start.
    second : Candidate or None
        The best of the conditions that are not nearly the same: at least one factor differs by a
        fifth of its range. None if there are none.
    start : Candidate or None
        The conditions from which the search started; None if they are impossible.
    over_second, over_start : Advantage or None
        By how much the best conditions are better, by fresh drops; None without them.
    certainty : float
        Posterior probability, by the fresh drops, that the best conditions are better than all
        others that are compared; NaN without them.
    points : tuple of OptimisePoint
    skipped : tuple of (dict of str to float, str)
        Impossible points, and why.
    amounts : Amounts
        Points, drops at each, and the budget.
    drops : int
        All drops that were made.
    certain : bool
        Whether the search ended early, because no point was expected to be much better.
    complete : bool
        Whether the fresh drops were made.
    confidence : float
    seed : int
    surrogate : str
    surrogate_error : float
        Cross-validated error of the shares.
    profile : Profile
        The objective along each factor, by the surrogate.
    """

    part: Part
    aspects: AspectSet
    objective: Objective
    factors: tuple[Factor, ...]
    facts: tuple[FactorFacts, ...]
    best: Candidate
    second: Candidate | None
    start: Candidate | None
    over_second: Advantage | None
    over_start: Advantage | None
    certainty: float
    points: tuple[OptimisePoint, ...]
    skipped: tuple[tuple[Mapping[str, float], str], ...]
    amounts: Amounts
    drops: int
    certain: bool
    complete: bool
    confidence: float
    seed: int
    surrogate: str
    surrogate_error: float
    profile: Profile

    @property
    def winner(self) -> bool:
        """Whether the fresh drops show that the best conditions are better than the others."""
        return self.certainty >= WINNER

    @property
    def aim(self) -> str:
        """What was sought, such as 'largest share of aspect 1 after one tap'."""
        action = self.best.setting.action
        if action is None:
            return self.objective.text
        return f'{self.objective.text} after one {action.name} on parts that were dropped'
