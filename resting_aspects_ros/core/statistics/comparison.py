"""How far two distributions over the same aspects are apart, and whether chance explains it.

Shares are of the drops that are in an aspect: what is unclassified, unsettled or failed depends on
the method (a person has no unsettled drops), and is shown beside them.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    SIMULTANEOUS,
    Array,
    Counts,
    bounds,
)
from resting_aspects_ros.core.statistics.pearson import Source, p_of_one, p_of_two

# Probabilities that were written down add up to 1 but for rounding.
SUM_TOLERANCE = 1e-3
# Where drops can end besides in an aspect.
REST = ('unclassified', 'unsettled', 'failed')


@dataclass(frozen=True, eq=False)
class DropCounts:
    """Where drops ended, counted by whatever means; `Distribution` has the same fields.

    counts : (k,) int
        Drops in each aspect, by id from 1.
    """

    counts: npt.NDArray[np.int64]
    unclassified: int = 0
    unsettled: int = 0
    failed: int = 0

    @property
    def drops(self) -> int:
        """How many drops were counted."""
        return int(self.counts.sum()) + self.unclassified + self.unsettled + self.failed


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two distributions side by side.

    first, second : (k,) float
        Share of each aspect in all drops that are in one; both add up to 1.
    lower, upper : (k,) float
        Bounds of first - second of the true shares; all hold together with ``confidence``.
    p_value : float
        How often chance alone makes two distributions at least so different, by Pearson's
        chi-square, if the true shares are the same.
    p_by : str
        Where that is from: the chi-square distribution, or drawn tables.
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
        """(k,) first - second."""
        return self.first - self.second

    @property
    def total_variation(self) -> float:
        """Half the sum of absolute deviations: the share of drops that end otherwise, 0 to 1."""
        return float(np.abs(self.deviation).sum() / 2)

    @property
    def mean_deviation(self) -> float:
        """Mean over aspects of the absolute deviation, as the seed method reports it."""
        return float(np.abs(self.deviation).mean())

    @property
    def largest_aspect(self) -> int:
        """Id of the aspect with the largest absolute deviation; the lowest of equal ones."""
        return int(np.abs(self.deviation).argmax()) + 1

    @property
    def largest_deviation(self) -> float:
        """That aspect's deviation, with its sign."""
        return float(self.deviation[self.largest_aspect - 1])

    @property
    def largest_bounds(self) -> tuple[float, float]:
        """Lower and upper bound of that aspect's deviation.

        That it was picked for being the largest is allowed for: the bounds of all aspects hold.
        """
        index = self.largest_aspect - 1
        return float(self.lower[index]), float(self.upper[index])


def compare(
    first: DropCounts | Distribution,
    second: DropCounts | Distribution,
    generator: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Comparison:
    """Compare two sets of drops, neither of which is the truth.

    Raises InvalidValueError if they have not the same number of aspects, or one has no drop in
    any, or a count or the confidence is not allowed.
    """
    one, other = _counts('first', first), _counts('second', second)
    _check_as_many('the second distribution', len(other), len(one))
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
    """Compare drops with probabilities that have no sampling error, as an estimator's.

    ``probabilities`` (k,) add up to 1. Raises InvalidValueError as `compare`, and if they do not.
    """
    one = _counts('first', first)
    exact = _probabilities(probabilities)
    _check_as_many('the estimate', len(exact), len(one))
    lower, upper = bounds(one, one.sum(), SIMULTANEOUS, confidence)
    p_value, p_by = p_of_one(one, exact, generator)
    share = one / one.sum()
    return Comparison(share, exact, lower - exact, upper - exact, confidence, p_value, p_by)


def square_and_add(
    first: Array, of_first: tuple[Array, Array], second: Array, of_second: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Bounds of first - second, from shares and the lower and upper bounds of each.

    Newcombe 1998 (Statistics in Medicine 17:873), method 10, who takes Wilson's bounds.
    """
    difference = first - second
    below = np.hypot(first - of_first[0], of_second[1] - second)
    above = np.hypot(of_first[1] - first, second - of_second[0])
    return difference - below, difference + above


def _counts(name: str, given: DropCounts | Distribution) -> Counts:
    counts = np.asarray(given.counts, dtype=np.int64)
    if (counts < 0).any() or counts.sum() < 1:
        raise InvalidValueError(
            f'counts of the {name} distribution are {counts.tolist()}, allowed are 0 or more, '
            'not all 0'
        )
    return counts


def _probabilities(given: npt.ArrayLike) -> Array:
    exact: Array = np.asarray(given, dtype=np.float64)
    # Put so that NaN fails.
    if not ((exact >= 0).all() and abs(exact.sum() - 1) <= SUM_TOLERANCE):
        raise InvalidValueError(
            f'probabilities are {exact.tolist()}, allowed are 0 or more that add up to 1'
        )
    return np.asarray(exact / exact.sum())


def _check_as_many(name: str, found: int, allowed: int) -> None:
    if found != allowed:
        raise InvalidValueError(
            f'aspects of {name} are {found}, allowed is as many as the first has: {allowed}'
        )
