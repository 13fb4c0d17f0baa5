"""What the shares of a case depend on: main effects, Sobol indices and largest changes."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, analysis
from resting_aspects_ros.core.statistics.intervals import containing
from resting_aspects_ros.studies.designs import sobol
from resting_aspects_ros.studies.sensitivity import Indices, indices_of
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate
from resting_aspects_ros.studies.study_cases import Counts, StudyCase

Array = npt.NDArray[np.float64]

# Values of a factor in a curve, values of the others over which it is averaged (a power of two),
# and functions that fit the drops, from which the intervals follow.
GRID, OTHERS, DRAWS = 13, 128, 200
# Below this share of the variance that it explains, a surrogate says little.
EXPLAINED = 0.5


@dataclass(frozen=True, eq=False)
class Curve:
    """The main effect of one factor: shares averaged over the other factors.

    shares : (g,) float
        Values of the factor, from 0 to 1.
    mean, lower, upper : (g, c) float
        Shares of the classes with their intervals.
    entropy, entropy_lower, entropy_upper : (g,) float
        Entropy of the shares at a point, bit, averaged.
    """

    shares: Array
    mean: Array
    lower: Array
    upper: Array
    entropy: Array
    entropy_lower: Array
    entropy_upper: Array


@dataclass(frozen=True, eq=False)
class Change:
    """The largest change of a share by one factor.

    column : int
        The class.
    start, end : (d,) float
        The two points, in the unit cube, which differ in one factor.
    low, high : float
        The share at both.
    change, lower, upper : float
        Its size, with the interval, which does not contain negative sizes.
    average : float
        The largest change of a share averaged over the other factors.
    """

    column: int
    start: Array
    end: Array
    low: float
    high: float
    change: float
    lower: float
    upper: float
    average: float


@dataclass(frozen=True, eq=False)
class Effects:
    """The effects of d factors on the c columns of a case.

    cross_validated_error : float
        Of the surrogate: root mean square error of a share.
    explained : float
        Share of the variance between the points that the surrogate explains, 0 to 1.
    indices : Indices or None
        Of the shares; None if they could not be computed.
    """

    columns: list[str]
    form: str
    cross_validated_error: float
    explained: float
    curves: list[Curve]
    changes: list[Change]
    indices: Indices | None

    def reliable(self, tolerance: float) -> bool:
        """Return whether the surrogate explains the differences that matter.

        That is most of the variance between the points, or all but changes whose 95 % interval is
        within the tolerance.
        """
        return self.explained >= EXPLAINED or 2 * self.cross_validated_error <= tolerance


class _Model:
    """A surrogate whose draws are the same functions in every call."""

    def __init__(self, surrogate: ShareSurrogate, seed: int) -> None:
        self.shares = surrogate.shares
        self._surrogate, self._seed = surrogate, seed

    def draws(self, points: Array) -> Array:
        generator = np.random.default_rng((self._seed, 7))
        return self._surrogate.draws(points, generator, DRAWS)


def effects_of(case: StudyCase, points: Array, seed: int, confidence: float) -> Effects | None:
    """Return the effects of the factors on a case; None if its counts tell nothing.

    ``points`` (m, d) are in the unit cube.
    """
    some = case.drops > 0
    table, points = case.table[some], points[some]
    if table.shape[1] < 2:
        return None
    generator = np.random.default_rng((seed, 8))
    try:
        surrogate = ShareSurrogate.fit(points, table, generator)
    except InvalidValueError:
        return None
    # Changes that no smooth function describes scatter the points around it, like more chance:
    # the variance is that of the drops times a dispersion, as in quasi-likelihood.
    dispersion = 1 + surrogate.cross_validated_error**2 / _chance(table)
    model = _Model(dataclasses.replace(surrogate, inflation=dispersion), seed)
    d = points.shape[1]
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    others = sobol(d, OTHERS, (seed, 9))
    found = [_along(model, others, k, tails) for k in range(d)]
    indices = None
    with analysis(f'the Sobol indices of {case.name}'):
        indices = indices_of(model.shares, d, seed, model.draws)
    return Effects(
        case.columns,
        surrogate.text,
        surrogate.cross_validated_error,
        _explained(table, surrogate.cross_validated_error),
        [curve for curve, _ in found],
        [change for _, change in found],
        indices,
    )


def entropy(shares: Array) -> Array:
    """Return the entropy (...) of shares (..., c), bit."""
    return np.asarray((shares * -np.log2(np.maximum(shares, 1e-300))).sum(axis=-1) + 0.0)


def _along(
    model: _Model, others: Array, factor: int, tails: tuple[float, float]
) -> tuple[Curve, Change]:
    """Return the curve and the largest change along one factor."""
    grid = np.linspace(0, 1, GRID)
    shares, means, entropies = [], [], []
    for value in grid.tolist():
        points = others.copy()
        points[:, factor] = value
        shares.append(model.shares(points))
        drawn = model.draws(points)
        means.append(drawn.mean(axis=1))
        entropies.append(entropy(drawn).mean(axis=1))
    table = np.array(shares)  # (g, n, c)
    lower, upper = np.quantile(np.array(means), tails, axis=1)
    entropy_lower, entropy_upper = np.quantile(np.array(entropies), tails, axis=1)
    mean = table.mean(axis=1)
    bits = entropy(table).mean(axis=1)
    # The curve is that of the best surrogate: its interval must contain it.
    curve = Curve(
        grid,
        mean,
        *containing(mean, lower, upper),
        bits,
        *containing(bits, entropy_lower, entropy_upper),
    )
    average = float(np.ptp(mean, axis=0).max())
    return curve, _change(model, table, others, factor, tails, average)


def _change(
    model: _Model,
    table: Array,
    others: Array,
    factor: int,
    tails: tuple[float, float],
    average: float,
) -> Change:
    place, column = np.unravel_index(np.ptp(table, axis=0).argmax(), table.shape[1:])
    along = table[:, place, column]
    ends = sorted((int(along.argmin()), int(along.argmax())))
    points = np.repeat(others[place][None], 2, axis=0)
    points[:, factor] = np.linspace(0, 1, GRID)[ends]
    drawn = model.draws(points)[:, :, column]
    low, high = along[ends].tolist()
    change = abs(high - low)
    # Its sign is that of the best surrogate, so that chance changes are not all positive.
    lower, upper = np.quantile((drawn[:, 1] - drawn[:, 0]) * np.sign(high - low), tails)
    return Change(
        int(column),
        points[0],
        points[1],
        low,
        high,
        change,
        float(np.clip(lower, 0.0, change)),
        float(max(upper, change)),
        average,
    )


def _explained(table: Counts, error: float) -> float:
    """Return the explained share of the variance of the shares between points."""
    shares = table / table.sum(axis=1, keepdims=True)
    between = float(shares.var(axis=0, ddof=1).mean()) - _chance(table)
    if between <= 0:
        return 1.0  # all differences are those of chance
    return float(np.clip(1 - error**2 / between, 0, 1))


def _chance(table: Counts) -> float:
    """Return the mean variance of a share by chance; more than 0."""
    drops = table.sum(axis=1, keepdims=True)
    shares = (table + 0.5) / (drops + 0.5 * table.shape[1])
    return float((shares * (1 - shares) / drops).mean())
