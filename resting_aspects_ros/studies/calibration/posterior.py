"""The posterior of the conditions of a surface, given counts, by importance sampling.

Parts are dropped in the simulation at points of the ranges, at first everywhere, then where the
counts are probable (population Monte Carlo; the weights are those of a deterministic mixture:
Cornuet, Marin, Mira, Robert 2012, Scandinavian Journal of Statistics 39:798). No model of the
shares connects the points. What the drops at a point leave open widens the likelihood there.

The counts of a part have a Dirichlet-multinomial distribution about the simulated shares. Its
excess variance has two sources: the number of simulated drops, and the discrepancy, because a real
part is no rigid body and a hand is no release at random. With the discrepancy d, the standard
deviation of a share p about its model is d sqrt(p (1 - p)). Each part has its own d, which varies
about a common one like the scale of Student's t distribution. So a single part that deviates by
far more than the others has little effect on the result.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist
from scipy.special import gammaln, logsumexp, ndtr, ndtri
from scipy.stats import chi2

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.studies.calibration.counts_file import SurfaceCounts
from resting_aspects_ros.studies.design import sobol

# Drops all parts at points (m, d) of the unit cube; returns counts (m, g) of each part, or None if
# it was stopped.
Simulate = Callable[[Array], list[Counts] | None]

# Common discrepancies, and the scale of their half-normal prior: 5 points at a share of one half.
# Rigid-body models that are fitted to measured impacts still deviate from them (Fazeli, Zapolsky,
# Drumwright, Rodriguez 2017, Conference on Robot Learning); so the prior has little weight at 0,
# and little beyond 0.3, which would make any surface fit.
DISCREPANCIES = np.geomspace(0.002, 0.3, 16)
DISCREPANCY_SCALE = 0.1
# Degrees of freedom of the discrepancies of parts about the common one.
FREEDOM = 4
# Points are added until this number of equally weighted points would be as good.
EFFECTIVE = 100.0
MAX_ROUNDS = 16
# Share of the new points that is drawn from the whole ranges.
PRIOR_SHARE = 0.1
# Least shares of the ranges, because the normal scores of 0 and 1 are infinite.
_EDGE = 1e-9
_BLOCK = 1 << 22  # distances at once


@dataclass(frozen=True, eq=False)
class Fit:
    """Points at which the parts were dropped, and how probable their drops make the counts.

    points : (n, d) float
        Of the unit cube of the factors.
    simulated : tuple of (n, g) int
        Counts of the simulated drops of each part at the points.
    log_ratio : (n,) float
        Logarithm of the density of the prior over that of the points.
    discrepancy : bool
        False if the counts are known to be of the simulation itself.
    rounds : int
        How often points were added.
    """

    given: SurfaceCounts
    points: Array
    simulated: tuple[Counts, ...]
    log_ratio: Array
    discrepancy: bool = True
    rounds: int = 0

    @property
    def discrepancies(self) -> Array:
        """Possible values (r,) of the common discrepancy."""
        return DISCREPANCIES if self.discrepancy else np.zeros(1)

    @cached_property
    def log_likelihood(self) -> Array:
        """Logarithm (p, r, n) of the probability of the counts of each part, up to a constant."""
        pairs = zip(self.given.parts, self.simulated, strict=True)
        return np.stack([_log_likelihood(a.counts, s, self.discrepancies) for a, s in pairs])

    def weights(self, without: int | None = None) -> Array:
        """Return the posterior (r, n) of discrepancy and point; ``without`` leaves out a part."""
        total = np.delete(self.log_likelihood, [] if without is None else [without], axis=0)
        logs = total.sum(axis=0) + self.log_ratio + _log_prior(self.discrepancies)[:, None]
        return np.asarray(np.exp(logs - logsumexp(logs)))

    @property
    def effective(self) -> float:
        """Number of equally weighted points that would be as good."""
        return float(1 / (self.weights().sum(axis=0) ** 2).sum())

    @property
    def simulated_drops(self) -> int:
        """Number of all simulated drops."""
        return int(sum(each.sum() for each in self.simulated))

    @property
    def errors(self) -> Array:
        """(p,) standard deviation of the simulated shares relative to that of the counted ones."""
        rows, points = self.weights().sum(axis=1), self.weights().sum(axis=0)
        excess = float(rows @ own_discrepancies(self.discrepancies) @ self.discrepancies**2)
        found = []
        for part, simulated in zip(self.given.parts, self.simulated, strict=True):
            error = points @ (1 / (simulated.sum(axis=1) + 1))
            found.append(np.sqrt(error / (1 / part.drops + excess)))
        return np.array(found)

    def density(self, points: Array, *axes: int) -> Array:
        """Return the density (m,) of the smooth posterior of some of the factors.

        ``points`` (m, k) are of the unit cube of these factors, where the prior has the density 1.
        """
        scores = _scores(points)
        return np.exp(self.smooth.marginal(*axes).log_density(scores) - log_prior(scores))

    @cached_property
    def smooth(self) -> 'Mixture':
        """The posterior of the normal scores as a smooth density of the same mean and covariance.

        Each point is drawn towards the mean and spread by a normal distribution (West 1993,
        Journal of the Royal Statistical Society B 55:409), so that an interval does not depend on
        single points.
        """
        weights = self.weights().sum(axis=0)
        scores, width = _scores(self.points), bandwidth(weights, self.points.shape[1])
        mean = weights @ scores
        centres = mean + np.sqrt(1 - width**2) * (scores - mean)
        return Mixture(centres, weights, width * _root(scores, weights))

    def draws(self, size: int, rng: np.random.Generator) -> Array:
        """Return points (size, d) of the unit cube, drawn from the smooth posterior."""
        return np.asarray(ndtr(self.smooth.draw(size, rng)))


@dataclass(frozen=True, eq=False)
class Mixture:
    """Normal distributions of equal covariance about centres, and the prior of normal scores.

    Normal scores are the standard normal quantiles of the coordinates in the unit cube: the prior,
    which is uniform there, is then standard normal, and there are no borders.

    centres : (n, d) float
    weights : (n,) float
    root : (d, d) float
        Lower triangular root of the covariance.
    prior : float
        Share of the prior.
    """

    centres: Array
    weights: Array
    root: Array
    prior: float = 0.0

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Return normal scores (size, d)."""
        found = rng.standard_normal((size, len(self.root)))
        near = rng.random(size) >= self.prior
        chosen = rng.choice(len(self.weights), size, p=self.weights)
        found[near] = self.centres[chosen[near]] + found[near] @ self.root.T
        return np.asarray(found)

    def marginal(self, *axes: int) -> 'Mixture':
        """Return the distribution of some of the coordinates."""
        covariance = (self.root @ self.root.T)[np.ix_(axes, axes)]
        return Mixture(
            self.centres[:, axes], self.weights, np.linalg.cholesky(covariance), self.prior
        )

    def log_density(self, scores: Array) -> Array:
        """Return the logarithm (m,) of the density at normal scores (m, d)."""
        d = len(self.root)
        centres = solve_triangular(self.root, self.centres.T, lower=True).T
        blocks = np.array_split(scores, max(1, len(scores) * len(centres) // _BLOCK))
        found = np.concatenate(
            [
                logsumexp(-cdist(each, centres, 'sqeuclidean') / 2, axis=1, b=self.weights)
                for each in (solve_triangular(self.root, b.T, lower=True).T for b in blocks)
            ]
        )
        found -= np.log(np.diag(self.root)).sum() + d / 2 * np.log(2 * np.pi)
        with np.errstate(divide='ignore'):
            shares = np.log([1 - self.prior, self.prior])
        return np.logaddexp(shares[0] + found, shares[1] + log_prior(scores))


def fit_surface(
    given: SurfaceCounts,
    simulate: Simulate,
    *,
    points: int,
    seed: int,
    discrepancy: bool = True,
    rounds: int = MAX_ROUNDS,
    note: Callable[[Fit], None] = lambda _: None,
) -> Fit | None:
    """Return the fit of counts; None if it was stopped before the first round was complete.

    Parameters
    ----------
    simulate : callable
        Drops the parts.
    points : int
        Number of points of the first design; half as many are added in each round.
    rounds : int
        Maximum number of rounds.
    note : callable
        Called before each round, with the fit so far.
    """
    design = sobol(len(given.factors), points, seed)
    simulated = simulate(design)
    proposals: list[Mixture] = []
    found = None
    while simulated is not None:
        ratio = _log_ratio(design, points, proposals)
        found = Fit(given, design, tuple(simulated), ratio, discrepancy, len(proposals))
        if found.effective >= EFFECTIVE or found.rounds == rounds:
            break
        note(found)
        proposals.append(_proposal(found))
        rng = np.random.default_rng((seed, found.rounds))
        new = ndtr(proposals[-1].draw(points // 2, rng))
        added = simulate(new)
        if added is None:
            break
        design = np.concatenate([design, new])
        simulated = [np.concatenate(pair) for pair in zip(simulated, added, strict=True)]
    return found


def _log_ratio(points: Array, first: int, proposals: list[Mixture]) -> Array:
    """Return the logarithm (n,) of the density of the prior over that of all points together.

    The ``first`` points fill the unit cube, and each proposal drew an equal share of the others.
    """
    scores = _scores(points)
    prior = log_prior(scores)
    densities = np.stack([prior, *(each.log_density(scores) for each in proposals)])
    shares = np.full(len(densities), (len(points) - first) / max(1, len(proposals)) / len(points))
    shares[0] = first / len(points)
    return np.asarray(prior - logsumexp(densities, axis=0, b=shares[:, None]))


def _proposal(fit: Fit) -> Mixture:
    """Return the distribution of new points: that of the posterior so far, and of the prior."""
    weights = fit.weights().sum(axis=0)
    d = fit.points.shape[1]
    # Few points with large weights by chance must not attract all new ones: weights to a power.
    power = 1.0
    while True:
        tempered = weights**power / (weights**power).sum()
        if 1 / (tempered**2).sum() >= min(5 * (d + 1), len(weights) / 4):
            break
        power *= 0.8
    scores = _scores(fit.points)
    root = bandwidth(tempered, d) * _root(scores, tempered)
    return Mixture(scores, tempered, root, PRIOR_SHARE)


def log_prior(scores: Array) -> Array:
    """Return the logarithm (m,) of the standard normal density of normal scores (m, d)."""
    return np.asarray(-(scores**2 + np.log(2 * np.pi)).sum(axis=1) / 2)


def log_density(counts: Counts, shares: Array, rho: Array) -> Array:
    """Return the logarithm (...) of the probability of counts (..., g), up to a constant.

    Dirichlet-multinomial with shares (..., g) and intraclass correlation rho (...): the variance
    of a share is p (1 - p) (rho + (1 - rho) / n).
    """
    total = 1 / np.maximum(rho, 1e-7) - 1
    alpha = np.maximum(shares * total[..., None], 1e-12)
    over = gammaln(alpha + counts) - gammaln(alpha)
    return np.asarray(gammaln(total) - gammaln(total + counts.sum(axis=-1)) + over.sum(axis=-1))


def share_moments(simulated: Counts) -> tuple[Array, Array]:
    """Return the shares (n, g) of simulated drops, and their intraclass correlation (n,).

    They are those of a Dirichlet distribution, whose prior is worth one drop.
    """
    alpha = simulated + 1 / simulated.shape[1]
    total = alpha.sum(axis=1)
    return np.asarray(alpha / total[:, None]), np.asarray(1 / (1 + total))


def own_discrepancies(values: Array) -> Array:
    """Return the probability (r, r) of each discrepancy of a part, for each common one.

    The part has d sqrt(f / x), where x has a chi-squared distribution with f degrees of freedom;
    what is beyond the values is in the first and the last of them.
    """
    if len(values) == 1:
        return np.ones((1, 1))
    edges = np.sqrt(values[1:] * values[:-1])
    below = chi2.sf(FREEDOM * (values[:, None] / edges) ** 2, FREEDOM)
    return np.diff(below, axis=1, prepend=0.0, append=1.0)


def bandwidth(weights: Array, d: int) -> float:
    """Return the width of a kernel relative to the standard deviation of weighted points.

    The rule of Scott (1992, Multivariate Density Estimation) for the effective number of points.
    """
    return float(min(0.9, (1 / (weights**2).sum()) ** (-1 / (d + 4))))


def _log_likelihood(counts: Counts, simulated: Counts, discrepancies: Array) -> Array:
    """Return the logarithm (r, n) of the probability of the counts of a part."""
    shares, error = share_moments(simulated)
    rho = 1 - (1 - discrepancies[:, None] ** 2) * (1 - error)
    found = log_density(counts, shares, rho)
    highest = found.max(axis=0)
    mixed = own_discrepancies(discrepancies) @ np.exp(found - highest)
    return np.asarray(np.log(np.maximum(mixed, 1e-300)) + highest)


def _log_prior(discrepancies: Array) -> Array:
    if len(discrepancies) == 1:
        return np.zeros(1)
    density = np.exp(-((discrepancies / DISCREPANCY_SCALE) ** 2) / 2)
    prior = density * np.gradient(discrepancies)
    return np.asarray(np.log(prior / prior.sum()))


def _scores(points: Array) -> Array:
    return np.asarray(ndtri(np.clip(points, _EDGE, 1 - _EDGE)))


def _root(scores: Array, weights: Array) -> Array:
    """Return the lower triangular root (d, d) of the covariance of weighted scores (n, d)."""
    centred = scores - weights @ scores
    covariance = (weights[:, None] * centred).T @ centred
    return np.asarray(np.linalg.cholesky(covariance + 1e-9 * np.eye(scores.shape[1])))
