"""The posterior of the conditions of a surface, given counts of parts, and what follows from it.

Parts are dropped in the simulation at points of the ranges. The log odds of each share are a
polynomial of the conditions, which is fitted to these drops, with the weight of a point where the
counts are probable. Each point has its own random numbers, so that the errors of many points
average out, and the polynomial is checked by drops at the most probable conditions.

The counts of a part have a Dirichlet-multinomial distribution about the simulated shares. With
the discrepancy d, the standard deviation of a share p about its model is d sqrt(p (1 - p)) in
addition to sampling, because a real part is no rigid body, and a hand is no release at random. It
is common to all parts.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from scipy.special import expit, gammaln, logit, logsumexp

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.statistics.intervals import containing
from resting_aspects_ros.statistics.model_range import DISCREPANCY as MODEL_DISCREPANCY
from resting_aspects_ros.statistics.model_range import discrepancy
from resting_aspects_ros.studies.calibration.counts_file import SurfaceCounts
from resting_aspects_ros.studies.design import Factor, sobol

# Drops all parts at points (m, d) of the unit cube; returns counts (m, g) of each part, or None if
# it was stopped.
Simulate = Callable[[Array], list[Counts] | None]

# Discrepancies, and the scale of their half-normal prior: 5 points at a share of one half. Rigid
# bodies that are fitted to measured impacts still deviate from them (Fazeli, Zapolsky, Drumwright,
# Rodriguez 2017, Conference on Robot Learning), but beyond 0.3 any surface would fit.
DISCREPANCIES = np.geomspace(0.002, 0.3, 12)
DISCREPANCY_SCALE = 0.1
# Rounds in which half as many points as in the first one are added where the counts are probable.
ROUNDS = 2
# Of the polynomials, if there are at least three times as many points as coefficients.
DEGREE = 5
# Precision of the normal prior of coefficients, so that groups that never occur have a fit.
RIDGE = 0.5
# The log likelihood may be this much below its maximum before a point has little weight.
NEAR = 10.0
# Points at which the posterior is evaluated. They fill the box of all points whose log density is
# within MARGIN of the highest; the box is found in ZOOMS steps.
CANDIDATES, MARGIN, ZOOMS = 1 << 12, 12.0, 3
# Drops at the most probable conditions, in those of a point; repeated if they differ from the
# polynomials by more than DIFFERENCE standard errors.
REPEATED, CHECKS, DIFFERENCE = 8, 3, 4.0
# Of the credible intervals, and draws of a prediction.
CONFIDENCE, DRAWS = 0.9, 4000
# A condition is not determined if its interval is longer than this share of the range.
WIDE = 0.5
# Of a test by parametric bootstrap.
REPETITIONS = 499


def terms(points: Array, degree: int) -> Array:
    """Return the monomials (m, t) up to a degree of points (m, d) of the unit cube."""
    x = 2 * points - 1
    columns = [np.ones(len(x))]
    for power in range(1, degree + 1):
        axes = combinations_with_replacement(range(x.shape[1]), power)
        columns += [x[:, each].prod(axis=1) for each in axes]
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class ShareModel:
    """The shares of the groups of a part as functions of the conditions.

    coefficients : (t, g) float
        Of the log odds of each group.
    covariance : (g, t, t) float
        Of the coefficients, by the number of drops and by the misfit.
    misfit : float
        Variance of a share about the polynomial, beyond the drops, over p (1 - p).
    """

    degree: int
    coefficients: Array
    covariance: Array
    misfit: float

    @classmethod
    def of(cls, points: Array, counts: Counts, weights: Array) -> 'ShareModel':
        """Fit counts (n, g) of drops at points (n, d) with weights (n,)."""
        # The number of monomials of degree k in d dimensions is d + k over k.
        most, d = weights.sum() / 3, points.shape[1]
        degree = max(k for k in range(DEGREE + 1) if k == 0 or math.comb(d + k, k) <= most)
        x, drops = terms(points, degree), counts.sum(axis=1)
        fitted = [_logistic(x, each, drops, weights) for each in counts.T]
        coefficients, covariance, spread = zip(*fitted, strict=True)
        misfit = max(0.0, float(np.mean(spread)) - 1) / float(drops.mean())
        return cls(degree, np.stack(coefficients, axis=1), np.stack(covariance), misfit)

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return the shares (m, g), and the variance (m,) of their error over p (1 - p)."""
        x = terms(points, self.degree)
        shares = expit(x @ self.coefficients)
        shares = np.maximum(shares / shares.sum(axis=1, keepdims=True), 1e-9)
        variance = np.stack([((x @ each) * x).sum(axis=1) for each in self.covariance], axis=1)
        # A log odds with the variance v is a share with the variance v (p (1 - p))^2.
        error = (shares * shares * (1 - shares) * variance).sum(axis=1) + self.misfit
        return shares, np.minimum(error, 0.5)


