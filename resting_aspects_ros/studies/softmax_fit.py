"""Multinomial logit models of counts, with a normal prior of the weights."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, helmert, solve_triangular
from scipy.special import log_softmax, softmax

Array = npt.NDArray[np.float64]

MAX_STEPS = 100
# Newton's method ends when the objective decreases by less than this, relative to its value.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class SoftmaxFit:
    """The most probable weights of a multinomial logit model, and their precision.

    The logits of the k classes are ``features @ weights @ contrasts``. The contrasts are
    orthonormal and sum to zero over the classes, so that no class is the reference.

    weights : (p, k - 1) float
    precision_root : (p (k - 1), p (k - 1)) float
        Upper triangular root R of the posterior precision R^T R of the raveled weights (Laplace's
        approximation).
    """

    weights: Array
    precision_root: Array

    @property
    def contrasts(self) -> Array:
        """Contrasts of the classes, (k - 1, k)."""
        return contrasts(self.weights.shape[1] + 1)

    def logits(self, features: Array) -> Array:
        """Return the logits (n, k) of points with these features (n, p)."""
        return np.asarray(features @ self.weights @ self.contrasts)

    def share_variances(self, features: Array) -> Array:
        """Return the variances (n, k) of the shares, to first order in the weights."""
        shares = softmax(self.logits(features), axis=1)
        basis = self.contrasts
        mean = shares @ basis.T
        found = np.empty_like(shares)
        for k in range(shares.shape[1]):
            slope = shares[:, k, None] * (basis[:, k] - mean)
            gradient = (features[:, :, None] * slope[:, None, :]).reshape(len(features), -1)
            scaled = solve_triangular(self.precision_root, gradient.T, trans='T')
            found[:, k] = (scaled**2).sum(axis=0)
        return found

    def drawn_logits(self, features: Array, normal: Array) -> Array:
        """Return draws (s, n, k) of the logits; ``normal`` (s, p (k - 1)) are standard normal."""
        shift = solve_triangular(self.precision_root, normal.T).T
        weights = self.weights + shift.reshape(-1, *self.weights.shape)
        return np.asarray(features @ weights @ self.contrasts)


def contrasts(classes: int) -> Array:
    """Return orthonormal contrasts, (k - 1, k)."""
    return np.asarray(helmert(classes), dtype=np.float64)


def fit_softmax(
    features: Array, counts: Array, precision: Array, start: Array | None = None
) -> SoftmaxFit:
    """Return the fit of counts by Newton's method; the objective is convex.

    Parameters
    ----------
    features : (m, p) float
    counts : (m, k) float
        Drops of each point by class, k >= 2.
    precision : (p,) float
        Inverse variance of the normal prior of each feature's weights, whose mean is 0.
    start : (p, k - 1) float, optional
        Initial weights.
    """
    basis = contrasts(counts.shape[1])
    shape = (features.shape[1], len(basis))
    weights = np.zeros(shape) if start is None else start
    totals = counts.sum(axis=1)
    value = _objective(weights, features, counts, precision, basis)
    for _ in range(MAX_STEPS):
        shares = softmax(features @ weights @ basis, axis=1)
        gradient = features.T @ ((totals[:, None] * shares - counts) @ basis.T)
        gradient += precision[:, None] * weights
        root = np.linalg.cholesky(_hessian(features, totals, shares, precision, basis)).T
        step = -cho_solve((root, False), gradient.ravel()).reshape(shape)
        weights, new = _line_search(weights, step, value, features, counts, precision, basis)
        if value - new <= TOLERANCE * (1 + abs(new)):
            break
        value = new
    shares = softmax(features @ weights @ basis, axis=1)
    root, _ = cho_factor(_hessian(features, totals, shares, precision, basis))
    return SoftmaxFit(weights, np.triu(root))


def log_evidence(found: SoftmaxFit, features: Array, counts: Array, precision: Array) -> float:
    """Return the logarithm of the probability of the counts for all weights of the prior.

    Laplace's approximation, up to a constant of the counts; the arguments are those of the fit.
    """
    value = _objective(found.weights, features, counts, precision, found.contrasts)
    prior = found.weights.shape[1] * float(np.log(precision).sum()) / 2
    return prior - value - float(np.log(np.abs(np.diag(found.precision_root))).sum())


def _objective(
    weights: Array, features: Array, counts: Array, precision: Array, basis: Array
) -> float:
    """Return the negative logarithm of the posterior density, without constants."""
    logs = log_softmax(features @ weights @ basis, axis=1)
    return float(-(counts * logs).sum() + (precision[:, None] * weights**2).sum() / 2)


def _hessian(
    features: Array, totals: Array, shares: Array, precision: Array, basis: Array
) -> Array:
    p, q = features.shape[1], len(basis)
    mean = shares @ basis.T
    spread = np.einsum('ac,nc,bc->nab', basis, shares, basis, optimize=True)
    spread = totals[:, None, None] * (spread - mean[:, :, None] * mean[:, None, :])
    blocks = np.empty((p, q, p, q))
    for a in range(q):
        for b in range(a + 1):
            blocks[:, a, :, b] = blocks[:, b, :, a] = features.T @ (
                spread[:, a, b, None] * features
            )
    hessian = blocks.reshape(p * q, p * q)
    hessian[np.diag_indices(p * q)] += np.repeat(precision, q)
    return hessian


def _line_search(
    weights: Array,
    step: Array,
    value: float,
    features: Array,
    counts: Array,
    precision: Array,
    basis: Array,
) -> tuple[Array, float]:
    """Return the weights after the largest of the steps 1, 1/2, 1/4, ... that decreases."""
    length = 1.0
    while length > 1e-6:
        moved = weights + length * step
        new = _objective(moved, features, counts, precision, basis)
        if new < value:
            return moved, new
        length /= 2
    return weights, value
