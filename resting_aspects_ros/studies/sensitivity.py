"""Sobol indices of functions of the unit cube, with their errors."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.studies.designs import sobol

Array = npt.NDArray[np.float64]

# Number of independent samples, and of points in each: powers of two.
REPEATS, SAMPLES = 8, 256
# A function whose variance is less than this share of its mean square is constant.
CONSTANT = 1e-12


@dataclass(frozen=True, eq=False)
class Indices:
    """First and total Sobol indices of c outputs, and of all together, over d factors.

    first, total : (c + 1, d) float
        The last row is that of all outputs together: the indices weighted by the variances.
    first_error, total_error : (c + 1, d) float
        Standard errors: of the sampling, and of the function if draws of it are given.
    variance : (c,) float
        Variance of each output over the cube.
    """

    first: Array
    total: Array
    first_error: Array
    total_error: Array
    variance: Array


def indices_of(
    function: Callable[[Array], Array],
    d: int,
    seed: int,
    draws: Callable[[Array], Array] | None = None,
) -> Indices:
    """Return the Sobol indices of a function of the unit cube.

    Parameters
    ----------
    function : callable
        Returns outputs (n, c) at points (n, d).
    d : int
        Number of factors.
    seed : int
        Of the samples.
    draws : callable, optional
        Returns outputs (size, n, c) of functions that could be the true one; the same functions
        for any points.
    """
    found = [_sampled(function, d, (seed, k)) for k in range(REPEATS)]
    firsts, totals, variances = (np.array(each) for each in zip(*found, strict=True))
    first_square = firsts.var(axis=0, ddof=1) / REPEATS
    total_square = totals.var(axis=0, ddof=1) / REPEATS
    if draws is not None:
        drawn_first, drawn_total = _drawn(draws, d, (seed, REPEATS))
        first_square = first_square + drawn_first.var(axis=0, ddof=1)
        total_square = total_square + drawn_total.var(axis=0, ddof=1)
    return Indices(
        firsts.mean(axis=0),
        totals.mean(axis=0),
        np.sqrt(first_square),
        np.sqrt(total_square),
        variances.mean(axis=0),
    )


def _design(d: int, seed: tuple[int, ...]) -> Array:
    """Return the points (d + 2, n, d) of Saltelli's design: A, B, and A with columns of B."""
    points = sobol(2 * d, SAMPLES, seed)
    a, b = points[:, :d], points[:, d:]
    mixed = np.repeat(a[None], d, axis=0)
    for k in range(d):
        mixed[k, :, k] = b[:, k]
    return np.concatenate([a[None], b[None], mixed])


def _sampled(
    function: Callable[[Array], Array], d: int, seed: tuple[int, ...]
) -> tuple[Array, Array, Array]:
    design = _design(d, seed)
    outputs = np.asarray(function(design.reshape(-1, d)))
    return _saltelli(np.moveaxis(outputs.reshape(d + 2, SAMPLES, -1), 2, 1))


def _drawn(draws: Callable[[Array], Array], d: int, seed: tuple[int, ...]) -> tuple[Array, Array]:
    design = _design(d, seed)
    outputs = np.stack([np.asarray(draws(points)) for points in design])  # (d + 2, size, n, c)
    found = [_saltelli(np.moveaxis(each, 2, 1)) for each in np.moveaxis(outputs, 1, 0)]
    firsts, totals, _ = zip(*found, strict=True)
    return np.array(firsts), np.array(totals)


def _saltelli(outputs: Array) -> tuple[Array, Array, Array]:
    """Return first and total indices (c + 1, d), and the variances (c,), of (d + 2, c, n).

    These are the estimators of Saltelli et al. 2010 (Computer Physics Communications 181:259).
    `scipy.stats.sobol_indices` has the same ones, but fails for one output of one factor.
    """
    a, b, mixed = outputs[0], outputs[1], outputs[2:]
    both = np.concatenate([a, b], axis=1)
    variance = both.var(axis=1)
    varies = variance > CONSTANT * np.maximum((both**2).mean(axis=1), 1e-300)
    scale = np.where(varies, variance, np.inf)
    # The outputs are centred, which makes the estimate of the first indices more precise.
    centred = b - both.mean(axis=1, keepdims=True)
    first = (centred * (mixed - a)).mean(axis=2).T / scale[:, None]
    total = ((mixed - a) ** 2).mean(axis=2).T / 2 / scale[:, None]
    variance = np.where(varies, variance, 0.0)
    weights = variance / variance.sum() if varies.any() else variance
    return (
        np.vstack([first, weights @ first]),
        np.vstack([total, weights @ total]),
        variance,
    )
