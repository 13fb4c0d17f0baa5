"""Find the conditions with the most of the wanted aspects, or with the least entropy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.special import ndtri
from scipy.stats import norm

from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.runner import DropProgress, Progress, given_workers, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, StoppedError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions
from resting_aspects_ros.simulation.job import DEFAULT_SEED, check_drops, check_seed
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    check_confidence,
    containing,
)
from resting_aspects_ros.statistics.poses import RestingPoses
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
from resting_aspects_ros.studies.effects import homogeneity
from resting_aspects_ros.studies.objective import (
    Objective,
    contacts_wanted,
    finder_in,
    make_objective,
)
from resting_aspects_ros.studies.optimum import (
    SIGNIFICANCE,
    Advantage,
    Candidate,
    Estimated,
    FactorFacts,
    OptimiseResult,
)
from resting_aspects_ros.studies.points import (
    Monitor,
    Simulation,
    counted,
    point_seed,
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
# Values of a factor in its curve through the best conditions.
LEVELS = 9
# Conditions are nearly the same if all factors differ by less than this share of their ranges.
NEARLY_SAME = 0.2
# The best value is at a bound if it is this close to it, relative to the range.
AT_BOUND = 0.01
# Draws of a posterior, for a rank and for an interval.
FEW_DRAWS, DRAWS = 200, 20_000


@dataclass(frozen=True)
class Budget:
    """How drops are divided: half of them search, a quarter compares, and a quarter makes curves.

    total : int
        All drops.
    factors : int
        Number of factors.
    """

    total: int
    factors: int

    def __post_init__(self) -> None:
        check_drops(self.total)
        needed = 12 * self.points * MIN_DROPS
        if self.total < needed:
            raise InvalidValueError(
                f'invalid budget {self.total}: expected at least {needed} drops for '
                f'{self.factors} factors'
            )

    @property
    def points(self) -> int:
        """Points of the first round of the search, a power of two."""
        return int(2 ** np.ceil(np.log2(POINTS * self.factors)))

    @property
    def search(self) -> list[int]:
        """Drops at each point of each round: an eighth of all in the first and last round."""
        each = self.total // 4 // (ROUNDS * self.points // 2)
        return [self.total // 8 // self.points, *[each] * ROUNDS, self.total // 8 // FINALISTS]

    @property
    def compared(self) -> int:
        """Fresh drops at each of the three conditions that are compared."""
        return self.total // 12

    @property
    def curve(self) -> int:
        """Drops at each value of a factor in its curve."""
        return self.total // 4 // (LEVELS * self.factors)


class Problem(Protocol):
    """What is optimised over the unit cube."""

    def snapped(self, points: Array) -> Array:
        """Return the nearest points (n, d) that the factors allow."""

    def counts(self, points: Array, drops: int, batch: str) -> Counts:
        """Return counts (m, c) of independent drops at points (m, d).

        A batch is a seed. Impossible points, and those that are stopped, have no drops.
        """


@dataclass(eq=False)
class Search:
    """Points (n, d) of the unit cube, their counts (n, c), and the round in which they came.

    The first points are those of a Sobol sequence, some of them moved to bounds. In each further
    round, points are drawn from a
    normal distribution with the mean and the deviations of the best quarter of the round before
    (cross-entropy method: de Boer, Kroese, Mannor and Rubinstein 2005, Annals of Operations
    Research 134:19). The mean of many points is known better than which of them is the best. In
    the last round, the best points of all rounds and the last mean get more drops.
    """

    problem: Problem
    objective: Objective
    budget: Budget
    seed: int

    def __post_init__(self) -> None:
        self.points = np.zeros((0, self.budget.factors))
        self.counts = np.zeros((0, len(self.objective.groups) + 1), dtype=np.int64)
        self.rounds: list[int] = []

    def run(self, given: Array | None = None, stopped: Callable[[], bool] = lambda: False) -> None:
        """Make the drops of all rounds; ends early if ``stopped``.

        ``given`` (k, d) are more points of the first round.
        """
        d, size = self.budget.factors, self.budget.points
        points = sobol(d, size, self.seed)
        # Many optima are at a bound: half of the points have some coordinates there.
        at_bound = np.random.default_rng((self.seed, 0)).random((size // 2, d)) < 0.5
        points[::2] = np.where(at_bound, points[::2].round(), points[::2])
        made = self._drop(points if given is None else np.vstack([given, points]), 0)
        for number in range(1, ROUNDS + 2):
            best = self.points[made[self._order(made)[: size // 8]]]
            if stopped() or len(best) < 2:
                return
            mean, spread = best.mean(axis=0), best.std(axis=0) + MIN_SPREAD
            if number <= ROUNDS:
                normal = ndtri(np.clip(sobol(d, size // 2, (self.seed, number)), 1e-3, 1 - 1e-3))
                made = self._drop(np.clip(mean + spread * normal, 0, 1), number)
        ends = np.where(np.abs(mean - 0.5) > 0.5 - NEAR_END, mean.round(), mean)
        best = self.points[self.ranked()[: FINALISTS - 2]]
        self._drop(np.vstack([mean, ends, best]), ROUNDS + 1)

    def ranked(self) -> list[int]:
        """Return the points from the best on, by the mean score less its standard deviation.

        A point with few drops is therefore not first because it was lucky.
        """
        return self._order(np.arange(len(self.points)), 1.0).tolist()

    def best(self) -> list[Array]:
        """Return the best point, and the best one that is not nearly the same, if there is one."""
        ranked = self.ranked()
        finalists = [k for k in ranked if self.counts[k].sum() >= self.budget.search[-1]]
        first = self.points[(finalists or ranked)[0]]
        others = (self.points[k] for k in [*finalists, *ranked])
        return [first, *[p for p in others if np.abs(p - first).max() >= NEARLY_SAME][:1]]

    def counts_of(self, point: Array | None) -> Counts | None:
        """Return the counts (c,) of a point; None if it is not one of the search."""
        same = np.flatnonzero([point is not None and (p == point).all() for p in self.points])
        return np.asarray(self.counts[same[0]]) if len(same) else None

    def _order(self, which: Counts, deviations: float = 0.0) -> Counts:
        """Return the order of points (n,), from the best on, by mean score less deviations."""
        rng = np.random.default_rng((self.seed, 1))
        draws = [self.objective.posterior(self.counts[k], rng, FEW_DRAWS) for k in which]
        scores = [self.objective.sign * x.mean() - deviations * x.std() for x in draws]
        return np.argsort(-np.array(scores), kind='stable')

    def _drop(self, points: Array, number: int) -> Counts:
        """Make drops at points, and return where those are that are possible."""
        wanted = np.unique(self.problem.snapped(points), axis=0)
        counts = self.problem.counts(wanted, self.budget.search[number], f'round {number}')
        found = []
        for point, row in zip(wanted, counts, strict=True):
            if not row.sum():
                continue
            same = np.flatnonzero((self.points == point).all(axis=1))
            if len(same):
                self.counts[same[0]] += row
                found.append(int(same[0]))
            else:
                self.points = np.vstack([self.points, point])
                self.counts = np.vstack([self.counts, row])
                self.rounds.append(number)
                found.append(len(self.points) - 1)
        return np.array(found, dtype=np.int64)


def estimated(draws: Array, confidence: float) -> Estimated:
    """Return the mean and the central interval of draws."""
    tail, mean = (1 - confidence) / 2, float(draws.mean())
    lower, upper = np.quantile(draws, [tail, 1 - tail])
    lower, upper = containing(mean, lower, upper)
    return Estimated(mean, float(lower), float(upper))


def compared(draws: Sequence[Array], confidence: float) -> tuple[list[Advantage], float]:
    """Return by how much the first of some conditions is better than each other one.

    Also returns the posterior probability that it is better than all of them. ``draws`` are those
    of the posteriors of their scores, by drops that did not select the conditions, so that the
    values are not those of the luckiest of many points (winner's curse).
    """
    first, *others = draws
    gains = [
        Advantage(estimated(first - each, confidence), float((first > each).mean()))
        for each in others
    ]
    return gains, float(np.all([first > each for each in others], axis=0).mean())


def factor_facts(
    objective: Objective,
    at: Array,
    counts: Counts,
    best: float,
    rng: np.random.Generator,
    confidence: float,
) -> FactorFacts:
    """Return what a factor does, by counts (l, c) at its values ``at`` (l,), one of them best."""
    order = np.argsort(at)
    at, counts = at[order], counts[order]
    draws = np.array([objective.posterior(row, rng, DRAWS) for row in counts])
    found = [estimated(row, confidence) for row in draws]
    error = draws.std(axis=1)
    values = np.array([each.value for each in found])
    change = np.abs(values[:, None] - values)
    reach = norm.ppf((1 + confidence) / 2) * np.hypot(error[:, None], error)
    p_value, flat = homogeneity(counts), (0.0, 1.0)
    k = int(np.abs(at - best).argmin())
    loss = objective.sign * (values[k] - values)
    if p_value < SIGNIFICANCE:
        flat = _flat_range(at, loss, counts.sum(axis=1), k, objective.tolerance)
    # With a loss of 0 or less at an end, this is the best value or a better one.
    near = np.where(np.abs(at - best) <= AT_BOUND, 0.0, loss)
    bound = 0 if min(near[0], near[-1]) > 0 else -1 if near[0] < near[-1] else 1
    return FactorFacts(
        at,
        values,
        np.array([each.lower for each in found]),
        np.array([each.upper for each in found]),
        flat,
        bound,
        float(change.max()),
        float((change + np.where(change > 0, reach, 0)).max()),
        p_value,
    )


def _flat_range(
    at: Array, loss: Array, drops: Counts, k: int, tolerance: float
) -> tuple[float, float]:
    """Return where the loss reaches the tolerance on both sides of value k.

    The loss is taken to grow with the distance from there, and to be linear between the values.
    """
    ends = []
    for side in (slice(k, None, -1), slice(k, None)):
        u, grown = at[side], _ascending(loss[side], drops[side])
        j = int(np.argmax(grown > tolerance))
        if grown[j] <= tolerance:
            ends.append(float(u[-1]))
        elif j == 0:
            ends.append(float(u[0]))
        else:
            ends.append(float(np.interp(tolerance, grown[j - 1 : j + 1], u[j - 1 : j + 1])))
    return ends[0], ends[1]


def _ascending(values: Array, weights: Counts) -> Array:
    """Return the nearest ascending values (isotonic regression: Barlow et al. 1972)."""
    blocks: list[tuple[float, float, int]] = []  # mean, weight, number of values
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        blocks.append((value, weight, 1))
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, v, n), (b, w, m) = blocks[-2:]
            blocks[-2:] = [((a * v + b * w) / (v + w), v + w, n + m)]
    return np.repeat([mean for mean, _, _ in blocks], [number for _, _, number in blocks])


def optimise(
    part: Part | str | Path,
    vary: Mapping[str, Any],
    *,
    wanted: Sequence[int] | None = None,
    wanted_classes: Sequence[int] | None = None,
    wanted_contacts: Sequence[str | Mapping[str, Any]] = (),
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

    Drops at the points of a Sobol sequence, then more drops at the better half of them and at new
    points around these, in five rounds. Fresh drops at the best conditions, at the second best and
    at the given conditions then show how certain the answer is, and drops along each factor
    through the best conditions how flat the optimum is. The same arguments give the same result
    for any number of workers.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    vary : mapping of str to str, (float, float) or mapping
        Ranges of the factors: conditions, ``surroundings.angle`` or ``action.speed``; a text such
        as '20mm:200mm' or '20mm:200mm:7' (7 levels), or the two ends in SI units.
    wanted, wanted_classes : sequence of int, optional
        Wanted aspects or symmetry classes, whose share is maximised.
    wanted_contacts : sequence of str or mapping, optional
        In surroundings with walls: contacts such as ``{'belt': 1, 'wall': 'edge'}``; a part
        must have those of one entry. With planes that are not named, any contact is accepted.
    minimise_entropy : bool
        Minimise the entropy of the distribution over the symmetry classes instead.
    surface : str or DropConditions
        Named conditions, or conditions, of everything that does not vary.
    surroundings : str, Path or Surroundings, optional
        As for `drop`. Aspects are counted on the first plane.
    action : str, Action or NamedAction, optional
        What is done once to each part that was dropped, before it is counted.
    budget : int
        Number of all drops: half of them search, and a quarter are fresh drops.
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
    factors = [read_factor(name, _range(given), base) for name, given in vary.items()]
    check_factors(factors)
    check_seed(seed)
    check_confidence(confidence)
    divided = Budget(budget, len(factors))
    with given_workers(workers) as pool:
        simulation = Simulation.of(loaded, pool)
        aspects = simulation.aspects
        objective = make_objective(
            aspects,
            wanted,
            wanted_classes,
            minimise_entropy=minimise_entropy,
            contacts=contacts_wanted(wanted_contacts, loaded, base, aspects),
        )
        with DropProgress(loaded.name, budget, shown=progress) as bar:
            drops = _Drops(simulation, factors, base, objective, seed, bar, stopped)
            return _found(drops, divided, confidence)


def _range(given: Any) -> Any:
    """Return a range as `read_factor` accepts it."""
    if isinstance(given, tuple | list) and len(given) == 2:
        return {'low': given[0], 'high': given[1]}
    return given


class _Drops:
    """The drops of a part at points of the unit cube; a Problem."""

    def __init__(
        self,
        simulation: Simulation,
        factors: Sequence[Factor],
        base: Setting,
        objective: Objective,
        seed: int,
        bar: DropProgress,
        stopped: Callable[[], bool],
    ) -> None:
        self.simulation, self.factors, self.base = simulation, tuple(factors), base
        self.objective, self.seed, self.stopped = objective, seed, stopped
        self.made, self._bar = 0, bar
        self.skipped: list[tuple[Mapping[str, float], str]] = []

    def values(self, point: Array) -> dict[str, float]:
        """Return the values of the factors at a point (d,), SI units."""
        return point_values(self.factors, point[None])[0]

    def snapped(self, points: Array) -> Array:
        """Return the nearest points (n, d) that the factors allow."""
        return on_levels(points, self.factors)

    def counts(self, points: Array, drops: int, batch: str) -> Counts:
        """Return counts (m, c) of independent drops at points (m, d); see Problem."""
        values = [self.values(point) for point in points]
        found = self.counts_at([partial(self.base.changed, v) for v in values], drops, batch)
        self.skipped += [(values[k], c) for k, c in enumerate(found) if isinstance(c, str)]
        return counted(found, len(self.objective.groups) + 1)

    def counts_at(
        self, settings: Sequence[Callable[[], Setting]], drops: int, batch: str
    ) -> list[Counts | str | None]:
        """Return the counts (c,) of each setting, or why it is impossible; None if stopped."""
        before = self.made
        found = run_tasks(
            [partial(self._outcomes, each, drops, batch) for each in settings],
            self.simulation.workers,
            lambda done: self._bar.update(before + done),
            self.stopped,
        )
        self.made += sum(int(each.sum()) for each in found if isinstance(each, np.ndarray))
        return found

    def _outcomes(
        self, setting: Callable[[], Setting], drops: int, batch: str, monitor: Monitor
    ) -> Counts:
        """Return counts (c,) of the outcomes; raises InvalidValueError if it is impossible."""
        made, simulation, wanted = setting(), self.simulation, self.objective.contacts
        seed = point_seed(self.seed, simulation.part, made, batch)
        if made.action is not None:
            counts = simulation.dropped_and_acted(made, drops, seed, monitor)
            return self.objective.columns(counts)
        if not wanted:
            return self.objective.columns(simulation.dropped(made, drops, seed, monitor))
        finder, found = finder_in(simulation.part, made.drop_conditions, simulation.aspects), [0]

        def count(poses: RestingPoses, _: Counts) -> None:
            found[0] += int(np.any([each.found(finder, poses) for each in wanted], axis=0).sum())

        simulation.dropped(made, drops, seed, monitor, [count])
        return np.array([found[0], drops - found[0]])


def _found(drops: _Drops, budget: Budget, confidence: float) -> OptimiseResult:
    """Search, compare, follow the factors, and return what is known at the end, or if stopped."""
    objective, factors = drops.objective, drops.factors
    search = Search(drops, objective, budget, drops.seed)
    start = _within(drops.base, factors)
    search.run(None if start is None else start[None], drops.stopped)
    if len(search.points) < 2:
        if drops.stopped():
            raise StoppedError('interrupted; too few points were simulated for a result')
        reason = f': {drops.skipped[0][1]}' if drops.skipped else ''
        raise InvalidValueError(
            f'invalid ranges: expected at least 2 possible points, not {len(search.points)}'
            f'{reason}'
        )
    # The conditions of the user are one of the points, if they are within the ranges.
    points = [p for p in search.best() if start is None or (p != start).any()]
    settings: list[Callable[[], Setting]] = [
        partial(drops.base.changed, drops.values(point)) for point in points
    ]
    fresh = drops.counts_at([*settings, lambda: drops.base], budget.compared, 'fresh')
    complete = not any(each is None for each in fresh)
    rng = np.random.default_rng((drops.seed, 5))
    found: list[tuple[Candidate, Array]] = []
    for point, setting, counts in zip(
        [*points, start], [*settings, lambda: drops.base], fresh, strict=True
    ):
        own = counts if complete else search.counts_of(point)
        if isinstance(own, np.ndarray):
            made, draws = setting(), objective.posterior(own, rng, DRAWS)
            values = {factor.name: made.value(factor.name) for factor in factors}
            estimate = estimated(draws, confidence)
            found.append((Candidate(made, values, point, own, estimate), objective.sign * draws))
    # The best value is first; conditions outside the ranges are last.
    found.sort(key=lambda each: (each[0].point is None, -each[1].mean()))
    candidates = [candidate for candidate, _ in found]
    facts: list[FactorFacts] = []
    if complete:
        facts = _facts(drops, candidates[0], budget, confidence, rng)
    gains, certainty = compared([scores for _, scores in found], confidence)
    return OptimiseResult(
        part=drops.simulation.part,
        aspects=drops.simulation.aspects,
        objective=objective,
        factors=factors,
        facts=tuple(facts),
        candidates=tuple(candidates),
        start=next((each for each in candidates if each.setting is drops.base), None),
        gains=tuple(gains) if complete else (),
        certainty=certainty if complete else np.nan,
        points=[
            (drops.values(point), counts, int(number))
            for point, counts, number in zip(
                search.points, search.counts, search.rounds, strict=True
            )
        ],
        skipped=tuple(drops.skipped),
        budget=budget.total,
        drops=drops.made,
        complete=len(facts) == len(factors),
        confidence=confidence,
        seed=drops.seed,
    )


def _within(base: Setting, factors: Sequence[Factor]) -> Array | None:
    """Return the point (d,) of the user's conditions; None if they are outside the ranges."""
    values = [base.value(factor.name) for factor in factors]
    inside = [v is not None and f.low <= v <= f.high for f, v in zip(factors, values, strict=True)]
    if not all(inside):
        return None
    return np.array([float(f.shares(np.array(v))) for f, v in zip(factors, values, strict=True)])


def _facts(
    drops: _Drops, best: Candidate, budget: Budget, confidence: float, rng: np.random.Generator
) -> list[FactorFacts]:
    """Make drops along each factor through the best conditions, and return what they show."""
    point, d = best.point, len(drops.factors)
    assert point is not None
    lines = []
    for k in range(d):
        line = np.repeat(point[None], LEVELS, axis=0)
        line[:, k] = np.linspace(0, 1, LEVELS)
        line = np.unique(drops.snapped(line), axis=0)
        lines.append(line[line[:, k] != point[k]])
    counts = drops.counts(np.vstack(lines), budget.curve, 'curve')
    if drops.stopped():
        return []
    found = []
    for k, own in enumerate(np.split(counts, np.cumsum([len(line) for line in lines])[:-1])):
        made = own.sum(axis=1) > 0
        at = np.append(lines[k][made, k], point[k])
        table = np.vstack([own[made], best.counts[None]])
        found.append(factor_facts(drops.objective, at, table, float(point[k]), rng, confidence))
    return found
