"""A smooth model of the shares of the classes over conditions, fitted to drops at some points.

The logits of the shares are a polynomial, or a polynomial and a Gaussian process. Which one is
chosen by cross-validation. The drops at a point are multinomial, so that few drops at many points
are as good as many drops at few points, and a class without drops at a point is no special case.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy.special import log_softmax, softmax

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.studies.softmax_fit import Array, SoftmaxFit, fit_softmax

FOLDS = 8
# Standard deviation of the prior of the mean logits, and of the weights of degree 1. Those of
# degree d are smaller by d.
PRIOR_MEAN, PRIOR_SLOPE = 10.0, 2.0
# Number of corners of a Gaussian process; more would cost time and change little.
MAX_CORNERS = 80
MAX_INFLATION = 100.0
SIGNIFICANT = 1.0  # standard errors
# Drops that are added to each class, divided among all points. Without any, the logit of a class
# that was never seen has no maximum, and its normal approximation is far too wide.
ADDED = 1.0


@dataclass(frozen=True, eq=False)
class Form:
    """A form of the logits over the unit cube.

    degree : int
        Total degree of the polynomial.
    length : float
        Correlation length of the Gaussian process; 0: only the polynomial.
    size : float
        Standard deviation of the Gaussian process.
    corners : (c, d) float
        Points at which the Gaussian process has its weights.
    """

    degree: int
    length: float = 0.0
    size: float = 1.0
    corners: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def text(self) -> str:
        """Describe the form."""
        text = f'polynomial of degree {self.degree}'
        if not self.length:
            return text
        return f'{text} and a Gaussian process of length {self.length:g}, size {self.size:g}'

    def features(self, points: Array) -> Array:
        """Return the features (n, p) of points (n, d)."""
        found = _polynomial(points, self.degree)
        if not self.length:
            return found
        root = np.linalg.cholesky(
            self._kernel(self.corners, self.corners) + 1e-6 * np.eye(len(self.corners))
        )
        process = np.linalg.solve(root, self._kernel(self.corners, points)).T
        return np.hstack([found, process])

    def precision(self, dimensions: int) -> Array:
        """Return the precision (p,) of the prior of the weights."""
        degrees = np.array([len(term) for term in _terms(dimensions, self.degree)], dtype=float)
        found = np.where(degrees == 0, PRIOR_MEAN, PRIOR_SLOPE / np.maximum(degrees, 1)) ** -2.0
        return np.concatenate([found, np.full(len(self.corners), self.size**-2.0)])

    def _kernel(self, a: Array, b: Array) -> Array:
        distance = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        return np.asarray(np.exp(-distance / (2 * self.length**2)))


@dataclass(frozen=True, eq=False)
class ShareSurrogate:
    """Shares of k classes over the unit cube, with their uncertainty.

    cross_validated_error : float
        Root mean square, over points and classes, of the difference between the share predicted
        without a point and the true share there: the variance of the drops of the point is
        subtracted. It is 0 if the drops alone explain the differences.
    inflation : float
        Factor of the variance of the draws. It is more than 1 if the cross-validated error is
        larger than the uncertainty of the fit, because the form does not fit.
    """

    form: Form
    fitted: SoftmaxFit
    cross_validated_error: float
    inflation: float

    @classmethod
    def fit(
        cls, points: Array, counts: npt.ArrayLike, rng: np.random.Generator
    ) -> 'ShareSurrogate':
        """Fit the shares to counts; the form is chosen by cross-validation.

        Parameters
        ----------
        points : (m, d) float
            Points in the unit cube; no two need to differ.
        counts : (m, k) int
            Drops at each point by class, k >= 2. Points without drops have no effect.
        rng : Generator
            Chooses the folds of the cross-validation.

        Raises
        ------
        InvalidValueError
            Fewer than 2 classes or 2 points, or numbers that are no counts.
        """
        points, table = _checked(points, counts)
        folds = rng.permutation(len(points)) % min(FOLDS, len(points))
        best: tuple[float, Form, Array] | None = None
        for form in _forms(points):
            loss, predicted = _cross_validate(form, points, table, folds)
            if best is None or loss < best[0]:
                best = loss, form, predicted
        assert best is not None
        _, form, predicted = best
        found = fit_softmax(form.features(points), _added(table), form.precision(points.shape[1]))
        error, noise = _net_variance(predicted, table)
        plain = cls(form, found, math.sqrt(max(error, 0.0)), 1.0)
        spread = float(plain.variances(points).mean())
        # Only what the noise of the drops does not explain.
        excess = error - SIGNIFICANT * noise
        inflation = min(max(excess / max(spread, 1e-12), 1.0), MAX_INFLATION)
        return dataclasses.replace(plain, inflation=inflation)

    def shares(self, points: Array) -> Array:
        """Return the most probable shares (n, k) at points (n, d)."""
        return np.asarray(softmax(self.fitted.logits(self.form.features(points)), axis=1))

    def variances(self, points: Array) -> Array:
        """Return the variances (n, k) of the shares at points (n, d)."""
        return self.inflation * self.fitted.share_variances(self.form.features(points))

    def draws(self, points: Array, rng: np.random.Generator, size: int) -> Array:
        """Return shares (size, n, k) at points (n, d) of ``size`` functions that fit the drops."""
        normal = rng.standard_normal((size, self.fitted.weights.size)) * math.sqrt(self.inflation)
        logits = self.fitted.drawn_logits(self.form.features(points), normal)
        return np.asarray(softmax(logits, axis=2))


def _checked(points: Array, counts: npt.ArrayLike) -> tuple[Array, Array]:
    points, table = np.asarray(points, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    if points.ndim != 2 or not np.isfinite(points).all():
        raise InvalidValueError(f'invalid points {shown(points)}: expected rows of numbers')
    if table.ndim != 2 or len(table) != len(points) or table.shape[1] < 2:
        raise InvalidValueError(
            f'invalid counts of shape {table.shape}: expected ({len(points)}, classes), with at '
            'least 2 classes'
        )
    if not (np.isfinite(table).all() and (table >= 0).all()):
        raise InvalidValueError('invalid counts: expected numbers that are not negative')
    some = table.sum(axis=1) > 0
    if some.sum() < 2:
        raise InvalidValueError(f'invalid number of points {some.sum()}: expected at least 2')
    return points[some], table[some]


def _forms(points: Array) -> list[Form]:
    """Return the forms that can be fitted to this number of points, the simplest first."""
    count, dimensions = points.shape
    degrees = [d for d in (1, 2, 3, 4) if len(_terms(dimensions, d)) <= count] or [1]
    found = [Form(degree) for degree in degrees]
    if count >= 4 * dimensions:
        corners = np.unique(points, axis=0)
        corners = corners[:: math.ceil(len(corners) / MAX_CORNERS)]
        mean = min(2, degrees[-1])
        scale = math.sqrt(dimensions)
        found += [Form(mean, scale * length, 0.5, corners) for length in (0.25, 0.5)]
    return found


def _cross_validate(
    form: Form, points: Array, counts: Array, folds: npt.NDArray[np.int64]
) -> tuple[float, Array]:
    """Return the cross-validated loss, -log likelihood per drop, and the predicted shares."""
    features, precision = form.features(points), form.precision(points.shape[1])
    fitted = _added(counts)
    start = fit_softmax(features, fitted, precision).weights
    logs = np.empty_like(counts)
    for fold in range(int(folds.max()) + 1):
        out = folds == fold
        found = fit_softmax(features[~out], fitted[~out], precision, start)
        logs[out] = log_softmax(found.logits(features[out]), axis=1)
    return float(-(counts * logs).sum() / counts.sum()), np.exp(logs)


def _added(counts: Array) -> Array:
    return counts + ADDED / len(counts)


def _net_variance(predicted: Array, counts: Array) -> tuple[float, float]:
    """Return the mean squared error of predicted shares, and the standard error of this number.

    The variance of the counts is subtracted, so that it can be negative.
    """
    totals = counts.sum(axis=1, keepdims=True)
    sampling = predicted * (1 - predicted) / totals
    squares = (predicted - counts / totals) ** 2 - sampling
    # Points with more drops say more about the error.
    weights = (totals / totals.sum()).ravel()
    each = squares.mean(axis=1)
    # A squared normal error has a variance of twice the square of its mean; the classes of a point
    # are not independent.
    noise = math.sqrt(float((weights**2 * 2 * sampling.mean(axis=1) ** 2).sum()))
    return float(weights @ each), noise


def _terms(dimensions: int, degree: int) -> list[tuple[int, ...]]:
    """Return the monomials of a polynomial, each as the coordinates that are multiplied."""
    return [
        term
        for total in range(degree + 1)
        for term in combinations_with_replacement(range(dimensions), total)
    ]


def _polynomial(points: Array, degree: int) -> Array:
    """Return products of Legendre polynomials (n, p), of unit mean square over the cube."""
    scale = np.sqrt(2 * np.arange(degree + 1) + 1)
    single: Array = np.asarray(legendre.legvander(2 * points - 1, degree) * scale, np.float64)
    return np.stack([_product(single, term) for term in _terms(points.shape[1], degree)], axis=1)


def _product(single: Array, term: Sequence[int]) -> Array:
    """Return the product (n,) of polynomials (n, d, degree + 1) for one term."""
    found = np.ones(len(single))
    for axis in set(term):
        found = found * single[:, axis, term.count(axis)]
    return found