def _logistic(x: Array, hits: Counts, drops: Counts, weights: Array) -> tuple[Array, Array, float]:
    """Return coefficients (t,), covariance (t, t) and chi2 per degree of freedom of a group."""
    found, ridge = np.zeros(x.shape[1]), np.full(x.shape[1], RIDGE)
    ridge[0] = 1e-6
    found[0] = logit((hits @ weights + 0.5) / (drops @ weights + 1))
    for _ in range(50):
        share = expit(np.clip(x @ found, -15, 15))
        precision = (x.T * (weights * drops * share * (1 - share))) @ x + np.diag(ridge)
        step = np.linalg.solve(precision, x.T @ (weights * (hits - drops * share)) - ridge * found)
        found = found + np.clip(step, -2, 2)
        if np.abs(step).max() < 1e-6:
            break
    expected = np.maximum(drops * share * (1 - share), 0.5)
    freedom = max(float(weights.sum()) - len(found), 1.0)
    spread = max(1.0, float(weights @ ((hits - drops * share) ** 2 / expected)) / freedom)
    return found, spread * np.linalg.inv(precision), spread


@dataclass(frozen=True, eq=False)
class Fit:
    """The posterior of the conditions and of the discrepancy, at candidates of equal prior.

    points : (n, d) float
        Of the unit cube of the factors, where the parts were dropped.
    simulated : tuple of (n, g) int
        Counts of the drops of each part.
    models : tuple of ShareModel
        Of each part.
    candidates : (m, d) float
        Of the unit cube.
    discrepancies : (r,) float
        Possible values; 0 if the counts are known to be of the simulation itself.
    checked : Array or None
        The most probable point (d,), at which parts were dropped as a check.
    deviations : tuple of (g,) float
        Shares of the drops there, less those of the polynomials before they were fitted to them.
    """

    given: SurfaceCounts
    points: Array
    simulated: tuple[Counts, ...]
    models: tuple[ShareModel, ...]
    candidates: Array
    discrepancies: Array
    checked: Array | None = None
    deviations: tuple[Array, ...] = ()

    @property
    def discrepancy(self) -> bool:
        """Whether real parts may deviate from the simulation."""
        return len(self.discrepancies) > 1

    @cached_property
    def shares(self) -> list[tuple[Array, Array]]:
        """Shares (m, g) and error (m,) of each part at the candidates."""
        return [model.at(self.candidates) for model in self.models]

    @cached_property
    def log_likelihood(self) -> Array:
        """Logarithm (p, r, m) of the probability of the counts of each part, up to a constant."""
        d2 = self.discrepancies[:, None] ** 2
        return np.stack(
            [
                log_density(part.counts, shares, 1 - (1 - d2) * (1 - error))
                for part, (shares, error) in zip(self.given.parts, self.shares, strict=True)
            ]
        )

    @cached_property
    def density(self) -> Array:
        """Log density (m,) of the posterior at the candidates, up to a constant."""
        return np.asarray(logsumexp(self.log_likelihood.sum(axis=0) + self._log_prior, axis=0))

    def weights(self, without: int | None = None) -> Array:
        """Return the posterior (r, m) of discrepancy and candidate; can leave out a part."""
        total = np.delete(self.log_likelihood, [] if without is None else [without], axis=0)
        logs = total.sum(axis=0) + self._log_prior
        return np.asarray(np.exp(logs - logsumexp(logs)))

    @property
    def _log_prior(self) -> Array:
        """Logarithm (r, 1) of the prior of the discrepancies."""
        values = self.discrepancies
        if not self.discrepancy:
            return np.zeros((1, 1))
        density = np.exp(-((values / DISCREPANCY_SCALE) ** 2) / 2) * np.gradient(values)
        return np.asarray(np.log(density / density.sum()))[:, None]

    def log_density(self, points: Array) -> Array:
        """Return the log density (m,) of the posterior at points (m, d), up to a constant."""
        return replace(self, candidates=points).density

    def level(self, region: float) -> float:
        """Return the log density above which the posterior has the probability ``region``."""
        order = np.argsort(-self.density)
        inside = np.cumsum(self.weights().sum(axis=0)[order])
        place = min(int(np.searchsorted(inside, region)), len(order) - 1)
        return float(self.density[order[place]])

    @cached_property
    def best(self) -> Array:
        """The middle (d,) of the 10 % of the posterior with the highest density.

        On a ridge, many points are nearly as probable; it is the candidate nearest to their mean.
        """
        if self.checked is not None:
            return self.checked
        high = self.candidates[self.density >= self.level(0.1)]
        nearest = ((high - high.mean(axis=0)) ** 2).sum(axis=1).argmin()
        return np.asarray(high[nearest])

    @property
    def simulated_drops(self) -> int:
        """Number of all simulated drops."""
        return int(sum(each.sum() for each in self.simulated))

    def draws(self, size: int, rng: np.random.Generator) -> Array:
        """Return points (size, d) of the unit cube, drawn from the posterior."""
        return self.candidates[rng.choice(len(self.candidates), size, p=self.weights().sum(0))]

    def probable(self, size: int, rng: np.random.Generator) -> Array:
        """Return points (size, d) for drops: where the counts of all parts but one are probable.

        They are drawn from the square root of the posteriors, which is wider.
        """
        some = range(len(self.given.parts)) if len(self.given.parts) > 1 else [None]
        chance = np.sqrt(sum(self.weights(without=k).sum(axis=0) for k in some))
        chance /= chance.sum()
        return self.candidates[rng.choice(len(chance), size, p=chance)]


