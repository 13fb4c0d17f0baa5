"""The probability of counts: Dirichlet-multinomial, with parts that deviate unequally."""

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln
from scipy.stats import chi2

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

# Degrees of freedom of the distribution of the discrepancies of parts about the common one.
FREEDOM = 4
_MIN_RHO = 1e-7


def log_density(counts: Counts, shares: Array, rho: Array) -> Array:
    """Return the logarithm (...) of the probability of counts (..., g), up to a constant.

    Dirichlet-multinomial with shares (..., g) and intraclass correlation rho (...): the variance
    of a share is p (1 - p) (rho + (1 - rho) / n).
    """
    total = 1 / np.maximum(rho, _MIN_RHO) - 1
    alpha = np.maximum(shares * total[..., None], 1e-12)
    over = gammaln(alpha + counts) - gammaln(alpha)
    return np.asarray(gammaln(total) - gammaln(total + counts.sum(axis=-1)) + over.sum(axis=-1))


def surrogate_rho(shares: Array, variances: Array) -> Array:
    """Return the uncertainty of the surrogate (n,) as an intraclass correlation."""
    ratio = variances.sum(axis=1) / np.maximum((shares * (1 - shares)).sum(axis=1), 1e-9)
    return np.asarray(np.minimum(ratio, 0.5))


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


def likelihood_powers(rho: Array, drops: Counts, dependence: float) -> Array:
    """Return the power (p,) of the likelihood of each part.

    A share of the variance of counts is from the surrogate, which has the intraclass correlation
    rho (p,). This share is larger by the dependence in what all parts together tell.
    """
    share = rho / (rho + 1 / np.maximum(drops, 1))
    return np.asarray(1 / (1 + (dependence - 1) * share))
