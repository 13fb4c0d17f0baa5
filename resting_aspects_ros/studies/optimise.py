"""Find the conditions with the most of the wanted aspects, or with the least entropy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from resting_aspects_ros.api.runner import DropProgress, Progress, given_workers, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, StoppedError
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
    check_drops,
    check_seed,
)
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.intervals import CONFIDENCE, check_confidence
from resting_aspects_ros.studies.design import (
    Factor,
    Setting,
    check_factors,
    given_setting,
    on_levels,
    point_values,
    read_factor,
    sobol,
)
from resting_aspects_ros.studies.optimum import (
    DRAWS,
    Candidate,
    Objective,
    OptimiseResult,
    compared,
    estimated,
    make_objective,
)
from resting_aspects_ros.studies.points import (
    Monitor,
    Simulation,
    counted,
    run_tasks,
)

DEFAULT_BUDGET = 200_000
# Points of the first round of the search for each factor, later rounds, each with half as many,
# drops at each of their points, at least, and points that get more drops at the end.
POINTS, ROUNDS, MIN_DROPS, FINALISTS = 16, 6, 10, 8
# Smallest standard deviation of new points, relative to the range of a factor.
MIN_SPREAD = 0.01
# The end of a range is a finalist if the last points are as close to it.
NEAR_END = 0.15
# Conditions are nearly the same if all factors differ by less than this share of their ranges.
NEARLY_SAME = 0.2
# Draws of a posterior, for a rank.
FEW_DRAWS = 200

# Returns counts (m, c) of independent drops at points (m, d) of the unit cube. The text is a seed.
# Impossible points, and those that are stopped, have no drops.
Drop = Callable[[Array, int, str], Counts]
# Counts (c,) of the outcomes by the point of the unit cube.
Points = dict[tuple[float, ...], Counts]


def search(
    drop: Drop,
    factors: Sequence[Factor],
    objective: Objective,
    budget: int,
    seed: int,
    *,
    given: Array | None = None,
    stopped: Callable[[], bool] = never,
) -> Points:
    """Return points of the unit cube and their drops, which are half of the budget.

    The first points are those of a Sobol sequence, some of them moved to bounds, and the ``given``
    one (d,). In each further round, points are drawn from a normal distribution with the mean and
    the deviations of the best quarter of the round before (cross-entropy method: de Boer, Kroese,
    Mannor and Rubinstein 2005, Annals of Operations Research 134:19). The mean of many points is
    known better than which of them is the best. In the last round, the best points of all rounds
    and the last mean get more drops. The search ends early if ``stopped``.
    """
    d, found = len(factors), Points()
    size = first_points(d)

    def add(points: Array, drops: int, number: int) -> list[tuple[float, ...]]:
        """Make drops at points, and return those points that are possible."""
        wanted = np.unique(on_levels(points, factors), axis=0)
        counts = drop(wanted, drops, f'round {number}')
        made = {tuple(p): row for p, row in zip(wanted.tolist(), counts, strict=True) if row.sum()}
        for point, row in made.items():
            found[point] = found[point] + row if point in found else row
        return list(made)

    points = sobol(d, size, seed)
    # Many optima are at a bound: half of the points have some coordinates there.
    at_bound = np.random.default_rng((seed, 0)).random((size // 2, d)) < 0.5
    points[::2] = np.where(at_bound, points[::2].round(), points[::2])
    points = points if given is None else np.vstack([given, points])
    made = add(points, budget // 8 // size, 0)
    each = budget // 4 // (ROUNDS * size // 2)
    for number in range(1, ROUNDS + 2):
        best = np.array(ranked({p: found[p] for p in made}, objective, seed, 0.0)[: size // 8])
        if stopped() or len(best) < 2:
            return found
        mean, spread = best.mean(axis=0), best.std(axis=0) + MIN_SPREAD
        if number <= ROUNDS:
            normal = ndtri(np.clip(sobol(d, size // 2, (seed, number)), 1e-3, 1 - 1e-3))
            made = add(np.clip(mean + spread * normal, 0, 1), each, number)
    ends = np.where(np.abs(mean - 0.5) > 0.5 - NEAR_END, mean.round(), mean)
    finalists = ranked(found, objective, seed)[: FINALISTS - 2]
    add(np.vstack([mean, ends, finalists]), final_drops(budget), ROUNDS + 1)
    return found


def first_points(factors: int) -> int:
    """Return the number of points of the first round, a power of two."""
    return int(2 ** np.ceil(np.log2(POINTS * factors)))


def final_drops(budget: int) -> int:
    """Return the number of drops that each finalist of the search gets."""
    return budget // 8 // FINALISTS


def ranked(
    points: Points, objective: Objective, seed: int, deviations: float = 1.0
) -> list[tuple[float, ...]]:
    """Return the points from the best on, by the mean score less its standard deviations.

    With deviations, a point with few drops is not first because it was lucky.
    """
    rng = np.random.default_rng((seed, 1))
    draws = [objective.sign * objective.posterior(c, rng, FEW_DRAWS) for c in points.values()]
    scores = np.array([x.mean() - deviations * x.std() for x in draws])
    known = list(points)
    return [known[k] for k in np.argsort(-scores, kind='stable').tolist()]


def best_points(points: Points, objective: Objective, budget: int, seed: int) -> list[Array]:
    """Return the best point, and the best one that is not nearly the same, if there is one."""
    order = [np.array(p) for p in ranked(points, objective, seed)]
    final = [p for p in order if points[tuple(p.tolist())].sum() >= final_drops(budget)]
    first = (final or order)[0]
    others = (p for p in [*final, *order] if np.abs(p - first).max() >= NEARLY_SAME)
    return [first, *list(others)[:1]]


def optimise(
    part: Part | str | Path,
    vary: Mapping[str, Any],
    *,
    wanted: Sequence[int] | None = None,
    wanted_classes: Sequence[int] | None = None,
    minimise_entropy: bool = False,
    surface: str | DropConditions = DEFAULT_SURFACE,
    surroundings: str | Path | Surroundings | None = None,
    action: str | Action | NamedAction | None = None,
    budget: int = DEFAULT_BUDGET,
    seed: int = DEFAULT_SEED,
    confidence: float = CONFIDENCE,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> OptimiseResult:
    """Find the conditions with the most of the wanted aspects, or with the least entropy.

    Half of the drops search. The others are fresh drops at the best conditions, at the second best
    and at the given conditions, which show how certain the answer is. The same arguments give the
    same result for any number of workers.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    vary : mapping of str to str, (float, float) or mapping
        Ranges of the factors: conditions, ``surroundings.angle`` or ``action.speed``; a text such
        as '20mm:200mm' or '20mm:200mm:7' (7 levels), or the two ends in SI units.
    wanted, wanted_classes : sequence of int, optional
        Wanted aspects or symmetry classes, whose share is maximised.
    minimise_entropy : bool
        Minimise the entropy of the distribution over the symmetry classes instead.
    surface : str or DropConditions
        Named conditions, or conditions, of everything that does not vary.
    surroundings : str, Path or Surroundings, optional
        As for `drop`. Aspects are counted on the first plane.
    action : str, Action or NamedAction, optional
        What is done once to each part that was dropped, before it is counted.
    budget : int
        Number of all drops: half of them search, and half are fresh drops.
    seed, workers, progress
        As for `drop`.
    confidence : float
        Of the intervals, and of the winner.
    stopped : callable
        Ends early if it returns True; the result is then not complete.
    **conditions : float
        Conditions that differ from the surface, in SI units; what varies starts from them.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or nearly all points are impossible.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    StoppedError
        ``stopped`` returned True before anything was known.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> found = ra.optimise('tetrahedron', {'height': '20mm:60mm'}, wanted=[1], budget=2000)
    >>> 0.02 <= found.best.values['height'] <= 0.06
    True
    """
    loaded = given_part(part)
    base = given_setting(surface, conditions, surroundings, action)
    factors = tuple(read_factor(name, given, base) for name, given in vary.items())
    check_factors(factors, base, [loaded])
    check_seed(seed)
    check_confidence(confidence)
    check_drops(budget)
    if budget < (needed := 12 * first_points(len(factors)) * MIN_DROPS):
        raise InvalidValueError(
            f'invalid budget {budget}: expected at least {needed} drops for {len(factors)} factors'
        )
    with given_workers(workers) as pool:
        simulation = Simulation.of(loaded, pool)
        objective = make_objective(
            simulation.aspects, wanted, wanted_classes, minimise_entropy=minimise_entropy
        )
        with DropProgress(loaded.name, budget, shown=progress) as bar:
            return _Search(
                simulation, factors, base, objective, budget, confidence, seed, bar, stopped
            ).found()


@dataclass(eq=False)
class _Search:
    """A search for the best conditions: its drops of a part at points of the unit cube.

    made : int
        Number of drops that were made.
    skipped : list of (dict of str to float, str)
        Impossible points, and why.
    """

    simulation: Simulation
    factors: tuple[Factor, ...]
    base: Setting
    objective: Objective
    budget: int
    confidence: float
    seed: int
    bar: DropProgress
    stopped: Callable[[], bool]
    made: int = 0
    skipped: list[tuple[Mapping[str, float], str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng((self.seed, 5))

    def values(self, point: Array) -> dict[str, float]:
        """Return the values of the factors at a point (d,), SI units."""
        return point_values(self.factors, point[None])[0]

    def counts(self, points: Array, drops: int, batch: str) -> Counts:
        """Return counts (m, c) of independent drops at points (m, d); see Drop."""
        values = point_values(self.factors, points)
        found = self.counts_at([self.base.at(v) for v in values], drops, batch)
        self.skipped += [(values[k], c) for k, c in enumerate(found) if isinstance(c, str)]
        return counted(found, len(self.objective.groups) + 1)

    def counts_at(
        self, settings: Sequence[Setting | str], drops: int, batch: str
    ) -> list[Counts | str | None]:
        """Return the counts (c,) of each setting, or why it is impossible; None if stopped."""
        before = self.made
        found = run_tasks(
            [partial(self._outcomes, each, drops, batch) for each in settings],
            self.simulation.workers,
            lambda done: self.bar.update(before + done),
            self.stopped,
        )
        self.made += sum(int(each.sum()) for each in found if isinstance(each, np.ndarray))
        return found

    def _outcomes(
        self, setting: Setting | str, drops: int, batch: str, monitor: Monitor
    ) -> Counts:
        """Return counts (c,) of the outcomes; raises InvalidValueError if it is impossible."""
        found = self.simulation.counts(setting, drops, self.seed, batch, monitor)
        return self.objective.columns(found)

    def found(self) -> OptimiseResult:
        """Search and compare; return what is known at the end, or if stopped."""
        objective, factors, seed = self.objective, self.factors, self.seed
        start = _within(self.base, factors)
        known = search(
            self.counts, factors, objective, self.budget, seed, given=start, stopped=self.stopped
        )
        if len(known) < 2:
            if self.stopped():
                raise StoppedError('interrupted; too few points were simulated for a result')
            reason = f': {self.skipped[0][1]}' if self.skipped else ''
            raise InvalidValueError(
                f'invalid ranges: expected at least 2 possible points, not {len(known)}{reason}'
            )
        found, complete = self._compared(known, start)
        candidates = [candidate for candidate, _ in found]
        certainty = np.nan
        if complete:
            gains, certainty = compared([scores for _, scores in found], self.confidence)
            candidates[1:] = [
                replace(each, behind=gain)
                for each, gain in zip(candidates[1:], gains, strict=True)
            ]
        return OptimiseResult(
            part=self.simulation.part,
            aspects=self.simulation.aspects,
            objective=objective,
            factors=factors,
            candidates=tuple(candidates),
            start=next((each for each in candidates if each.setting is self.base), None),
            certainty=certainty,
            points=[(self.values(np.array(point)), counts) for point, counts in known.items()],
            skipped=tuple(self.skipped),
            budget=self.budget,
            drops=self.made,
            complete=complete,
            confidence=self.confidence,
            seed=seed,
        )

    def _compared(
        self, known: Points, start: Array | None
    ) -> tuple[list[tuple[Candidate, Array]], bool]:
        """Return the candidates with draws of their scores, and whether they are by fresh drops.

        The best value is first; conditions outside the ranges are last.
        """
        # The conditions of the user are one of the points, if they are within the ranges.
        best = best_points(known, self.objective, self.budget, self.seed)
        points = [p for p in best if start is None or (p != start).any()]
        settings = [*(self.base.changed(self.values(point)) for point in points), self.base]
        fresh = self.counts_at(settings, self.budget // 2 // len(settings), 'fresh')
        complete = not any(each is None for each in fresh)
        found: list[tuple[Candidate, Array]] = []
        for point, setting, counts in zip([*points, start], settings, fresh, strict=True):
            own = counts
            if not complete:
                own = None if point is None else known.get(tuple(point.tolist()))
            if isinstance(own, np.ndarray):
                draws = self.objective.posterior(own, self.rng, DRAWS)
                values = {factor.name: setting.value(factor.name) for factor in self.factors}
                estimate = estimated(draws, self.confidence)
                candidate = Candidate(setting, values, point, own, estimate)
                found.append((candidate, self.objective.sign * draws))
        found.sort(key=lambda each: (each[0].point is None, -each[1].mean()))
        return found, complete


def _within(base: Setting, factors: Sequence[Factor]) -> Array | None:
    """Return the point (d,) of the user's conditions; None if they are outside the ranges."""
    point = []
    for factor in factors:
        value = base.value(factor.name)
        if value is None or not factor.low <= value <= factor.high:
            return None
        point.append(float(factor.shares(np.array(value))))
    return np.array(point)
