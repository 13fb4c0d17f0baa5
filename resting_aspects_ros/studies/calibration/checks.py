"""Checks of a fit: whether it explains the counts, and predicts parts that were left out."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.special import xlogy

from resting_aspects_ros.core.statistics.intervals import containing
from resting_aspects_ros.studies.calibration.fit import Fit
from resting_aspects_ros.studies.calibration.likelihood import surrogate_rho
from resting_aspects_ros.studies.calibration.posterior import Posterior

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

CONFIDENCE = 0.9
REPETITIONS = 999
DRAWS = 4000
_BLOCK = 100


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
        G, with the conditions that fit best.
    p : float
        Probability of a statistic at least as large if the hypothesis is true, by parametric
        bootstrap: tables are drawn, and the conditions are fitted to each.
    """

    statistic: float
    p: float


def predict(fit: Fit, rng: np.random.Generator) -> list[Prediction]:
    """Return the prediction of each part from the counts of all."""
    return _predictions(fit, [fit.posterior.weights()] * len(fit.given.parts), rng)


def leave_one_out(fit: Fit, rng: np.random.Generator) -> list[Prediction]:
    """Return the prediction of each part from the counts of all others; none for one part."""
    parts = len(fit.given.parts)
    if parts == 1:
        return []
    return _predictions(fit, [fit.posterior.weights(without=k) for k in range(parts)], rng)


def g_test(fit: Fit, rng: np.random.Generator) -> GTest:
    """Return the G test of all parts together."""
    posterior = fit.posterior
    counts = [part.counts for part in fit.given.parts]
    logs = np.log(np.maximum(np.concatenate(posterior.shares, axis=1), 1e-12))
    found = _statistics(np.concatenate(counts)[None], counts, logs)
    best = int(found.best[0])
    # The shares at the best point are known only within the error of the surrogate.
    tables = []
    for part, surrogate in zip(fit.given.parts, fit.surrogates, strict=True):
        shares = surrogate.draws(posterior.points[best : best + 1], rng, REPETITIONS)[:, 0]
        tables.append(rng.multinomial(part.drops, shares / shares.sum(axis=1, keepdims=True)))
    repeated = _statistics(np.concatenate(tables, axis=1), counts, logs)
    reached = int((repeated.g >= found.g[0] - 1e-9).sum())
    return GTest(float(found.g[0]), (1 + reached) / (1 + REPETITIONS))


@dataclass(frozen=True, eq=False)
class _Statistics:
    g: Array
    best: npt.NDArray[np.int64]


def _statistics(tables: Array | Counts, parts: Sequence[Counts], logs: Array) -> _Statistics:
    """Return G and the best point of tables (b, cells), with log shares (n, cells)."""
    edges = np.cumsum([0, *(len(each) for each in parts)])
    saturated = np.zeros(len(tables))
    for first, end in pairwise(edges):
        own = tables[:, first:end]
        total = own.sum(axis=1)
        saturated += xlogy(own, own).sum(axis=1) - xlogy(total, total)
    fitted, best = np.empty(len(tables)), np.empty(len(tables), dtype=np.int64)
    for first in range(0, len(tables), _BLOCK):
        likelihood = tables[first : first + _BLOCK] @ logs.T
        best[first : first + _BLOCK] = likelihood.argmax(axis=1)
        fitted[first : first + _BLOCK] = likelihood.max(axis=1)
    return _Statistics(2 * (saturated - fitted), best)


def _predictions(fit: Fit, weights: Sequence[Array], rng: np.random.Generator) -> list[Prediction]:
    found = []
    posterior = fit.posterior
    for k, (part, own) in enumerate(zip(fit.given.parts, weights, strict=True)):
        shares, variances = posterior.shares[k], posterior.variances[k]
        mean = own.sum(axis=0) @ shares
        drawn = rng.choice(own.size, DRAWS, p=own.ravel() / own.sum())
        row, point = np.unravel_index(drawn, own.shape)
        model = _beta_like(shares[point], surrogate_rho(shares[point], variances[point]), rng)
        observed = _beta_like(model, _own_discrepancies(posterior, row, rng) ** 2, rng)
        observed = rng.multinomial(part.drops, observed) / part.drops
        tail = (1 - CONFIDENCE) / 2
        low, high = containing(mean, *np.quantile(model, [tail, 1 - tail], axis=0))
        wide = containing(mean, *np.quantile(observed, [tail, 1 - tail], axis=0))
        found.append(Prediction(part.shares, mean, low, high, *wide))
    return found


def _own_discrepancies(
    posterior: Posterior, row: npt.NDArray[np.int64], rng: np.random.Generator
) -> Array:
    """Return discrepancies (m,) of a part, drawn for rows (m,) of the common one."""
    below = posterior.own.cumsum(axis=1)[row]
    column = (rng.random((len(row), 1)) > below).sum(axis=1)
    return posterior.discrepancies[np.minimum(column, len(posterior.discrepancies) - 1)]


def _beta_like(shares: Array, rho: Array, rng: np.random.Generator) -> Array:
    """Return Dirichlet shares (m, g) about shares, with intraclass correlations rho (m,)."""
    total = 1 / np.maximum(rho, 1e-7) - 1
    gammas = rng.standard_gamma(np.maximum(shares * total[:, None], 1e-6))
    return np.asarray(gammas / np.maximum(gammas.sum(axis=1, keepdims=True), 1e-300))
