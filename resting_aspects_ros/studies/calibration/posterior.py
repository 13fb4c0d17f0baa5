"""The posterior of conditions, given counts: on points that fill the ranges evenly.

The counts of a part have a Dirichlet-multinomial distribution about the shares of the surrogate.
Its excess variance has two sources: the discrepancy, because a real part is no rigid body and a
hand is no release at random, and the uncertainty of the surrogate. With the discrepancy d, the
standard deviation of a share p about its model is d sqrt(p (1 - p)). Each part has its own d,
which varies about a common one like the scale of Student's t distribution. So a single part that
deviates by far more than the others has little effect on the result.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp, xlogy

from resting_aspects_ros.studies.calibration.likelihood import (
    likelihood_powers,
    log_density,
    own_discrepancies,
    surrogate_rho,
)
from resting_aspects_ros.studies.design import sobol
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

# Scale of the half-normal prior of the discrepancy: 5 points at a share of one half. Rigid-body
# models that are fitted to measured impacts still deviate from them (Fazeli, Zapolsky, Drumwright,
# Rodriguez 2017, Conference on Robot Learning); so the prior has little weight at 0, and little
# beyond 0.3, which would make any surface fit.
DISCREPANCY_SCALE = 0.1
DISCREPANCIES = np.array(
    [
        0.002,
        0.006,
        0.01,
        0.015,
        0.02,
        0.03,
        0.04,
        0.05,
        0.065,
        0.08,
        0.1,
        0.13,
        0.16,
        0.2,
        0.25,
        0.3,
    ]
)
# Points over the ranges; more if too few of them fit the counts.
GRID_SIDE = 180
POINTS = 1 << 14
MAX_POINTS = 1 << 18
MIN_EFFECTIVE = 300.0
_BLOCK = 1 << 14
SEED = 20


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weights of points that fill the unit cube of the factors evenly.

    points : (n, d) float
    shares : tuple of (n, g) float
        Shares of the surrogate for each part.
    variances : tuple of (n, g) float
        Their variances, from the surrogate's uncertainty.
    log_likelihood : (p, r, n) float
        Of each part, for each common discrepancy.
    discrepancies : (r,) float
    log_prior : (r,) float
        Of the common discrepancy.
    own : (r, r) float
        Probability of the discrepancy of a part, for each common one.
    dependence : float
        See dependence.py; 1 if the errors of the surrogates are independent.
    powers : (p,) float
        Of the likelihood of each part, which follow from the dependence.
    """

    points: Array
    shares: tuple[Array, ...]
    variances: tuple[Array, ...]
    log_likelihood: Array
    discrepancies: Array
    log_prior: Array
    own: Array
    dependence: float
    powers: Array

    def weights(self, without: int | None = None) -> Array:
        """Return the posterior (r, n) of discrepancy and point; ``without`` leaves out a part."""
        total = self.log_likelihood.sum(axis=0)
        if without is not None:
            total = total - self.log_likelihood[without]
        total = total + self.log_prior[:, None]
        return np.asarray(np.exp(total - logsumexp(total)))

    @property
    def density(self) -> Array:
        """Logarithm of the likelihood (n,) of all counts."""
        total = self.log_likelihood.sum(axis=0) + self.log_prior[:, None]
        return np.asarray(logsumexp(total, axis=0))

    @property
    def effective(self) -> float:
        """Number of equally weighted points that would be as good."""
        weights = self.weights().sum(axis=0)
        return float(1 / (weights**2).sum())


def find_posterior(
    dimensions: int,
    surrogates: Sequence[ShareSurrogate],
    counts: Sequence[Counts],
    *,
    discrepancy: bool = True,
    dependence: float = 1.0,
) -> Posterior:
    """Return the posterior, on a grid for one or two factors and on Sobol points for more."""
    if dimensions <= 2:
        return _posterior(_grid(dimensions), surrogates, counts, discrepancy, dependence)
    count = POINTS
    while True:
        points = sobol(dimensions, count, SEED)
        found = _posterior(points, surrogates, counts, discrepancy, dependence)
        if found.effective >= MIN_EFFECTIVE or count >= MAX_POINTS:
            return found
        count *= 4


