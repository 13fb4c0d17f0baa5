"""Deviations of all methods from counted drops of random solids."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from learned_drops import Case
from scipy.stats import betabinom

from resting_aspects_ros.core.estimators.aspect_features import AspectFeatures
from resting_aspects_ros.core.estimators.estimate import LEARNED, METHODS
from resting_aspects_ros.core.estimators.learned import LearnedModel

Array = npt.NDArray[np.float64]
Counted = tuple[Case, list[int]]
SolidFeatures = tuple[AspectFeatures, dict[str, Array]]

CONFIDENCE = 0.9


@dataclass(frozen=True, eq=False)
class KindModel:
    """A model that was fitted without a kind of solids, and its coefficients of the weight."""

    model: LearnedModel
    weight: Array

    def predict(self, features: AspectFeatures, case: Case) -> tuple[Array, float]:
        """Return the probabilities (k,) of a case, and their weight."""
        return self.model.weighing(self.weight).predict(features, case.release)


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the methods predict for a case, and what was counted.

    deviations : dict
        Mean absolute deviation over the aspects by method; without those that are not defined.
    variances : dict
        Mean over the aspects of the squared deviation, without the part that is due to sampling.
    inside : (k,) bool
        Whether the count of each aspect is within the interval of LEARNED.
    weight : float
        That of the prediction of LEARNED, drops.
    """

    case: Case
    drops: int
    curved: bool
    deviations: dict[str, float]
    variances: dict[str, float]
    inside: npt.NDArray[np.bool_]
    weight: float


@dataclass(frozen=True, eq=False)
class Judgements:
    """The judgements of the training set, by models without the kind, and of the test set."""

    training: list[Judgement]
    test: list[Judgement]


def judged(
    training: Sequence[Counted],
    test: Sequence[Counted],
    features: Mapping[tuple[int, int], SolidFeatures],
    models: Mapping[str, KindModel],
) -> Judgements:
    """Return the judgements; every prediction is by the model without the kind of the case."""
    groups = [
        [
            judge(case, counts, *features[case.solid], models[case.kind])
            for case, counts in cases
            if case.kind in models
        ]
        for cases in (training, test)
    ]
    return Judgements(*groups)


def judge(
    case: Case,
    counts: Sequence[int],
    features: AspectFeatures,
    analytic: Mapping[str, Array],
    model: KindModel,
) -> Judgement:
    """Return the judgement of a case, over the drops that are in an aspect."""
    number = np.array(counts[: len(features.values)])
    drops = int(number.sum())
    shares = number / drops
    sampling = shares * (1 - shares) / max(drops - 1, 1)
    predicted, weight = model.predict(features, case)
    predictions = {**analytic, LEARNED: predicted}
    names = [name for name in METHODS if name in predictions]
    off = {name: predictions[name] - shares for name in names}
    alpha = np.maximum(weight * predicted, 1e-6)
    tail = (1 - CONFIDENCE) / 2
    low, high = (
        betabinom.ppf(q, drops, alpha, np.maximum(weight - alpha, 1e-6)) for q in (tail, 1 - tail)
    )
    return Judgement(
        case,
        drops,
        bool({'crsa', 'stability'} - set(analytic)),
        {name: float(np.abs(each).mean()) for name, each in off.items()},
        {name: float((each**2 - sampling).mean()) for name, each in off.items()},
        (low <= number) & (number <= high),
        weight,
    )


def mean_deviation(judgements: Sequence[Judgement], method: str) -> float:
    """Return the mean of the mean deviations of the cases for which a method is defined."""
    found = [each.deviations[method] for each in judgements if method in each.deviations]
    return float(np.mean(found)) if found else float('nan')


def true_deviation(judgements: Sequence[Judgement], method: str) -> float:
    """Return the root of the mean squared deviation of a method, without that of sampling."""
    found = [each.variances[method] for each in judgements if method in each.variances]
    return float(max(float(np.mean(found)), 0.0) ** 0.5) if found else float('nan')


def coverage(judgements: Sequence[Judgement]) -> float:
    """Return the share of the counts that are within the intervals of LEARNED."""
    return float(np.concatenate([each.inside for each in judgements]).mean())
