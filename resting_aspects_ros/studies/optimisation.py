"""A search for the best conditions of a part, and what is known of them at any time."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError, analysis
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, check_confidence
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.run_description import check_drops, check_seed
from resting_aspects_ros.studies.design import Factor, Setting, check_factors
from resting_aspects_ros.studies.objectives import Array, Counts, Objective
from resting_aspects_ros.studies.optimise_result import OptimiseResult, save_points
from resting_aspects_ros.studies.optimum import Candidate, OptimisePoint
from resting_aspects_ros.studies.optimum_comparison import (
    advantage,
    certainty_of_best,
    estimated,
    posterior_values,
)
from resting_aspects_ros.studies.optimum_facts import UNKNOWN, factor_facts
from resting_aspects_ros.studies.optimum_problem import Amounts
from resting_aspects_ros.studies.optimum_profile import Profile, profile_of
from resting_aspects_ros.studies.optimum_search import DRAWS, OptimumSearch
from resting_aspects_ros.studies.part_problem import PartProblem, setting_value


class Optimisation:
    """A search for the best conditions, whose result can be asked for at any time.

    Parameters
    ----------
    base : Setting
        The conditions from which the factors differ, and with which the best ones are compared.

    Raises
    ------
    InvalidValueError
        If no factor varies, or a number is out of bounds.
    """

    def __init__(
        self,
        part: Part,
        factors: Sequence[Factor],
        base: Setting,
        objective: Objective,
        amounts: Amounts,
        seed: int,
        workers: Workers,
        *,
        landscape: Landscape | None = None,
        confidence: float = CONFIDENCE,
        progress: Callable[[int], None] = lambda _: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        check_factors(factors)
        check_seed(seed)
        check_drops(amounts.total)
        check_confidence(confidence)
        landscape = Landscape(part) if landscape is None else landscape
        self._part, self._objective, self._base = part, objective, base
        self._aspects = find_aspects(part, landscape)
        self._confidence, self._stopped, self._amounts = confidence, stopped, amounts
        self._problem = PartProblem(
            part,
            factors,
            base,
            objective,
            seed,
            workers,
            landscape,
            progress=progress,
            stopped=stopped,
        )
        self._search = OptimumSearch(self._problem, amounts, seed)
        self._fresh: dict[str, Counts] = {}
        self._chosen: dict[str, Array | None] = {}

    @property
    def drops(self) -> int:
        """Number of drops so far."""
        return self._problem.done

    @property
    def points(self) -> tuple[OptimisePoint, ...]:
        """The points of the search with their counts."""
        rows = zip(self._search.points, self._search.counts, self._search.rounds, strict=True)
        return tuple(OptimisePoint(self._problem.values(p), row, k) for p, row, k in rows)

    def save_csv(self, path: Path) -> None:
        """Write the points as CSV, even if there is no result; raises OutputError."""
        save_points(path, self._problem.factors, self._objective, self.points)

    def run(self) -> None:
        """Make the drops; returns early if stopped. Raises InvalidValueError, EngineError."""
        self._search.run(self._stopped)
        if self._search.surrogate is None or self._stopped():
            return
        self._choose_and_compare()

    def _choose_and_compare(self) -> None:
        """Make fresh drops at the best conditions, the second ones and the start."""
        self._choose()
        settings = {
            name: self._problem.setting(p) for name, p in self._chosen.items() if p is not None
        }
        try:
            self._problem.check(self._base)
            settings['start'] = self._base
        except InvalidValueError:
            pass  # the result says that the start was not compared
        drops = self._amounts.compared
        counts = self._problem.counts_at(list(settings.values()), drops, 'comparison')
        self._fresh = {
            name: row for name, row in zip(settings, counts, strict=True) if row.sum() == drops
        }

    def _choose(self) -> None:
        if not self._chosen:
            best = self._search.best()
            self._chosen = {'best': best, 'second': self._search.rival(best)}

    def result(self) -> OptimiseResult | None:
        """Return what is known; None if nothing is, because too few points were simulated."""
        search, problem, objective = self._search, self._problem, self._objective
        if search.surrogate is None:
            return None
        self._choose()
        start = self._start()
        first, other = self._ranked(start)
        point = self._chosen[first]
        assert point is not None
        best = start if first == 'start' and start is not None else self._candidate(first)
        assert best is not None
        counts, complete = self._fresh, first in self._fresh
        gains = [
            advantage(objective, counts[first], counts[name], self._rng(), self._confidence)
            if complete and name in counts and name != first
            else None
            for name in (other, 'start')
        ]
        certainty = math.nan
        if complete:
            rest = [row for name, row in counts.items() if name != first]
            certainty = certainty_of_best(objective, counts[first], rest, self._rng())
        facts, profile = [UNKNOWN] * len(problem.factors), Profile(point, (), None)
        with analysis('the effects of the factors'):
            facts = factor_facts(search, point)
        with analysis('the objective around the best conditions'):
            profile = profile_of(search, point, objective.sign, self._confidence)
        return OptimiseResult(
            part=self._part,
            aspects=self._aspects,
            objective=objective,
            factors=problem.factors,
            facts=tuple(facts),
            best=best,
            second=self._candidate(other),
            start=start,
            over_second=gains[0],
            over_start=gains[1],
            certainty=certainty,
            points=self.points,
            skipped=tuple((problem.values(p), reason) for p, reason in search.skipped),
            amounts=self._amounts,
            drops=self.drops,
            certain=search.certain,
            complete=complete,
            confidence=self._confidence,
            seed=search.seed,
            surrogate=search.surrogate.text,
            surrogate_error=search.surrogate.cross_validated_error,
            profile=profile,
        )

    def _ranked(self, start: Candidate | None) -> tuple[str, str]:
        """Return the names of the best of the conditions, and of the other ones of the search.

        With fresh drops, the best ones are those with the best value in them. The start takes
        part if it is within the ranges.
        """
        values = {
            name: self._objective.sign * each.estimate.value
            for name in self._chosen
            if name in self._fresh and (each := self._candidate(name)) is not None
        }
        if start is not None and values and (point := self._point(start)) is not None:
            values['start'] = self._objective.sign * start.estimate.value
            self._chosen['start'] = point
        first = max(values, key=lambda name: values[name]) if values else 'best'
        others = [name for name in ('best', 'second') if name != first]
        return first, max(others, key=lambda name: values.get(name, -math.inf))

    def _point(self, start: Candidate) -> Array | None:
        """Return the point of the start in the unit cube; None if it is outside the ranges."""
        pairs = [(f, start.values[f.name]) for f in self._problem.factors]
        if any(value is None or not f.low <= value <= f.high for f, value in pairs):
            return None
        return np.array([float(f.shares(np.array(value))) for f, value in pairs])

    def _candidate(self, name: str) -> Candidate | None:
        point = self._chosen.get(name)
        if point is None:
            return None
        counts = self._fresh.get(name)
        if counts is None:
            draws = self._objective.sign * self._search.drawn(point[None], DRAWS)[:, 0]
            value = estimated(draws, self._confidence)
        else:
            value = posterior_values(self._objective, counts, self._rng(), self._confidence)
        problem = self._problem
        return Candidate(problem.setting(point), problem.values(point), counts, value)

    def _start(self) -> Candidate | None:
        counts = self._fresh.get('start')
        if counts is None:
            return None
        names = [factor.name for factor in self._problem.factors]
        values = {name: setting_value(self._base, name) for name in names}
        value = posterior_values(self._objective, counts, self._rng(), self._confidence)
        return Candidate(self._base, values, counts, value)

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng((self._search.seed, 5))
