"""The conditions of a surface that were fitted to counts, and whether they explain them."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.studies.calibration.checks import GTest, Prediction
from resting_aspects_ros.studies.calibration.fit import Fit
from resting_aspects_ros.studies.calibration.summary import Estimate, discrepancy

DRAWS = 200  # of the posterior, in the document
# Below this probability, the counts are said to contradict the simulation.
CONTRADICTED = 0.01
# A mean discrepancy above this, 5 points at a share of one half, is too large for a surface.
MAX_DISCREPANCY = 0.1


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """What counts say of a surface.

    Attributes
    ----------
    estimates : tuple of Estimate
        Value and uncertainty of each fitted condition.
    predictions : tuple of Prediction
        Of each part, from the counts of all parts.
    left_out : tuple of Prediction
        Of each part, from the counts of the others; empty if there is one part.
    g_test : GTest
        Whether any conditions in the ranges explain the counts, without a discrepancy.
    fit : Fit
    """

    fit: Fit
    estimates: tuple[Estimate, ...]
    predictions: tuple[Prediction, ...]
    left_out: tuple[Prediction, ...]
    g_test: GTest
    seed: int

    @property
    def surface(self) -> str:
        """Name of the surface."""
        return self.fit.given.surface

    @property
    def conditions(self) -> DropConditions:
        """The most probable conditions."""
        best = {each.factor.name: float(f'{each.best:.3g}') for each in self.estimates}
        return dataclasses.replace(self.fit.given.base.changed(**best), surface=self.surface)

    @property
    def left_out_deviation(self) -> float:
        """Mean absolute deviation of the shares of parts that were left out; NaN for one part."""
        if not self.left_out:
            return float('nan')
        return float(np.mean([each.deviation for each in self.left_out]))

    @property
    def contradicted(self) -> bool:
        """Whether no conditions in the ranges explain the counts."""
        return self.g_test.p < CONTRADICTED

    @property
    def usable(self) -> bool:
        """Whether the surface describes the counts at least roughly."""
        return not self.contradicted or discrepancy(self.fit)[0] <= MAX_DISCREPANCY

    def draws(self, size: int = DRAWS) -> list[dict[str, float]]:
        """Return conditions that are drawn from the posterior, as values of the factors."""
        rng = np.random.default_rng(self.seed)
        weights = self.fit.posterior.weights().sum(axis=0)
        chosen = self.fit.posterior.points[rng.choice(len(weights), size, p=weights)]
        factors = self.fit.given.factors
        columns = [factor.values(chosen[:, k]).tolist() for k, factor in enumerate(factors)]
        return [
            dict(zip((f.name for f in factors), row, strict=True))
            for row in zip(*columns, strict=True)
        ]
