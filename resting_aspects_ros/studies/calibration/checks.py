"""What a fit says of each condition, whether it explains the counts, and predictions of parts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import xlogy
from scipy.stats import chi2

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.comparison import g_statistic
from resting_aspects_ros.statistics.intervals import containing
from resting_aspects_ros.studies.calibration.counts_file import CountedPart
from resting_aspects_ros.studies.calibration.posterior import Fit, ShareModel
from resting_aspects_ros.studies.design import Factor

CONFIDENCE = 0.9
# A condition is not determined if its interval is longer than this share of the range.
WIDE = 0.5
DRAWS = 4000
# Of a test by parametric bootstrap.
REPETITIONS = 199


@dataclass(frozen=True, eq=False)
class Estimate:
    """A fitted condition.

    best : float
        Its value at the most probable conditions.
    mean, deviation : float
        Of the posterior.
    low, high : float
        The shortest interval with 90 % of the posterior, extended to ``best`` and ``mean``.
    determined : bool
        Whether the interval is at most half of the range.
    """

    factor: Factor
    best: float
    mean: float
    deviation: float
    low: float
    high: float
    determined: bool


@dataclass(frozen=True, eq=False)
class Prediction:
    """Shares of the groups of a part; each array is (g,).

    model, model_low, model_high : float
        Mean and interval of the shares in the simulation.
    low, high : float
        Interval of the shares of as many drops as were counted, with the discrepancy.
    """

    counted: Array
    model: Array
    model_low: Array
    model_high: Array
    low: Array
    high: Array

    @property
    def deviation(self) -> float:
        """Mean absolute deviation of the counted shares from the model."""
        return float(np.abs(self.counted - self.model).mean())

    @property
    def inside(self) -> bool:
        """Whether all counted shares are in their intervals."""
        low, high = self.low - 1e-9, self.high + 1e-9
        return bool(((low <= self.counted) & (self.counted <= high)).all())


@dataclass(frozen=True)
class GTest:
    """Test of the hypothesis that the counts are multinomial with shares of the simulation.

    statistic : float
        G of the counts and the shares at the conditions that fit them best.
    p : float
        Probability of a statistic at least as large if the hypothesis is true, by parametric
        bootstrap: counts are drawn with these shares, and each table has its own best conditions.
    """

    statistic: float
    p: float


@dataclass(frozen=True)
class SurfaceComparison:
    """Whether the counts of two files can be of the same surface.

    overlap : float
        Share of the posterior of one surface in the 90 % region of the other; mean of both.
    p : float
        P value of the hypothesis that both have the same conditions. With the same parts, that of
        a two-sample G test (chi-squared distribution), which needs no simulation. Otherwise by
        parametric bootstrap, with the discrepancy.
    same_parts : bool
        Whether both files have the same parts, with the same groups and release.
    """

    one: str
    other: str
    overlap: float
    p: float
    same_parts: bool


def find_estimates(fit: Fit) -> list[Estimate]:
    """Return an estimate of each factor."""
    weights = fit.weights().sum(axis=0)
    found = []
    for k, factor in enumerate(fit.given.factors):
        start, end = shortest_interval(fit.candidates[:, k], weights)
        low, high = factor.values(np.array([start, end]))
        values = factor.values(fit.candidates[:, k])
        mean = float(weights @ values)
        deviation = float(np.sqrt(weights @ (values - mean) ** 2))
        best = float(factor.values(fit.best[k : k + 1])[0])
        for value in (best, mean):
            low, high = containing(value, low, high)
        determined = end - start <= WIDE
        found.append(Estimate(factor, best, mean, deviation, float(low), float(high), determined))
    return found


def shortest_interval(values: Array, weights: Array) -> tuple[float, float]:
    """Return the shortest interval with CONFIDENCE of the weights (n,) of values (n,)."""
    order = np.argsort(values)
    ordered, sums = values[order], np.cumsum(weights[order])
    before = sums - weights[order]
    ends = np.searchsorted(sums, np.minimum(before + CONFIDENCE * sums[-1], sums[-1]))
    possible = before <= (1 - CONFIDENCE) * sums[-1] + 1e-12
    ends = np.minimum(ends, len(values) - 1)
    lengths = np.where(possible, ordered[ends] - ordered, np.inf)
    first = int(lengths.argmin())
    return float(ordered[first]), float(ordered[ends[first]])


def find_discrepancy(fit: Fit) -> tuple[float, float, float]:
    """Return mean, low and high of the discrepancy."""
    weights, values = fit.weights().sum(axis=1), fit.discrepancies
    tail, sums = (1 - CONFIDENCE) / 2, np.cumsum(weights)
    ends = [min(int(np.searchsorted(sums, q)), len(values) - 1) for q in (tail, 1 - tail)]
    mean = float(weights @ values)
    low, high = containing(mean, *values[ends])
    return mean, float(low), float(high)


def correlation(fit: Fit, one: int, other: int) -> float:
    """Return the correlation of two factors, on the scales of their ranges."""
    points = fit.candidates[:, [one, other]]
    covariance = np.cov(points, rowvar=False, aweights=fit.weights().sum(axis=0))
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))


def predict(fit: Fit, rng: np.random.Generator, *, left_out: bool = False) -> list[Prediction]:
    """Return the prediction of each part from the counts of all, or of all others.

    Of a single part, there is no prediction from others.
    """
    parts = range(len(fit.given.parts))
    if left_out and len(parts) == 1:
        return []
    return [_prediction(fit, k, fit.weights(k if left_out else None), rng) for k in parts]


def _prediction(fit: Fit, k: int, weights: Array, rng: np.random.Generator) -> Prediction:
    """Return the prediction of a part with weights (r, m) of discrepancy and candidate."""
    part, (shares, error) = fit.given.parts[k], fit.shares[k]
    mean = weights.sum(axis=0) @ shares
    drawn = rng.choice(weights.size, DRAWS, p=weights.ravel() / weights.sum())
    row, point = np.unravel_index(drawn, weights.shape)
    model = dirichlet(shares[point], error[point], rng)
    real = dirichlet(model, fit.discrepancies[row] ** 2, rng)
    observed = rng.multinomial(part.drops, real) / part.drops
    tails = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
    of_model = containing(mean, *np.quantile(model, tails, axis=0))
    of_counts = containing(mean, *np.quantile(observed, tails, axis=0))
    return Prediction(part.shares, mean, *of_model, *of_counts)


def dirichlet(shares: Array, rho: Array, rng: np.random.Generator) -> Array:
    """Return Dirichlet shares (m, g) about shares, with intraclass correlations rho (m,)."""
    total = 1 / np.maximum(rho, 1e-7) - 1
    gammas = rng.standard_gamma(np.maximum(shares * total[:, None], 1e-6))
    return np.asarray(gammas / np.maximum(gammas.sum(axis=1, keepdims=True), 1e-300))


class Bootstrap:
    """G of tables of counts, at the candidate that fits them best.

    points : (m, d) float
    excess : float
        Variance of a share beyond that of sampling, over p (1 - p), in addition to the error of
        the simulated shares.
    """

    def __init__(self, models: Sequence[ShareModel], points: Array, excess: float = 0.0) -> None:
        found = [model.at(points) for model in models]
        self._shares, self._errors = zip(*found, strict=True)
        self._logs = [np.log(each) for each in self._shares]
        self._excess = excess

    def best(self, tables: Sequence[Counts]) -> tuple[float, int]:
        """Return G of tables (g,) of all parts, and the index of the candidate."""
        likelihood = sum(logs @ y for logs, y in zip(self._logs, tables, strict=True))
        k = int(likelihood.argmax())
        whole = sum(xlogy(y, y / y.sum()).sum() for y in tables)
        return max(0.0, 2 * float(whole - likelihood[k])), k

    def draw(self, k: int, drops: Sequence[int], rng: np.random.Generator) -> list[Counts]:
        """Return tables with the shares of a candidate, and the error of these shares."""
        drawn = []
        for shares, error, number in zip(self._shares, self._errors, drops, strict=True):
            rho = 1 - (1 - error[k : k + 1]) * (1 - self._excess)
            drawn.append(rng.multinomial(number, dirichlet(shares[k : k + 1], rho, rng)[0]))
        return drawn


def g_test(fit: Fit, rng: np.random.Generator) -> GTest:
    """Return the G test of all parts together."""
    tests = Bootstrap(fit.models, fit.candidates)
    found, k = tests.best([part.counts for part in fit.given.parts])
    drops = [part.drops for part in fit.given.parts]
    repeated = [tests.best(tests.draw(k, drops, rng))[0] for _ in range(REPETITIONS)]
    return GTest(found, _p(found, repeated))


def _p(found: float, repeated: Sequence[float]) -> float:
    return float((1 + (np.array(repeated) >= found - 1e-9).sum()) / (1 + len(repeated)))


def compare_surfaces(one: Fit, other: Fit, rng: np.random.Generator) -> SurfaceComparison:
    """Compare two surfaces whose factors have the same ranges; raises InvalidValueError."""
    names = one.given.surface, other.given.surface
    if one.given.factors != other.given.factors:
        raise InvalidValueError(
            f'{names[0]} and {names[1]} cannot be compared: expected the same ranges'
        )
    pairs = list(_same_parts(one, other))
    same = len(pairs) == len(one.given.parts) == len(other.given.parts)
    overlap = (_inside(one, other, rng) + _inside(other, one, rng)) / 2
    p = _two_sample(pairs) if same else _one_surface(one, other, rng)
    return SurfaceComparison(*names, overlap, p, same)


def _inside(one: Fit, other: Fit, rng: np.random.Generator) -> float:
    """Return the share of the posterior of one that is in the 90 % region of the other."""
    return float((other.log_density(one.draws(DRAWS, rng)) >= other.level(CONFIDENCE)).mean())


def _one_surface(one: Fit, other: Fit, rng: np.random.Generator) -> float:
    """Return the p value of the hypothesis that both have the same conditions.

    The statistic is by how much G of all counts is larger with common conditions than with two.
    """
    points = np.concatenate([one.candidates, other.candidates])
    fits = one, other
    excess = [find_discrepancy(each)[0] ** 2 for each in fits]
    tests = [Bootstrap(f.models, points, e) for f, e in zip(fits, excess, strict=True)]
    both = Bootstrap([*one.models, *other.models], points, max(excess))
    tables = [[part.counts for part in f.given.parts] for f in fits]
    drops = [part.drops for f in fits for part in f.given.parts]

    def statistic(first: list[Counts], second: list[Counts]) -> tuple[float, int]:
        common, k = both.best([*first, *second])
        return common - tests[0].best(first)[0] - tests[1].best(second)[0], k

    found, k = statistic(*tables)
    repeated = []
    for _ in range(REPETITIONS):
        drawn = both.draw(k, drops, rng)
        cut = len(one.given.parts)
        repeated.append(statistic(drawn[:cut], drawn[cut:])[0])
    return _p(found, repeated)


def _same_parts(one: Fit, other: Fit) -> Iterator[tuple[CountedPart, CountedPart]]:
    """Yield the parts that both have, with the same groups and release."""
    if one.given.base != other.given.base:
        return
    theirs = {part.part.part_sha256: part for part in other.given.parts}
    for part in one.given.parts:
        match = theirs.get(part.part.part_sha256)
        if match is not None and match.groups == part.groups and match.values == part.values:
            yield part, match


def _two_sample(pairs: list[tuple[CountedPart, CountedPart]]) -> float:
    """Return the p value of the G test that both counts of each part have the same shares."""
    statistic = sum(float(g_statistic(a.counts, b.counts)) for a, b in pairs)
    freedom = sum(int((a.counts + b.counts > 0).sum()) - 1 for a, b in pairs)
    return float(chi2.sf(statistic, freedom)) if freedom else 1.0
