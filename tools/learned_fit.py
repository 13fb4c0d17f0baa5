"""Fits the learned estimator to counted drops, by gradient descent on their likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from learned_drops import Case
from scipy.optimize import minimize
from scipy.special import gammaln

from resting_aspects_ros.core.estimators.aspect_features import AspectFeatures
from resting_aspects_ros.core.estimators.learned import LearnedModel, Member, Scaling
from resting_aspects_ros.core.estimators.release import Bounds

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

HIDDEN = 24
MEMBERS = 4
ITERATIONS = 300
# Penalties of the squares of the coefficients, in drops: those of the features of an aspect, those
# of their products with the conditions, and those of the network.
PENALTIES = (100.0, 300.0, 60.0)


@dataclass(frozen=True, eq=False)
class Drops:
    """Counted drops, with one row for each aspect of each case.

    aspects : (n, f), part : (m, g), conditions : (m, c) float
    case : (n,) int
        The case of each row, ascending.
    counts : (n,) float
    """

    aspects: Array
    part: Array
    conditions: Array
    case: Indices
    counts: Array

    def select(self, cases: npt.NDArray[np.bool_]) -> 'Drops':
        """Return some of the cases."""
        rows = cases[self.case]
        number = np.cumsum(cases) - 1
        return Drops(
            self.aspects[rows],
            self.part[cases],
            self.conditions[cases],
            number[self.case[rows]],
            self.counts[rows],
        )


def drops_of(
    features: Sequence[AspectFeatures], cases: Sequence[Case], counts: Sequence[Sequence[int]]
) -> Drops:
    """Return the drops of cases; the counts may end with that of drops in no aspect."""
    sizes = [len(each.values) for each in features]
    return Drops(
        np.vstack([each.values for each in features]),
        np.vstack([each.of_part for each in features]),
        np.vstack(
            [
                case.release.features(each.moments)
                for case, each in zip(cases, features, strict=True)
            ]
        ),
        np.repeat(np.arange(len(cases)), sizes),
        np.concatenate(
            [np.array(n[:size], dtype=float) for n, size in zip(counts, sizes, strict=True)]
        ),
    )


def fit(drops: Drops, bounds: Bounds, seed: int, members: int = MEMBERS) -> LearnedModel:
    """Return the model that is fitted to drops; its weight is not fitted yet."""
    aspects, part, conditions = map(_scaling, (drops.aspects, drops.part, drops.conditions))
    scaled = Drops(
        aspects.scaled(drops.aspects),
        part.scaled(drops.part),
        conditions.scaled(drops.conditions),
        drops.case,
        drops.counts,
    )
    found = [
        _fit_member(scaled, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(k,))))
        for k in range(members)
    ]
    width = 1 + drops.part.shape[1] + drops.conditions.shape[1]
    return LearnedModel(aspects, part, conditions, tuple(found), np.zeros(width), bounds)


def _scaling(values: Array) -> Scaling:
    deviation = values.std(axis=0)
    return Scaling(values.mean(axis=0), np.where(deviation > 1e-9, deviation, 1.0))


def _fit_member(drops: Drops, rng: np.random.Generator) -> Member:
    f, g, c = (x.shape[1] for x in (drops.aspects, drops.part, drops.conditions))
    shapes = ((f, c + 1), (f + c + g, HIDDEN), (HIDDEN,), (HIDDEN,))
    sizes = [int(np.prod(shape)) for shape in shapes]
    ends = np.cumsum(sizes)

    def unpacked(x: Array) -> list[Array]:
        return [
            part.reshape(shape) for part, shape in zip(np.split(x, ends[:-1]), shapes, strict=True)
        ]

    common = np.hstack([drops.conditions, drops.part])[drops.case]
    inputs = np.hstack([drops.aspects, common])
    with_one = np.hstack([drops.conditions, np.ones((len(drops.part), 1))])[drops.case]
    starts = np.flatnonzero(np.diff(drops.case, prepend=-1))
    totals = np.add.reduceat(drops.counts, starts)
    everything = totals.sum()
    main, product, network = np.array(PENALTIES) / everything
    of_direct = np.full(shapes[0], product)
    of_direct[:, -1] = main
    penalty = np.concatenate([of_direct.ravel(), np.full(sum(sizes[1:]), network)])

    def loss(x: Array) -> tuple[float, Array]:
        direct, into, hidden, out = unpacked(x)
        inner = np.tanh(inputs @ into + hidden)
        scores = ((drops.aspects @ direct) * with_one).sum(axis=1) + inner @ out
        top = np.maximum.reduceat(scores, starts)
        weights = np.exp(scores - top[drops.case])
        sums = np.add.reduceat(weights, starts)
        logs = scores - (top + np.log(sums))[drops.case]
        value = -(drops.counts @ logs) / everything
        slope = (totals[drops.case] * weights / sums[drops.case] - drops.counts) / everything
        back = slope[:, None] * out * (1 - inner**2)
        gradient = np.concatenate(
            [
                (drops.aspects.T @ (slope[:, None] * with_one)).ravel(),
                (inputs.T @ back).ravel(),
                back.sum(axis=0),
                inner.T @ slope,
            ]
        )
        return float(value + penalty @ x**2), gradient + 2 * penalty * x

    start = np.concatenate(
        [
            np.zeros(sizes[0]),
            rng.standard_normal(sizes[1]) / np.sqrt(f + c + g),
            rng.standard_normal(sizes[2]) * 0.5,
            rng.standard_normal(sizes[3]) * 0.05,
        ]
    )
    found = minimize(loss, start, jac=True, method='L-BFGS-B', options={'maxiter': ITERATIONS})
    return Member(*unpacked(found.x))


def predictions(model: LearnedModel, drops: Drops) -> Array:
    """Return the probabilities (n,) of all rows."""
    aspects = model.of_aspects.scaled(drops.aspects)
    part, conditions = (
        model.of_part.scaled(drops.part),
        model.of_conditions.scaled(drops.conditions),
    )
    common = np.hstack([conditions, part])[drops.case]
    with_one = np.hstack([conditions, np.ones((len(part), 1))])[drops.case]
    starts = np.flatnonzero(np.diff(drops.case, prepend=-1))
    shares = []
    for member in model.members:
        scores = member.scores(aspects, common, with_one)
        weights = np.exp(scores - np.maximum.reduceat(scores, starts)[drops.case])
        shares.append(weights / np.add.reduceat(weights, starts)[drops.case])
    return np.asarray(np.mean(shares, axis=0))


def fit_weight(part: Array, conditions: Array, drops: Drops, shares: Array) -> Array:
    """Return the coefficients of the logarithm of the weight, from predictions of unseen kinds.

    The counts of a case are those of a Dirichlet-multinomial distribution whose parameters are the
    weight times the predicted shares. ``part`` (m, g) and ``conditions`` (m, c) are scaled.
    """
    inputs = np.hstack([np.ones((len(part), 1)), part, conditions])
    starts = np.flatnonzero(np.diff(drops.case, prepend=-1))
    totals = np.add.reduceat(drops.counts, starts)

    def loss(x: Array) -> float:
        weight = np.exp(np.clip(inputs @ x, 0.0, 12.0))
        alpha = weight[drops.case] * np.maximum(shares, 1e-9)
        inner = gammaln(drops.counts + alpha) - gammaln(alpha)
        value = gammaln(weight) - gammaln(totals + weight) + np.add.reduceat(inner, starts)
        return float(-value.mean() + 1e-3 * (x[1:] ** 2).sum())

    start = np.zeros(inputs.shape[1])
    start[0] = 5.0
    return np.asarray(minimize(loss, start, method='L-BFGS-B').x)
