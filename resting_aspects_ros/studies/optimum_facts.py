"""What each factor does to the score: how flat the optimum is, and whether the factor matters."""

from dataclasses import dataclass

import numpy as np
from scipy.special import log_softmax, xlogy
from scipy.stats import chi2, f

from resting_aspects_ros.studies.design import sobol
from resting_aspects_ros.studies.optimum_problem import Array, Counts
from resting_aspects_ros.studies.optimum_search import OptimumSearch, Problem
from resting_aspects_ros.studies.softmax_fit import fit_softmax
from resting_aspects_ros.studies.surrogate_form import Form

# Steps along a factor for its flat range, and for its effect.
FLAT_STEPS, EFFECT_STEPS = 101, 9
# Places at which the effect of a factor is computed.
PLACES = 32
DRAWS = 200
# The best value is at a bound if it is this close to it, relative to the range.
AT_BOUND = 0.01
# A factor has no effect that can be shown if the p value of the likelihood ratio test is larger.
SIGNIFICANCE = 0.05
# Outcomes with fewer drops are tested together.
RARE = 50


@dataclass(frozen=True)
class FactorFacts:
    """What one factor does, in coordinates 0 to 1 of its range.

    flat : (float, float)
        Range around the best value in which the score is within the tolerance of the best one; the
        other factors have their best values. The whole range if no effect is shown.
    bound : int
        -1 or 1 if the best value is at the lower or upper bound of the range, otherwise 0.
    effect : float
        Largest change of the score along the factor, anywhere in the ranges.
    effect_upper : float
        Upper bound of the effect, with a probability of 95 %, by draws of the surrogate.
    p_value : float
        Of the likelihood ratio test that the factor has no effect on the outcomes.
    """

    flat: tuple[float, float]
    bound: int
    effect: float
    effect_upper: float
    p_value: float

    @property
    def matters(self) -> bool:
        """Whether an effect is shown."""
        return self.p_value < SIGNIFICANCE

    @property
    def at_bound(self) -> bool:
        """Whether a wider range would probably have a better point."""
        return self.matters and self.bound != 0


# Facts of a factor if they could not be computed.
UNKNOWN = FactorFacts((0.0, 1.0), 0, np.nan, np.nan, np.nan)


def factor_facts(search: OptimumSearch, best: Array) -> list[FactorFacts]:
    """Return the facts of each factor; the search must have a surrogate."""
    effects = _effects(search, best)
    points, counts = np.array(search.points), np.array(search.counts)
    found = []
    for k in range(len(best)):
        p_value = _p_value(points, counts, k)
        flat = _flat_range(search, best, k) if p_value < SIGNIFICANCE else (0.0, 1.0)
        found.append(FactorFacts(flat, _bound(float(best[k])), *effects[k], p_value))
    return found


def _bound(value: float) -> int:
    return -1 if value <= AT_BOUND else int(value >= 1 - AT_BOUND)


def _along(problem: Problem, point: Array, k: int, steps: int) -> Array:
    """Return points along factor k through a point."""
    points = np.repeat(point[None], steps, axis=0)
    points[:, k] = np.linspace(0, 1, steps)
    return problem.snapped(points)


def _flat_range(search: OptimumSearch, best: Array, k: int) -> tuple[float, float]:
    """Return the values of a factor around the best one that lose less than the tolerance."""
    line = _along(search.problem, best, k, FLAT_STEPS)
    scores = search.predicted(np.vstack([best[None], line]))
    good = scores[1:] >= scores[0] - search.problem.tolerance
    u = line[:, k]
    low = high = float(best[k])
    for value, fine in zip(u[u <= best[k]][::-1], good[u <= best[k]][::-1], strict=True):
        if not fine:
            break
        low = float(value)
    for value, fine in zip(u[u >= best[k]], good[u >= best[k]], strict=True):
        if not fine:
            break
        high = float(value)
    return low, high


def _effects(search: OptimumSearch, best: Array) -> list[tuple[float, float]]:
    """Return the effect of each factor and its upper bound."""
    d = len(best)
    places = search.problem.snapped(np.vstack([best[None], sobol(d, PLACES, search.seed)]))
    found = []
    for k in range(d):
        lines = np.vstack([_along(search.problem, p, k, EFFECT_STEPS) for p in places])
        scores = search.drawn(lines, DRAWS).reshape(DRAWS, len(places), EFFECT_STEPS)
        spans = np.ptp(scores, axis=2).max(axis=1)
        effect = np.ptp(scores.mean(axis=0), axis=1).max()
        found.append((float(effect), float(np.quantile(spans, 0.95))))
    return found


def _p_value(points: Array, counts: Counts, k: int) -> float:
    """Return the p value of the likelihood ratio test that a factor has no effect.

    Quadratic logits with and without the factor are compared. If they do not fit, as the deviance
    from the counts shows, the ratio is divided by the dispersion (quasi-likelihood, F test).
    """
    common = counts.sum(axis=0) >= RARE
    table = np.column_stack([counts[:, common], counts[:, ~common].sum(axis=1)])
    table = table[:, table.sum(axis=0) > 0].astype(float)
    if table.shape[1] < 2:
        return 1.0
    others = np.delete(points, k, axis=1)
    d = points.shape[1]
    degree = 2 if (d + 1) * (d + 2) // 2 < len(points) else 1
    full, less = Form(degree).features(points), Form(degree).features(others)
    ratio = 2 * (_likelihood(full, table) - _likelihood(less, table))
    outcomes = table.shape[1] - 1
    freedom = (full.shape[1] - less.shape[1]) * outcomes
    left = (len(points) - full.shape[1]) * outcomes
    own = table / table.sum(axis=1, keepdims=True)
    deviance = 2 * (float(xlogy(table, own).sum()) - _likelihood(full, table))
    if left <= 0 or deviance <= left:
        return float(chi2.sf(ratio, freedom))
    return float(f.sf(max(ratio, 0.0) / freedom / (deviance / left), freedom, left))


def _likelihood(features: Array, table: Array) -> float:
    """Return the maximum of the log likelihood of counts."""
    fitted = fit_softmax(features, table, np.full(features.shape[1], 1e-4))
    return float((table * log_softmax(fitted.logits(features), axis=1)).sum())
