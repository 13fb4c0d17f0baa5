"""What a fit says of each condition, whether it explains the counts, and predictions of parts."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp, ndtr, xlogy
from scipy.stats import chi2

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.comparison import g_statistic
from resting_aspects_ros.statistics.intervals import containing
from resting_aspects_ros.studies.calibration.counts_file import CountedPart
from resting_aspects_ros.studies.calibration.posterior import (
    Fit,
    log_prior,
    own_discrepancies,
    share_moments,
)
from resting_aspects_ros.studies.design import Factor

CONFIDENCE = 0.9
# A condition is not determined if its interval is longer than this share of the range.
WIDE = 0.5
DRAWS = 4000
# Of the G test.
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
        tolerance = 1e-9
        return bool(
            (self.counted >= self.low - tolerance).all()
            and (self.counted <= self.high + tolerance).all()
        )


@dataclass(frozen=True)
class GTest:
    """Test of the hypothesis that the counts are multinomial with shares of the simulation.

    statistic : float
        G of the counts and the mean shares of the posterior without discrepancy.
    p : float
        Probability of a statistic at least as large if the hypothesis is true, by parametric
        bootstrap: counts are drawn with these shares, and their own posterior is found.
    """

    statistic: float
    p: float


@dataclass(frozen=True)
class SurfaceComparison:
    """Whether the counts of two files can be of the same surface.

    overlap : float
        Common weight of the two posteriors: 1 if they are equal, 0 if no conditions fit both.
    log_ratio : float
        Logarithm of the ratio of the probabilities of all counts: two surfaces over one.
    same_parts : bool
        Whether both files have the same parts, with the same groups and release. Then the
        simulation deviates from both in the same way, so that only sampling is taken into account.
    same_parts_p : float or None
        P value of a two-sample G test of the parts that both files have (chi-squared
        distribution); None without such a part. It needs no simulation.
    """

    one: str
    other: str
    overlap: float
    log_ratio: float
    same_parts: bool
    same_parts_p: float | None


def find_estimates(fit: Fit, rng: np.random.Generator) -> list[Estimate]:
    """Return an estimate of each factor."""
    drawn = fit.draws(DRAWS, rng)
    best = best_point(fit, rng)
    found = []
    for k, factor in enumerate(fit.given.factors):
        start, end = shortest_interval(drawn[:, k])
        low, high = factor.values(np.array([start, end]))
        values = factor.values(drawn[:, k])
        mean = float(values.mean())
        best_value = float(factor.values(best[k : k + 1])[0])
        for value in (best_value, mean):
            low, high = containing(value, low, high)
        found.append(
            Estimate(
                factor,
                best_value,
                mean,
                float(values.std()),
                float(low),
                float(high),
                end - start <= WIDE,
            )
        )
    return found


def best_point(fit: Fit, rng: np.random.Generator) -> Array:
    """Return the most probable point (d,) of the unit cube.

    The density is that of the normal scores, which is highest in the middle of a range that the
    counts do not narrow. On a ridge many points are nearly as probable. Among those with at least
    90 % of the highest density, it is the one nearest to their mean.
    """
    scores = fit.smooth.draw(DRAWS // 4, rng)
    density = fit.smooth.log_density(scores)
    high = scores[density >= density.max() + np.log(0.9)]
    nearest = ((high - high.mean(axis=0)) ** 2).sum(axis=1).argmin()
    return np.asarray(ndtr(high[nearest]))


def shortest_interval(values: Array) -> tuple[float, float]:
    """Return the shortest interval with CONFIDENCE of the values (n,)."""
    ordered = np.sort(values)
    inside = int(np.ceil(CONFIDENCE * len(values)))
    lengths = ordered[inside - 1 :] - ordered[: len(values) - inside + 1]
    first = int(lengths.argmin())
    return float(ordered[first]), float(ordered[first + inside - 1])


def find_discrepancy(fit: Fit) -> tuple[float, float, float]:
    """Return mean, low and high of the common discrepancy."""
    weights, values = fit.weights().sum(axis=1), fit.discrepancies
    tail, sums = (1 - CONFIDENCE) / 2, np.cumsum(weights)
    low, high = (
        values[min(int(np.searchsorted(sums, q)), len(values) - 1)] for q in (tail, 1 - tail)
    )
    mean = float(weights @ values)
    low, high = containing(mean, low, high)
    return mean, float(low), float(high)


def correlation(fit: Fit, one: int, other: int) -> float:
    """Return the correlation of two factors, on the scales of their ranges."""
    weights, points = fit.weights().sum(axis=0), fit.points[:, [one, other]]
    covariance = np.cov(points, rowvar=False, aweights=weights)
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))


def predict(fit: Fit, rng: np.random.Generator, *, left_out: bool = False) -> list[Prediction]:
    """Return the prediction of each part from the counts of all, or of all others.

    Of a single part, there is no prediction from others.
    """
    parts = range(len(fit.given.parts))
    if left_out and len(parts) == 1:
        return []
    weights = [fit.weights(without=k if left_out else None) for k in parts]
    return [_prediction(fit, k, each, rng) for k, each in zip(parts, weights, strict=True)]


def _prediction(fit: Fit, k: int, weights: Array, rng: np.random.Generator) -> Prediction:
    """Return the prediction of a part with weights (r, n) of discrepancy and point."""
    part = fit.given.parts[k]
    shares, rho = share_moments(fit.simulated[k])
    mean = weights.sum(axis=0) @ shares
    drawn = rng.choice(weights.size, DRAWS, p=weights.ravel() / weights.sum())
    row, point = np.unravel_index(drawn, weights.shape)
    model = _dirichlet(shares[point], rho[point], rng)
    below = own_discrepancies(fit.discrepancies).cumsum(axis=1)[row]
    column = (rng.random((DRAWS, 1)) > below).sum(axis=1)
    own = fit.discrepancies[np.minimum(column, len(fit.discrepancies) - 1)]
    observed = rng.multinomial(part.drops, _dirichlet(model, own**2, rng)) / part.drops
    tails = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
    of_model = containing(mean, *np.quantile(model, tails, axis=0))
    of_counts = containing(mean, *np.quantile(observed, tails, axis=0))
    return Prediction(part.shares, mean, *of_model, *of_counts)


def _dirichlet(shares: Array, rho: Array, rng: np.random.Generator) -> Array:
    """Return Dirichlet shares (m, g) about shares, with intraclass correlations rho (m,)."""
    total = 1 / np.maximum(rho, 1e-7) - 1
    gammas = rng.standard_gamma(np.maximum(shares * total[:, None], 1e-6))
    return np.asarray(gammas / np.maximum(gammas.sum(axis=1, keepdims=True), 1e-300))


def g_test(fit: Fit, rng: np.random.Generator) -> GTest:
    """Return the G test of all parts together."""
    found, shares = _fitted_g(fit, [part.counts for part in fit.given.parts])
    repeated = []
    for _ in range(REPETITIONS):
        drawn = zip(fit.given.parts, shares, strict=True)
        tables = [rng.multinomial(part.drops, each) for part, each in drawn]
        repeated.append(_fitted_g(fit, tables)[0])
    reached = int((np.array(repeated) >= found - 1e-9).sum())
    return GTest(found, (1 + reached) / (1 + REPETITIONS))


def _fitted_g(fit: Fit, counts: list[Counts]) -> tuple[float, list[Array]]:
    """Return G of the counts of all parts, and the shares (g,) of each part that fit them."""
    pairs = zip(fit.given.parts, counts, strict=True)
    given = replace(fit.given, parts=tuple(replace(part, counts=each) for part, each in pairs))
    weights = replace(fit, given=given, discrepancy=False).weights()[0]
    shares = [weights @ share_moments(each)[0] for each in fit.simulated]
    found = sum(
        2 * xlogy(each, each / (each.sum() * own)).sum()
        for each, own in zip(counts, shares, strict=True)
    )
    return float(found), shares


def compare_surfaces(one: Fit, other: Fit, rng: np.random.Generator) -> SurfaceComparison:
    """Compare two surfaces whose factors have the same ranges; raises InvalidValueError."""
    names = one.given.surface, other.given.surface
    if one.given.factors != other.given.factors:
        raise InvalidValueError(
            f'{names[0]} and {names[1]} cannot be compared: expected the same ranges'
        )
    pairs = list(_same_parts(one, other))
    same = len(pairs) == len(one.given.parts) == len(other.given.parts)
    found = _with_same_parts(one, other) if same else _with_other_parts(one, other, rng)
    return SurfaceComparison(*names, *found, same, _p_value(pairs))


def _with_same_parts(one: Fit, other: Fit) -> tuple[float, float]:
    """Return overlap and log ratio, without discrepancy: each drop tells of the counts of both."""
    overlaps, separate, common = [], 0.0, []
    for own, another in ((one, other), (other, one)):
        counts = {part.part.part_sha256: part.counts for part in another.given.parts}
        parts = tuple(
            replace(part, counts=counts[part.part.part_sha256]) for part in own.given.parts
        )
        mine = replace(own, discrepancy=False)
        theirs = replace(mine, given=replace(own.given, parts=parts))
        overlaps.append(float(np.minimum(mine.weights(), theirs.weights()).sum()))
        prior = own.log_ratio - logsumexp(own.log_ratio)
        logs = [each.log_likelihood.sum(axis=(0, 1)) for each in (mine, theirs)]
        separate += float(logsumexp(logs[0] + prior))
        common.append(logsumexp(logs[0] + logs[1] + prior))
    return float(np.mean(overlaps)), separate - float(logsumexp(common) - np.log(2))


def _with_other_parts(one: Fit, other: Fit, rng: np.random.Generator) -> tuple[float, float]:
    """Return overlap and log ratio from the smooth posteriors.

    The probability of all counts with one surface, over that with two, is the integral of the
    product of both posteriors over the prior.
    """
    overlaps, ratios = [], []
    for own, another in ((one, other), (other, one)):
        scores = own.smooth.draw(DRAWS, rng)
        mine, theirs = own.smooth.log_density(scores), another.smooth.log_density(scores)
        overlaps.append(float(np.minimum(1, np.exp(theirs - mine)).mean()))
        ratios.append(float(np.exp(theirs - log_prior(scores)).mean()))
    return float(np.mean(overlaps)), float(-np.log(max(float(np.mean(ratios)), 1e-300)))


def _same_parts(one: Fit, other: Fit) -> Iterator[tuple[CountedPart, CountedPart]]:
    """Yield the parts that both have, with the same groups and release."""
    if one.given.base != other.given.base:
        return
    theirs = {part.part.part_sha256: part for part in other.given.parts}
    for part in one.given.parts:
        match = theirs.get(part.part.part_sha256)
        if match is not None and match.groups == part.groups and match.values == part.values:
            yield part, match


def _p_value(pairs: list[tuple[CountedPart, CountedPart]]) -> float | None:
    statistic = sum(float(g_statistic(a.counts, b.counts)) for a, b in pairs)
    freedom = sum(int((a.counts + b.counts > 0).sum()) - 1 for a, b in pairs)
    return float(chi2.sf(statistic, freedom)) if freedom else None