def with_counts(posterior: Posterior, counts: Sequence[Counts]) -> Posterior:
    """Return the posterior of other counts of the same parts."""
    rows = [
        _log_likelihoods(
            each,
            posterior.shares[k],
            posterior.variances[k],
            posterior.discrepancies,
            posterior.own,
        )
        for k, each in enumerate(counts)
    ]
    return _with_powers(dataclasses.replace(posterior, log_likelihood=np.stack(rows)), counts)


def level_at(
    posterior: Posterior,
    surrogates: Sequence[ShareSurrogate],
    counts: Sequence[Counts],
    point: Array,
) -> float:
    """Return the probability of the smallest region that contains a point (d,).

    It is uniform from 0 to 1 if the point is where the counts come from.
    """
    exact = len(posterior.discrepancies) == 1
    here = _posterior(point[None], surrogates, counts, not exact, 1.0)
    rows = posterior.powers[:, None, None] * here.log_likelihood
    here = dataclasses.replace(here, log_likelihood=rows)
    return float(posterior.weights().sum(axis=0)[posterior.density > here.density[0]].sum())


def _posterior(
    points: Array,
    surrogates: Sequence[ShareSurrogate],
    counts: Sequence[Counts],
    discrepancy: bool,
    dependence: float,
) -> Posterior:
    blocks = np.array_split(points, max(1, len(points) // _BLOCK))
    moments = [[each.moments(block) for block in blocks] for each in surrogates]
    shares = tuple(np.concatenate([mean for mean, _ in each]) for each in moments)
    spread = tuple(np.concatenate([variances for _, variances in each]) for each in moments)
    values, log_prior = _discrepancies(discrepancy)
    own = own_discrepancies(values)
    rows = [
        _log_likelihoods(each, p, v, values, own)
        for each, p, v in zip(counts, shares, spread, strict=True)
    ]
    one = np.ones(len(counts))
    found = Posterior(
        points, shares, spread, np.stack(rows), values, log_prior, own, dependence, one
    )
    return _with_powers(found, counts)


def _with_powers(posterior: Posterior, counts: Sequence[Counts]) -> Posterior:
    """Return a posterior without powers with those that its dependence gives it.

    What the surrogates add to the variance of the counts depends on the point. It is taken where
    the posterior lies, which hardly depends on the powers: two passes are enough.
    """
    if posterior.dependence == 1:
        return dataclasses.replace(posterior, powers=np.ones(len(counts)))
    pairs = zip(posterior.shares, posterior.variances, strict=True)
    rho = np.stack([surrogate_rho(p, v) for p, v in pairs])
    drops = np.array([each.sum() for each in counts])
    found, weights = posterior, np.full(len(posterior.points), 1 / len(posterior.points))
    for _ in range(2):
        powers = likelihood_powers(rho @ weights, drops, posterior.dependence)
        rows = powers[:, None, None] * posterior.log_likelihood
        found = dataclasses.replace(posterior, log_likelihood=rows, powers=powers)
        weights = found.weights().sum(axis=0)
    return found


def _log_likelihoods(
    counts: Counts, shares: Array, variances: Array, values: Array, own: Array
) -> Array:
    """Return the log likelihood (r, n) of one part."""
    of_surrogate = surrogate_rho(shares, variances)
    if len(values) == 1 and values[0] == 0 and of_surrogate.max() < 1e-6:
        return np.asarray(xlogy(counts, shares).sum(axis=1))[None]
    found = np.stack(
        [log_density(counts, shares, 1 - (1 - d**2) * (1 - of_surrogate)) for d in values]
    )
    highest = found.max(axis=0)
    return np.asarray(np.log(own @ np.exp(found - highest)) + highest)


def _discrepancies(discrepancy: bool) -> tuple[Array, Array]:
    """Return the values of the discrepancy, and the logarithm of their prior."""
    if not discrepancy:
        return np.zeros(1), np.zeros(1)
    density = np.exp(-((DISCREPANCIES / DISCREPANCY_SCALE) ** 2) / 2)
    prior = density * np.gradient(DISCREPANCIES)
    return DISCREPANCIES, np.log(prior / prior.sum())


def _grid(dimensions: int) -> Array:
    side = GRID_SIDE if dimensions == 2 else GRID_SIDE**2
    middles = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(*[middles] * dimensions, indexing='ij'), axis=-1).reshape(
        -1, dimensions
    )
