"""A smooth model of the shares of the classes over conditions, fitted to drops at some points.

The logits of the shares are a polynomial, or a linear function and a Gaussian process. Several
forms are weighted by their evidence, so that the uncertainty of the form is part of that of the
shares. The drops at a point are multinomial, so that few drops at many points are as good as many
drops at few points, and a class without drops at a point is no special case.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import softmax

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.studies.softmax_fit import (
    Array,
    SoftmaxFit,
    fit_softmax,
    log_evidence,
)
from resting_aspects_ros.studies.surrogate_form import Form, possible_forms

FOLDS = 8
# Forms of less than this weight are left out.
MIN_WEIGHT = 0.02
MAX_INFLATION = 100.0
SIGNIFICANT = 1.0  # standard errors
# Drops that are added to each class, divided among all points. Without any, the logit of a class
# that was never seen has no maximum, and its normal approximation is far too wide.
ADDED = 1.0


@dataclass(frozen=True, eq=False)
class WeightedFit:
    """A form that was fitted to the drops, and its probability."""

    form: Form
    fitted: SoftmaxFit
    weight: float

    def shares(self, points: Array) -> Array:
        """Return the most probable shares (n, k) at points (n, d)."""
        return np.asarray(softmax(self.fitted.logits(self.form.features(points)), axis=1))

    def moments(self, points: Array) -> tuple[Array, Array]:
        """Return the shares and their variances, each (n, k), to first order in the logits."""
        features = self.form.features(points)
        shares = np.asarray(softmax(self.fitted.logits(features), axis=1))
        # The contrasts of the classes are orthonormal: the gradient of the share of a class has
        # the length shares |e - shares|, where e is 1 for the class.
        squares = (shares**2).sum(axis=1, keepdims=True) + 1 - 2 * shares
        residual = self.form.residual(points)[:, None] * shares**2 * squares
        return shares, np.asarray(self.fitted.share_variances(features) + residual)


@dataclass(frozen=True, eq=False)
class ShareSurrogate:
    """Shares of k classes over the unit cube, with their uncertainty.

    fits : tuple of WeightedFit
        In descending order of weight; the weights add up to 1.
    cross_validated_error : float
        Root mean square, over points and classes, of the difference between the share predicted
        without a point and the true share there: the variance of the drops of the point is
        subtracted. It is 0 if the drops alone explain the differences.
    inflation : float
        Factor of the variance of the draws. It is more than 1 if the cross-validated error is
        larger than the uncertainty that was stated for the points that were left out.
    """

    fits: tuple[WeightedFit, ...]
    cross_validated_error: float
    inflation: float

    @classmethod
    def fit(
        cls,
        points: Array,
        counts: npt.ArrayLike,
        rng: np.random.Generator,
        scales: Array | None = None,
    ) -> 'ShareSurrogate':
        """Fit the shares to counts.

        Parameters
        ----------
        points : (m, d) float
            Points in the unit cube; no two need to differ.
        counts : (m, k) int
            Drops at each point by class, k >= 2. Points without drops have no effect.
        rng : Generator
            Chooses the folds of the cross-validation.
        scales : (d,) float, optional
            Factors of the correlation length along each coordinate.

        Raises
        ------
        InvalidValueError
            Fewer than 2 classes or 2 points, or numbers that are no counts.
        """
        points, table = _checked(points, counts)
        folds = rng.permutation(len(points)) % min(FOLDS, len(points))
        fits = _weighted(possible_forms(points, table.shape[1], scales), points, table)
        predicted, variances = _cross_validate([each.form for each in fits], points, table, folds)
        error, noise = _net_variance(predicted, table)
        # Only what the noise of the drops does not explain.
        excess = error - SIGNIFICANT * noise
        inflation = min(max(excess / max(float(variances.mean()), 1e-12), 1.0), MAX_INFLATION)
        return cls(tuple(fits), math.sqrt(max(error, 0.0)), inflation)

    @property
    def text(self) -> str:
        """Describe the form of the largest weight, and how many others have weight."""
        others = len(self.fits) - 1
        text = self.fits[0].form.text
        return f'{text}; weighted with {others} other forms' if others else text

    def shares(self, points: Array) -> Array:
        """Return the mean shares (n, k) of the forms at points (n, d)."""
        return np.asarray(sum(each.weight * each.shares(points) for each in self.fits))

    def without(
        self, points: Array, counts: npt.ArrayLike, out: npt.NDArray[np.bool_]
    ) -> 'ShareSurrogate':
        """Return the surrogate of the same forms without some of its points; ``out`` is (m,)."""
        table = np.asarray(counts, dtype=np.float64)
        forms = [each.form.without(points[out]) for each in self.fits]
        return dataclasses.replace(self, fits=tuple(_weighted(forms, points[~out], table[~out])))

    def variances(self, points: Array) -> Array:
        """Return the variances (n, k) of the shares at points (n, d)."""
        return self.moments(points)[1]

    def moments(self, points: Array) -> tuple[Array, Array]:
        """Return the mean shares and their variances, each (n, k), at points (n, d)."""
        mean, variances = _mixture(self.fits, points)
        return mean, self.inflation * variances

    def draws(self, points: Array, rng: np.random.Generator, size: int) -> Array:
        """Return shares (size, n, k) at points (n, d) of ``size`` functions that fit the drops.

        They are smooth: the residual of the form, far from all drops, is not among their
        variances.
        """
        scale = math.sqrt(self.inflation)
        numbers = rng.multinomial(size, [each.weight for each in self.fits])
        found = []
        for each, number in zip(self.fits, numbers, strict=True):
            normal = scale * rng.standard_normal((number, each.fitted.weights.size))
            logits = each.fitted.drawn_logits(each.form.features(points), normal)
            found.append(softmax(logits, axis=2))
        return np.concatenate(found)


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


def _weighted(forms: Sequence[Form], points: Array, counts: Array) -> list[WeightedFit]:
    """Return the forms that have weight, fitted to counts (m, k), in descending order of it."""
    table = added_counts(counts)
    found, evidence = [], []
    for form in forms:
        features, precision = form.features(points), form.precision(points.shape[1])
        fitted = fit_softmax(features, table, precision)
        found.append(fitted)
        evidence.append(log_evidence(fitted, features, table, precision))
    weights: Array = softmax(evidence)
    kept = [k for k in np.argsort(-weights) if weights[k] >= MIN_WEIGHT]
    total = float(weights[kept].sum())
    return [WeightedFit(forms[k], found[k], float(weights[k]) / total) for k in kept]


def _mixture(fits: Sequence[WeightedFit], points: Array) -> tuple[Array, Array]:
    """Return the mean shares of weighted forms and their variances, each (n, k)."""
    weights = np.array([each.weight for each in fits])
    shares, variances = (
        np.stack(each) for each in zip(*(fit.moments(points) for fit in fits), strict=True)
    )
    mean = np.tensordot(weights, shares, 1)
    return mean, np.tensordot(weights, variances + (shares - mean) ** 2, 1)


def _cross_validate(
    forms: Sequence[Form], points: Array, counts: Array, folds: npt.NDArray[np.int64]
) -> tuple[Array, Array]:
    """Return the shares (m, k) that are predicted without each fold, and their variances."""
    predicted, variances = np.empty_like(counts), np.empty_like(counts)
    for fold in range(int(folds.max()) + 1):
        out = folds == fold
        own = [form.without(points[out]) for form in forms]
        fits = _weighted(own, points[~out], counts[~out])
        predicted[out], variances[out] = _mixture(fits, points[out])
    return predicted, variances


def added_counts(counts: npt.ArrayLike) -> Array:
    """Return counts (m, k) with a drop more of each class, divided among all points."""
    counts = np.asarray(counts, dtype=np.float64)
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
