"""Convergence check of `drop`: whether the time step affects the distribution."""

import math
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.simulation.run_description import MAX_DROPS

# Number of time steps of the check for each time step of the run.
REFINEMENT = 2
# The change of a share that the check is meant to detect.
DETECTABLE_SHIFT = 0.01


@dataclass(frozen=True)
class Convergence:
    """Change of a distribution when its drops are repeated with a finer time step.

    time_step : float
        The finer time step, s.
    drops : int
        Number of drops with each time step.
    aspect : int
        Id of the aspect whose share changes most.
    shift : float
        Change of its share of the drops that are in an aspect: fine minus coarse.
    lower, upper : float
        Bounds of the true shift; those of all aspects hold together with ``confidence``.
    p_value : float
        Probability that chance alone changes the shares at least as much.
    enough : int
        Number of drops, rounded up to one digit, with which the widest of these bounds would
        detect DETECTABLE_SHIFT; 0 if a document of an earlier version does not have it.
    """

    time_step: float
    drops: int
    aspect: int
    shift: float
    lower: float
    upper: float
    confidence: float
    p_value: float
    enough: int = 0

    def text(self) -> str:
        """Return the change and a verdict, in lines of up to 80 columns."""
        enough = ''
        if not self.lower <= 0 <= self.upper:
            verdict = 'not explained by chance'
        elif self.upper - self.lower > 2 * DETECTABLE_SHIFT:
            verdict = f'too few drops to detect {100 * DETECTABLE_SHIFT:g} %'
            enough = self._enough_text()
        else:
            verdict = 'explained by chance'
        return (
            f'With 1/{REFINEMENT} of the time step ({self.time_step * 1e6:.3g} us), aspect '
            f'{self.aspect} changes most: {100 * self.shift:+.2g} points,\n'
            f'{verdict} ({100 * self.confidence:g} % interval {100 * self.lower:+.2g} to '
            f'{100 * self.upper:+.2g}, {self.drops} drops each).{enough}'
        )

    def _enough_text(self) -> str:
        if self.enough > MAX_DROPS:
            return f'\nMore than the maximum of {MAX_DROPS} drops are needed.'
        return f'\nAbout {self.enough} drops are needed.' if self.enough else ''


def check_convergence(
    coarse: Distribution, fine: Distribution, time_step: float, seed: int
) -> Convergence | None:
    """Compare the distribution of a run with that of the same drops with a finer time step.

    The intervals are those of independent drops. They are conservative here, because both sets
    start from the same states. Returns None if one of them has no drop in an aspect.
    """
    if not (coarse.counts.any() and fine.counts.any()):
        return None
    # This import is slow, and only needed for the check.
    from resting_aspects_ros.core.statistics.comparison import compare

    found = compare(fine, coarse, np.random.default_rng(seed), coarse.confidence)
    lower, upper = found.largest_bounds
    return Convergence(
        time_step=time_step,
        drops=fine.drops,
        aspect=found.largest_aspect,
        shift=found.largest_deviation,
        lower=lower,
        upper=upper,
        confidence=found.confidence,
        p_value=found.p_value,
        enough=_required_drops(fine.drops, float((found.upper - found.lower).max())),
    )


def _required_drops(drops: int, max_width: float) -> int:
    # The width of an interval is inversely proportional to the root of the number of drops.
    drops = math.ceil(drops * (max_width / (2 * DETECTABLE_SHIFT)) ** 2)
    step = 10 ** (len(str(drops)) - 1)
    return -(-drops // step) * step
