"""Compare two cases of a study: the shares of the aspects that two designs have in common."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from resting_aspects_ros.core.statistics.comparison import square_and_add
from resting_aspects_ros.core.statistics.intervals import INTERVAL, bounds
from resting_aspects_ros.studies.aspect_matching import match_aspects
from resting_aspects_ros.studies.effects import Array
from resting_aspects_ros.studies.study_cases import StudyCase


@dataclass(frozen=True, eq=False)
class SharedClass:
    """A class that two designs share, over the points that both have.

    first, second : int
        Its numbers in the designs, from 1.
    first_share, second_share : float
        Means over the points.
    difference, lower, upper : float
        Mean of second - first, with its interval.
    largest : float
        The difference of largest size at a point.
    largest_lower, largest_upper : float
        Its interval, which allows for the choice among all points and pairs.
    point : int
        Where that is.
    differences : (m,) float
        At each point; NaN where one of them has no drops.
    """

    first: int
    second: int
    first_share: float
    second_share: float
    difference: float
    lower: float
    upper: float
    largest: float
    largest_lower: float
    largest_upper: float
    point: int
    differences: Array


@dataclass(frozen=True, eq=False)
class CaseComparison:
    """Two designs side by side; ``apart`` is the mean distance of their hulls, R."""

    first: StudyCase
    second: StudyCase
    shared: tuple[SharedClass, ...]
    apart: float


def compare_cases(cases: Sequence[StudyCase], confidence: float) -> Iterator[CaseComparison]:
    """Yield a comparison of each pair of designs that are dropped."""
    dropped = [case for case in cases if case.start is None]
    for first, second in combinations(dropped, 2):
        match = match_aspects(first.part, first.aspects, second.part, second.aspects)
        both = (first.drops > 0) & (second.drops > 0)
        shared = []
        if both.any():
            tests = len(match.pairs) * int(both.sum())
            shared = [_shared(first, second, a, b, confidence, tests) for a, b in match.pairs]
        yield CaseComparison(first, second, tuple(shared), match.apart)


def _shared(
    first: StudyCase, second: StudyCase, a: int, b: int, confidence: float, tests: int
) -> SharedClass:
    # This import takes long, and most studies have one part.
    from scipy.stats import norm

    both = np.flatnonzero((first.drops > 0) & (second.drops > 0))
    counts = first.classes[both, a - 1], second.classes[both, b - 1]
    drops = first.drops[both], second.drops[both]
    shares = [c / n for c, n in zip(counts, drops, strict=True)]
    difference = shares[1] - shares[0]
    # A point with no drop in a class still has a chance of it: add half a drop to each side.
    smooth = [(c + 0.5) / (n + 1) for c, n in zip(counts, drops, strict=True)]
    variance = sum(p * (1 - p) / n for p, n in zip(smooth, drops, strict=True))
    error = float(np.sqrt(np.sum(variance)) / len(both))
    reach = float(norm.ppf((1 + confidence) / 2)) * error
    k = int(np.abs(difference).argmax())
    strict = 1 - (1 - confidence) / tests
    low, high = square_and_add(
        shares[1][k : k + 1],
        _bounds(counts[1][k], drops[1][k], strict),
        shares[0][k : k + 1],
        _bounds(counts[0][k], drops[0][k], strict),
    )
    everywhere = np.full(len(first.drops), np.nan)
    everywhere[both] = difference
    mean = float(difference.mean())
    return SharedClass(
        a,
        b,
        float(shares[0].mean()),
        float(shares[1].mean()),
        mean,
        mean - reach,
        mean + reach,
        float(difference[k]),
        float(low[0]),
        float(high[0]),
        int(both[k]),
        everywhere,
    )


def _bounds(count: int, drops: int, confidence: float) -> tuple[Array, Array]:
    return bounds(np.array([count]), int(drops), INTERVAL, confidence)