def log_density(counts: Counts, shares: Array, rho: Array) -> Array:
    """Return the logarithm (...) of the probability of counts (..., g), up to a constant.

    Dirichlet-multinomial with shares (..., g) and intraclass correlation rho (...): the variance
    of a share is p (1 - p) (rho + (1 - rho) / n).
    """
    total = 1 / np.maximum(rho, 1e-7) - 1
    alpha = np.maximum(shares * total[..., None], 1e-12)
    over = gammaln(alpha + counts) - gammaln(alpha)
    return np.asarray(gammaln(total) - gammaln(total + counts.sum(axis=-1)) + over.sum(axis=-1))


def fit_surface(
    given: SurfaceCounts,
    simulate: Simulate,
    *,
    points: int,
    seed: int,
    discrepancy: bool = True,
) -> Fit | None:
    """Return the fit of counts; None if it was stopped before the first round was complete.

    Parameters
    ----------
    simulate : callable
        Drops the parts.
    points : int
        Number of points of the first design, which fill the ranges.
    """
    where = sobol(len(given.factors), points, seed)
    made = simulate(where)
    if made is None:
        return None
    values = DISCREPANCIES if discrepancy else np.zeros(1)
    fit = _fit(given, where, made, np.ones(points), values, seed)
    for number in range(ROUNDS):
        added = fit.probable(max(1, points // 2), np.random.default_rng((seed, number)))
        more = simulate(added)
        if more is None:
            return fit
        fit = _extended(fit, added, more, seed)
    for _ in range(CHECKS):
        best = np.tile(fit.best, (REPEATED, 1))
        more = simulate(best)
        if more is None:
            return fit
        deviations, differ = _check(fit, best[:1], more)
        fit = _extended(fit, best, more, seed, checked=best[0], deviations=deviations)
        if not differ:
            break
    return fit


def _fit(
    given: SurfaceCounts,
    points: Array,
    simulated: Sequence[Counts],
    weights: Array,
    discrepancies: Array,
    seed: int,
) -> Fit:
    """Return the fit with candidates where the counts of all parts, or of all but one, are."""
    models = tuple(ShareModel.of(points, each, weights) for each in simulated)
    d = points.shape[1]
    low, high = np.zeros(d), np.ones(d)
    for number in range(ZOOMS):
        candidates = low + (high - low) * sobol(d, CANDIDATES, seed + number)
        fit = Fit(given, points, tuple(simulated), models, candidates, discrepancies)
        near = np.zeros(CANDIDATES, dtype=np.bool_)
        for k in (None, *range(len(given.parts) if len(given.parts) > 1 else 0)):
            density = fit.weights(without=k).sum(axis=0)
            near |= density >= density.max() * np.exp(-MARGIN)
        slack = 0.05 * (high - low)
        low, high = (
            np.maximum(candidates[near].min(axis=0) - slack, 0),
            np.minimum(candidates[near].max(axis=0) + slack, 1),
        )
    return fit


def _extended(
    fit: Fit,
    points: Array,
    simulated: Sequence[Counts],
    seed: int,
    checked: Array | None = None,
    deviations: tuple[Array, ...] = (),
) -> Fit:
    """Return the fit with further points; where the counts are improbable, they weigh less."""
    points = np.concatenate([fit.points, points])
    pairs = zip(fit.simulated, simulated, strict=True)
    density = fit.log_density(points)
    weights = np.exp(np.clip((density - density.max()) / NEAR, -4, 0))
    joined = [np.concatenate(pair) for pair in pairs]
    found = _fit(fit.given, points, joined, weights, fit.discrepancies, seed)
    return replace(found, checked=checked, deviations=deviations)


def _check(fit: Fit, best: Array, simulated: Sequence[Counts]) -> tuple[tuple[Array, ...], bool]:
    """Return by how much the shares of drops at a point (1, d) differ, and whether too much."""
    deviations, differ = [], False
    for model, counts in zip(fit.models, simulated, strict=True):
        shares, error = model.at(best)
        dropped, number = counts.sum(axis=0) / counts.sum(), counts.sum()
        variance = shares[0] * (1 - shares[0]) * (error[0] + 1 / number)
        deviations.append(dropped - shares[0])
        differ |= bool((np.abs(deviations[-1]) > DIFFERENCE * np.sqrt(variance) + 0.002).any())
    return tuple(deviations), differ


# -- Estimates, predictions and the test of the fit -----------------------------------------------


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

    model : float
        Mean of the shares in the simulation.
    low, high : float
        Interval of the shares of as many drops as were counted, with the discrepancy.
    """

    counted: Array
    model: Array
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
class FitTest:
    """Test of the hypothesis that the counts are those of a surface within the ranges.

    Under the hypothesis, the log odds of each share deviate from the simulation as those of
    measured bodies do (see statistics.model_range), and the counts are multinomial.

    statistic : float
        The smallest sum over all shares of the squared deviation over its variance, times 1 - p:
        Pearson's chi2, if nothing but sampling made them deviate.
    p : float
        Probability of a statistic at least as large if the hypothesis is true, by parametric
        bootstrap: counts are drawn with the best conditions, and have their own best conditions.
    part, group : int
        Indices of the share that contributes most.
    """

    statistic: float
    p: float
    part: int
    group: int


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
    return Prediction(part.shares, mean, *containing(mean, *np.quantile(observed, tails, axis=0)))


def dirichlet(shares: Array, rho: Array, rng: np.random.Generator) -> Array:
    """Return Dirichlet shares (m, g) about shares, with intraclass correlations rho (m,)."""
    total = 1 / np.maximum(rho, 1e-7) - 1
    gammas = rng.standard_gamma(np.maximum(shares * total[:, None], 1e-6))
    return np.asarray(gammas / np.maximum(gammas.sum(axis=1, keepdims=True), 1e-300))


def deviated(shares: Array, scale: float, rng: np.random.Generator) -> Array:
    """Return shares (r, g) whose log odds deviate as those of measured bodies; see model_range."""
    p = np.clip(shares, 1e-9, 1 - 1e-9)
    squares = p**2
    # The log odds of a share also change with the other shares.
    others = (squares.sum(axis=1, keepdims=True) - squares) / (1 - p) ** 2
    spread = discrepancy(p, scale) / np.sqrt(1 + others)
    real = p * np.exp(spread * rng.standard_normal(p.shape))
    return np.asarray(real / real.sum(axis=1, keepdims=True))


def find_fit_test(fit: Fit, rng: np.random.Generator) -> FitTest:
    """Return the test of all parts together."""
    scale = MODEL_DISCREPANCY if fit.discrepancy else 0.0
    drops = [part.drops for part in fit.given.parts]
    weights = []  # (m, g) of the squared deviations of the counts of each part
    for n, (shares, _) in zip(drops, fit.shares, strict=True):
        # With the error of the shares, conditions where it is large would fit any counts.
        excess = shares * (1 - shares) * discrepancy(shares, scale) ** 2
        weights.append(1 / ((n + n**2 * excess) * shares))

    def statistics(tables: Sequence[Counts]) -> Array:
        """Return the sum (r, m) of tables (r, g) of each part at each candidate."""
        total = np.zeros((len(tables[0]), len(fit.candidates)))
        for y, n, (p, _), w in zip(tables, drops, fit.shares, weights, strict=True):
            total += y**2 @ w.T - 2 * y @ (n * p * w).T + ((n * p) ** 2 * w).sum(axis=1)
        return total

    counted = [part.counts for part in fit.given.parts]
    of_counted = statistics([each[None] for each in counted])[0]
    k = int(of_counted.argmin())
    drawn, terms = [], []
    for y, n, (shares, error), w in zip(counted, drops, fit.shares, weights, strict=True):
        own = dirichlet(np.tile(shares[k], (REPETITIONS, 1)), np.full(REPETITIONS, error[k]), rng)
        drawn.append(rng.multinomial(n, deviated(own, scale, rng)))
        terms.append((y - n * shares[k]) ** 2 * w[k])
    repeated = statistics(drawn).min(axis=1)
    found = max(0.0, float(of_counted[k]))
    p = float((1 + (repeated >= found - 1e-9).sum()) / (1 + REPETITIONS))
    worst = max(range(len(terms)), key=lambda j: float(terms[j].max()))
    return FitTest(found, p, worst, int(terms[worst].argmax()))
