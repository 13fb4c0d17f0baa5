"""The objective around the best point, by the surrogate: along each factor, and over two."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from resting_aspects_ros.core.statistics.intervals import containing
from resting_aspects_ros.studies.optimum_problem import Array
from resting_aspects_ros.studies.optimum_search import DRAWS, OptimumSearch

# Values of a factor in a curve, and of each of two factors in a map.
GRID, MAP_GRID = 41, 25


@dataclass(frozen=True, eq=False)
class Curve:
    """Values of the objective along one factor; the other factors have their best values.

    at : (g,) float
        The factor, from 0 to 1.
    values, lower, upper : (g,) float
        Means and intervals of the surrogate.
    """

    at: Array
    values: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class Map:
    """Values (g, g) of the objective over the two factors with the largest changes.

    factors : (int, int)
        Rows, columns.
    at : (g,) float
        Both factors, from 0 to 1.
    """

    factors: tuple[int, int]
    at: Array
    values: Array


@dataclass(frozen=True, eq=False)
class Profile:
    """A curve for each factor, and a map if there are two or more."""

    best: Array
    curves: tuple[Curve, ...]
    map: Map | None


def profile_of(search: OptimumSearch, best: Array, sign: float, confidence: float) -> Profile:
    """Return the objective around the best point (d,); ``sign`` is -1 if less is better."""
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    curves = []
    for k in range(len(best)):
        points = np.repeat(best[None], GRID, axis=0)
        points[:, k] = np.linspace(0, 1, GRID)
        points = search.problem.snapped(points)
        drawn = sign * search.drawn(points, DRAWS)
        lower, upper = np.quantile(drawn, tails, axis=0)
        mean = drawn.mean(axis=0)
        curves.append(Curve(points[:, k], mean, *containing(mean, lower, upper)))
    return Profile(best, tuple(curves), _map_of(search, best, sign, curves))


def _map_of(search: OptimumSearch, best: Array, sign: float, curves: list[Curve]) -> Map | None:
    if len(best) < 2:
        return None
    spans = [np.ptp(curve.values) for curve in curves]
    rows, columns = max(
        combinations(range(len(best)), 2), key=lambda pair: sum(spans[k] for k in pair)
    )
    at = np.linspace(0, 1, MAP_GRID)
    points = np.repeat(best[None], MAP_GRID**2, axis=0)
    points[:, rows] = np.repeat(at, MAP_GRID)
    points[:, columns] = np.tile(at, MAP_GRID)
    values = sign * search.predicted(search.problem.snapped(points))
    return Map((rows, columns), at, values.reshape(MAP_GRID, MAP_GRID))
