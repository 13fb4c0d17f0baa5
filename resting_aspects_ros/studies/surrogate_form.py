"""Forms of the logits of shares over the unit cube: polynomials and Gaussian processes."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.polynomial import legendre

from resting_aspects_ros.studies.softmax_fit import Array, fit_softmax, log_evidence

# Standard deviation of the prior of the mean logits, and of the weights of degree 1. Those of
# degree d are smaller by d.
PRIOR_MEAN, PRIOR_SLOPE = 10.0, 2.0
MAX_DEGREE = 4
# Number of corners of a Gaussian process, and of their weights over all classes: more would cost
# time and change little.
MAX_CORNERS, MAX_WEIGHTS = 80, 200
# Correlation lengths and sizes of the Gaussian processes that are tried.
LENGTHS, SIZES = (0.25, 0.5, 1.0, 2.0), (0.1, 0.3, 1.0)
# Standard deviation of the prior of the logarithm of a scale.
SCALE_PRIOR = 1.0
# Points of each dimension that are needed for a Gaussian process.
PROCESS_POINTS = 4


@dataclass(frozen=True, eq=False)
class Form:
    """A form of the logits over the unit cube.

    degree : int
        Total degree of the polynomial.
    size : float
        Standard deviation of the Gaussian process; 0: only the polynomial.
    lengths : (d,) float
        Its correlation length along each coordinate.
    corners : (c, d) float
        Points at which it has its weights.
    """

    degree: int
    size: float = 0.0
    lengths: Array = dataclasses.field(default_factory=lambda: np.ones(0))
    corners: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def text(self) -> str:
        """Describe the form."""
        text = f'polynomial of degree {self.degree}'
        if not self.size:
            return text
        lengths = ', '.join(dict.fromkeys(f'{each:.2g}' for each in self.lengths))
        return f'{text} and a Gaussian process of length {lengths}, size {self.size:g}'

    def features(self, points: Array) -> Array:
        """Return the features (n, p) of points (n, d)."""
        found = _polynomial(points, self.degree)
        if not self.size:
            return found
        return np.hstack([found, self._process(points)])

    def precision(self, dimensions: int) -> Array:
        """Return the precision (p,) of the prior of the weights."""
        degrees = np.array([len(term) for term in _terms(dimensions, self.degree)], dtype=float)
        found = np.where(degrees == 0, PRIOR_MEAN, PRIOR_SLOPE / np.maximum(degrees, 1)) ** -2.0
        return np.concatenate([found, [self.size**-2.0 for _ in self.corners]])

    def residual(self, points: Array) -> Array:
        """Return the variance (n,) of each logit contrast that the weights do not describe.

        It is that of the Gaussian process away from its corners.
        """
        if not self.size:
            return np.zeros(len(points))
        explained = (self._process(points) ** 2).sum(axis=1)
        return np.asarray(self.size**2 * np.maximum(1 - explained, 0))

    def without(self, points: Array) -> 'Form':
        """Return the form without corners at these points."""
        if not self.size:
            return self
        kept = ~(self.corners[:, None] == points[None]).all(axis=2).any(axis=1)
        return dataclasses.replace(self, corners=self.corners[kept])

    def _process(self, points: Array) -> Array:
        kernel = self._kernel(self.corners, self.corners)
        root = np.linalg.cholesky(kernel + 1e-6 * np.eye(len(self.corners)))
        return np.asarray(np.linalg.solve(root, self._kernel(self.corners, points)).T)

    def _kernel(self, a: Array, b: Array) -> Array:
        a, b = a / self.lengths, b / self.lengths
        distance = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
        return np.asarray(np.exp(-np.maximum(distance, 0) / 2))


def possible_forms(points: Array, classes: int, scales: Array | None = None) -> list[Form]:
    """Return the forms that can be fitted to points (m, d), the simplest first.

    ``scales`` (d,) are factors of the correlation length along each coordinate; 1 by default.
    """
    count, dimensions = points.shape
    degrees = range(1, MAX_DEGREE + 1)
    found = [Form(d) for d in degrees if d == 1 or len(_terms(dimensions, d)) <= count]
    if count >= PROCESS_POINTS * dimensions:
        corners = _corners(points, classes)
        scales = np.ones(dimensions) if scales is None else scales
        found += [Form(1, size, scales * length, corners) for size in SIZES for length in LENGTHS]
    return found


def likely_scales(points: Array, tables: Sequence[Array]) -> Array:
    """Return the scales (d,) that suit several tables of counts (m, k) at the same points.

    They have the highest evidence of all tables together that a search by coordinates finds, and
    a geometric mean of 1. A condition that hardly matters has a large scale.
    """
    dimensions = points.shape[1]
    if dimensions == 1 or len(points) < PROCESS_POINTS * dimensions:
        return np.ones(dimensions)

    def value(logs: Array) -> float:
        lengths, size = np.exp(logs[:-1]), math.exp(logs[-1])
        total = -float(logs[:-1] @ logs[:-1]) / (2 * SCALE_PRIOR**2)
        for table in tables:
            form = Form(1, size, lengths, _corners(points, table.shape[1]))
            features, precision = form.features(points), form.precision(dimensions)
            found = fit_softmax(features, table, precision)
            total += log_evidence(found, features, table, precision)
        return total

    logs = np.zeros(dimensions + 1)
    logs[-1] = math.log(SIZES[1])
    best = value(logs)
    for factor in (2.0, 2.0, 1.5):
        for axis in range(dimensions + 1):
            for step in (math.log(factor), -math.log(factor)):
                moved = logs.copy()
                moved[axis] += step
                if (found := value(moved)) > best:
                    best, logs = found, moved
                    break
    return np.asarray(np.exp(logs[:-1] - logs[:-1].mean()))


def _corners(points: Array, classes: int) -> Array:
    corners = np.unique(points, axis=0)
    most = max(MAX_CORNERS, MAX_WEIGHTS // (classes - 1))
    return np.asarray(corners[:: math.ceil(len(corners) / most)])


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
