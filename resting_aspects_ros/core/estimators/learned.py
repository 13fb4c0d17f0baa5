"""The learned estimator: fitted to drops of random solids, for given conditions.

The weight of an aspect is exp(score). The score is a sum over the features of the aspect, with
coefficients that depend linearly on the features of the conditions, and a small network with one
hidden layer over all features. The probabilities are the mean of several fits. All coefficients
are in learned.json, which `make learned` writes.
"""

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.core.estimators.aspect_features import AspectFeatures, aspect_features
from resting_aspects_ros.core.estimators.release import Bounds, Release
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.rotations import Array

FILE = Path(__file__).with_name('learned.json')
# Standardized features are limited to this, so that unusual parts are not extrapolated.
MAX_FEATURE = 4.0
# Of a prediction for conditions beyond those of the fit: the number of drops with the deviation of
# the best analytic method, 7.2 points (root mean square), at the mean variance of a share, 0.14.
OUTSIDE_WEIGHT = 26.0


@dataclass(frozen=True, eq=False)
class Scaling:
    """Means and standard deviations of the features of the drops to which a model was fitted."""

    mean: Array
    deviation: Array

    def scaled(self, features: Array) -> Array:
        """Return standardized features, limited to MAX_FEATURE."""
        scaled = (features - self.mean) / self.deviation
        return np.asarray(np.clip(scaled, -MAX_FEATURE, MAX_FEATURE))


@dataclass(frozen=True, eq=False)
class Member:
    """The coefficients of one fit.

    direct : (f, c + 1) float
        Of the features of an aspect: for each feature of the conditions, and constant.
    into : (f + c + g, h), hidden : (h,), out : (h,) float
        The network, from the features of aspect, conditions and part.
    """

    direct: Array
    into: Array
    hidden: Array
    out: Array

    def scores(self, aspects: Array, common: Array, conditions: Array) -> Array:
        """Return the scores (k,) of aspects.

        Parameters
        ----------
        aspects : (k, f) float
            Scaled features of the aspects.
        common : (k, c + g) float
            Scaled features of the conditions and of the part.
        conditions : (k, c + 1) float
            Scaled features of the conditions, and 1.
        """
        direct = ((aspects @ self.direct) * conditions).sum(axis=1)
        inner = np.tanh(np.concatenate([aspects, common], axis=1) @ self.into + self.hidden)
        return np.asarray(direct + inner @ self.out)


@dataclass(frozen=True, eq=False)
class LearnedModel:
    """The coefficients of the learned estimator.

    of_aspects, of_part, of_conditions : Scaling
    members : tuple of Member
    weight : (1 + g + c,) float
        Coefficients of the logarithm of the weight of a prediction, in drops: constant, and of the
        scaled features of the part and of the conditions.
    bounds : Bounds
        Conditions for which it was fitted.
    """

    of_aspects: Scaling
    of_part: Scaling
    of_conditions: Scaling
    members: tuple[Member, ...]
    weight: Array
    bounds: Bounds

    def predict(self, features: AspectFeatures, release: Release) -> tuple[Array, float]:
        """Return the probabilities (k,) of the aspects, and the weight of the prediction, drops.

        The weight is the number of drops whose counts, as a Dirichlet distribution, have the same
        uncertainty as the prediction.
        """
        aspects, part, conditions = self.scaled(features, release)
        count = len(aspects)
        common = np.tile(np.concatenate([conditions, part]), (count, 1))
        with_one = np.tile(np.append(conditions, 1.0), (count, 1))
        shares = [_softmax(each.scores(aspects, common, with_one)) for each in self.members]
        weight = np.exp(np.concatenate([[1.0], part, conditions]) @ self.weight)
        return np.mean(shares, axis=0), float(weight)

    def weighing(self, weight: Array) -> 'LearnedModel':
        """Return the same model with other coefficients of the weight."""
        return replace(self, weight=weight)

    def scaled(self, features: AspectFeatures, release: Release) -> tuple[Array, Array, Array]:
        """Return the scaled features of the aspects, of the part and of the conditions."""
        return (
            self.of_aspects.scaled(features.values),
            self.of_part.scaled(features.of_part),
            self.of_conditions.scaled(release.features(features.moments)),
        )


def learned(shape: RestingShape, release: Release) -> tuple[Array, float]:
    """Return the probabilities (k,) of the aspects, and the weight of the prediction, drops.

    Conditions beyond those of the fit are replaced by the nearest ones within, and the weight is
    at most OUTSIDE_WEIGHT.
    """
    model = shipped_model()
    shares, weight = model.predict(aspect_features(shape), model.bounds.nearest(release))
    return shares, min(weight, OUTSIDE_WEIGHT) if model.bounds.outside(release) else weight


@lru_cache(maxsize=1)
def shipped_model() -> LearnedModel:
    """Return the model in the package."""
    return model_from(json.loads(FILE.read_text(encoding='utf-8')))


def model_from(document: dict[str, Any]) -> LearnedModel:
    """Return the model in a JSON document."""
    scalings = {
        name: Scaling(np.array(each['mean']), np.array(each['deviation']))
        for name, each in document['scaling'].items()
    }
    return LearnedModel(
        of_aspects=scalings['aspects'],
        of_part=scalings['part'],
        of_conditions=scalings['conditions'],
        members=tuple(
            Member(**{name: np.array(values) for name, values in each.items()})
            for each in document['members']
        ),
        weight=np.array(document['weight']),
        bounds=Bounds(**{name: tuple(pair) for name, pair in document['bounds'].items()}),
    )


def _softmax(scores: Array) -> Array:
    weights = np.exp(scores - scores.max())
    return np.asarray(weights / weights.sum())
