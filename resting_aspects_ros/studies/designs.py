"""Designs of a study: which points of the unit cube are simulated."""

import inspect
import itertools
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.studies.design import Factor

Array = npt.NDArray[np.float64]

DESIGNS = {
    'factorial': 'all combinations of the levels of the factors',
    'lhs': 'a Latin hypercube, in which each factor has as many values as there are points',
    'sobol': 'a scrambled Sobol sequence, which fills the space evenly and can be continued',
}
DEFAULT_DESIGN = 'sobol'
DEFAULT_POINTS = 64
# Levels of a factor in a factorial design, if none are given.
DEFAULT_LEVELS = 3
MAX_POINTS = 100_000


def design_points(
    design: str, factors: Sequence[Factor], blocks: Sequence[int], seed: int
) -> Array:
    """Return the points (m, d) of a design in the unit cube; raises InvalidValueError.

    Parameters
    ----------
    design : str
        One of DESIGNS.
    factors : sequence of Factor
        Factors with levels have only those values in every design.
    blocks : sequence of int
        Number of points of the first block and of those that were added to it later. A factorial
        design has its own number, and one block.
    seed : int
        Of the random numbers of a Latin hypercube, and of the scrambling.
    """
    if design not in DESIGNS:
        raise InvalidValueError(
            f'invalid design {shown(design)}: expected one of {", ".join(DESIGNS)}'
        )
    if design == 'factorial':
        return factorial(factors)
    for points in blocks:
        check_points(points)
    check_points(sum(blocks))
    d = len(factors)
    if design == 'sobol':
        found = sobol(d, sum(blocks), seed)
    else:
        found = np.concatenate(
            [latin_hypercube(d, points, (seed, k)) for k, points in enumerate(blocks)]
        )
    return _unique(on_levels(found, factors))


def factorial(factors: Sequence[Factor]) -> Array:
    """Return all combinations of the levels; the last factor changes fastest."""
    levels = [factor.levels or DEFAULT_LEVELS for factor in factors]
    count = int(np.prod(levels, dtype=object))
    if count > MAX_POINTS:
        raise InvalidValueError(
            f'invalid levels {" x ".join(map(str, levels))}: expected at most {MAX_POINTS} points '
            f'together, not {count}'
        )
    return np.array(list(itertools.product(*(np.linspace(0, 1, n) for n in levels))))


def sobol(d: int, points: int, seed: int | Sequence[int], first: int = 0) -> Array:
    """Return points ``first`` to ``first + points - 1`` of a scrambled Sobol sequence."""
    sequence = qmc.Sobol(d, scramble=True, **_random(qmc.Sobol, seed))
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():
        # A number that is no power of two is allowed: the sequence can be continued later.
        warnings.simplefilter('ignore', UserWarning)
        return np.asarray(sequence.random(points))


def latin_hypercube(d: int, points: int, seed: int | Sequence[int]) -> Array:
    """Return a Latin hypercube of points that are far apart."""
    sampler = qmc.LatinHypercube(d, optimization='random-cd', **_random(qmc.LatinHypercube, seed))
    return np.asarray(sampler.random(points))


def on_levels(points: Array, factors: Sequence[Factor]) -> Array:
    """Return the points with the nearest level of each factor that has levels."""
    found = points.copy()
    for k, factor in enumerate(factors):
        if factor.levels:
            # Each level has an equal share of the range.
            level = np.minimum(np.floor(points[:, k] * factor.levels), factor.levels - 1)
            found[:, k] = level / (factor.levels - 1)
    return found


def check_points(points: int) -> None:
    """Raise InvalidValueError if the number of points is out of bounds."""
    if type(points) is not int or not 1 <= points <= MAX_POINTS:
        raise InvalidValueError(
            f'invalid number of points {shown(points)}: expected 1 to {MAX_POINTS}'
        )


def _unique(points: Array) -> Array:
    """Return the points without repetitions, in their order."""
    _, first = np.unique(points, axis=0, return_index=True)
    return points[np.sort(first)]


def _random(sampler: Any, seed: int | Sequence[int]) -> dict[str, Any]:
    """Return the random generator under the name that this version of SciPy has for it."""
    name = 'rng' if 'rng' in inspect.signature(sampler.__init__).parameters else 'seed'
    return {name: np.random.default_rng(seed)}
