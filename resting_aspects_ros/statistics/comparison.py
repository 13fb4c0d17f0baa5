"""Comparison of two distributions over the same aspects, with a test of their difference.

Shares are those of the drops that are in an aspect. The counts of unclassified, unsettled and
failed drops depend on the method (a person has no unsettled drops) and are reported separately.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, SIMULTANEOUS, bounds
from resting_aspects_ros.statistics.pearson import Source, p_of_one, p_of_two

# The sum of probabilities in a file may differ from 1 by this, because of rounding.
SUM_TOLERANCE = 1e-3
# The counts of drops that are in no aspect.
REST = ('unclassified', 'unsettled', 'failed')


@dataclass(frozen=True, eq=False)
class DropCounts:
    """Counts of drops by aspect and by failure, from any source; `Distribution` has them too.

    counts : (k,) int
        Drops in each aspect, by id from 1.
    """

    counts: npt.NDArray[np.int64]
    unclassified: int = 0
    unsettled: int = 0
    failed: int = 0

    @property
    def drops(self) -> int:
        """Number of drops that were counted."""
        return int(self.counts.sum()) + self.unclassified + self.unsettled + self.failed


@dataclass(frozen=True, eq=False)
class Comparison:
    """The shares of two distributions and the difference between them.

    first, second : (k,) float
        Share of each aspect in the drops that are in an aspect; the sum of each is 1.
    lower, upper : (k,) float
        Simultaneous bounds of the true difference first - second, with ``confidence``.
    p_value : float
        Probability of a difference at least as large, by Pearson's chi-square, if the true shares
        are the same.
    p_by : str
        Source of the p value: the chi-square distribution, or random tables.
    """

    first: Array
    second: Array
    lower: Array
    upper: Array
    confidence: float
    p_value: float
    p_by: Source

    @property
    def deviation(self) -> Array:
        """(k,) differences first - second."""
        return self.first - self.second

    @property
    def total_variation(self) -> float:
        """Half the sum of absolute deviations: the share of drops that end differently, 0 to 1."""
        return float(np.abs(self.deviation).sum() / 2)

    @property
    def mean_deviation(self) -> float:
        """Mean of the absolute deviations over the aspects, as the seed method reports it."""
        return float(np.abs(self.deviation).mean())

    @property
    def largest_aspect(self) -> int:
        """Id of the aspect with the largest absolute deviation; the lowest id of equal ones."""
        return int(np.abs(self.deviation).argmax()) + 1

    @property
    def largest_deviation(self) -> float:
        """Deviation of the aspect `largest_aspect`, with its sign."""
        return float(self.deviation[self.largest_aspect - 1])

    @property
    def largest_bounds(self) -> tuple[float, float]:
        """Lower and upper bound of `largest_deviation`.

        The bounds of all aspects hold together, so choosing the largest does not weaken them.
        """
        index = self.largest_aspect - 1
        return float(self.lower[index]), float(self.upper[index])


def compare(
    first: DropCounts | Distribution,
    second: DropCounts | Distribution,
    generator: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Comparison:
    """Return the comparison of two sets of drops, both with a sampling error.

    Raises InvalidValueError if the numbers of aspects differ, if one set has no drop in any
    aspect, or if a count or the confidence is invalid.
    """
    one, other = _counts('first', first), _counts('second', second)
    _check_aspect_count('the second distribution', len(other), len(one))
    a, b = one / one.sum(), other / other.sum()
    lower, upper = square_and_add(
        a,
        bounds(one, one.sum(), SIMULTANEOUS, confidence),
        b,
        bounds(other, other.sum(), SIMULTANEOUS, confidence),
    )
    p_value, p_by = p_of_two(one, other, generator)
    return Comparison(a, b, lower, upper, confidence, p_value, p_by)


def compare_with_exact(
    first: DropCounts | Distribution,
    probabilities: npt.ArrayLike,
    generator: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Comparison:
    """Return the comparison of drops with exact probabilities, such as those of an estimator.

    Raises InvalidValueError as `compare`, and if the sum of ``probabilities`` (k,) is not 1.
    """
    one = _counts('first', first)
    exact = _probabilities(probabilities)
    _check_aspect_count('the estimate', len(exact), len(one))
    lower, upper = bounds(one, one.sum(), SIMULTANEOUS, confidence)
    p_value, p_by = p_of_one(one, exact, generator)
    share = one / one.sum()
    return Comparison(share, exact, lower - exact, upper - exact, confidence, p_value, p_by)


def square_and_add(
    first: Array,
    first_bounds: tuple[Array, Array],
    second: Array,
    second_bounds: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Return the bounds of first - second, from the shares and the lower and upper bounds of each.

    This is method 10 of Newcombe 1998 (Statistics in Medicine 17:873), who uses Wilson's bounds.
    """
    difference = first - second
    below = np.hypot(first - first_bounds[0], second_bounds[1] - second)
    above = np.hypot(first_bounds[1] - first, second - second_bounds[0])
    return difference - below, difference + above


def _counts(name: str, given: DropCounts | Distribution) -> Counts:
    counts = np.asarray(given.counts, dtype=np.int64)
    if (counts < 0).any() or counts.sum() < 1:
        raise InvalidValueError(
            f'invalid counts {counts.tolist()} of the {name} distribution: expected 0 or more, '
            'not all 0'
        )
    return counts


def _probabilities(given: npt.ArrayLike) -> Array:
    exact: Array = np.asarray(given, dtype=np.float64)
    # Written so that NaN is rejected.
    if not ((exact >= 0).all() and abs(exact.sum() - 1) <= SUM_TOLERANCE):
        raise InvalidValueError(
            f'invalid probabilities {exact.tolist()}: expected 0 or more with a sum of 1'
        )
    return np.asarray(exact / exact.sum())


def _check_aspect_count(name: str, count: int, expected: int) -> None:
    if count != expected:
        raise InvalidValueError(
            f'invalid number of aspects {count} of {name}: expected {expected}, as in the first'
        )
