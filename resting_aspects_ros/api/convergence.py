"""What `resting_aspects drop --check-convergence` says: whether the time step shows."""

import math
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.simulation.run_description import MAX_DROPS

# Time steps of the check for each of the run's.
REFINEMENT = 2
# What the check is there to find, as a share of the drops.
TELLING = 0.01


@dataclass(frozen=True)
class Convergence:
    """How far a distribution moves when the same drops are made in finer steps.

    time_step : float
        The finer one, s.
    drops : int
        Made with each step.
    aspect : int
        Id of the one that moves most.
    shift : float
        Of its share of the drops that are in an aspect: with the finer step less without.
    lower, upper : float
        Bounds of the true shift; those of all aspects hold together with ``confidence``.
    p_value : float
        How often chance alone moves the shares at least so far.
    enough : int
        Drops, one digit of them, with which the widest of these bounds would tell TELLING; 0 in
        documents of earlier versions, which do not say it.
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
        """In lines of up to 80 columns."""
        enough = ''
        if not self.lower <= 0 <= self.upper:
            verdict = 'more than chance explains'
        elif self.upper - self.lower > 2 * TELLING:
            verdict = f'too few drops to see {100 * TELLING:g} %'
            enough = self._enough_text()
        else:
            verdict = 'as chance explains'
        return (
            f'In {REFINEMENT} times finer steps ({self.time_step * 1e6:.3g} us) aspect '
            f'{self.aspect} moves most: {100 * self.shift:+.2g} percentage points,\n'
            f'{verdict} ({100 * self.confidence:g} % interval {100 * self.lower:+.2g} to '
            f'{100 * self.upper:+.2g}, {self.drops} drops each).{enough}'
        )

    def _enough_text(self) -> str:
        if self.enough > MAX_DROPS:
            return f'\nIt would take more than the {MAX_DROPS} drops that a run can have.'
        return f'\nIt takes about {self.enough} drops.' if self.enough else ''


def check_convergence(
    coarse: Distribution, fine: Distribution, time_step: float, seed: int
) -> Convergence | None:
    """Compare the distribution of a run with that of the same drops in finer steps.

    The intervals are those of independent drops; these start alike, which makes them narrower if
    anything. None if no drop of one of them is in an aspect: there is nothing to compare.
    """
    if not (coarse.counts.any() and fine.counts.any()):
        return None
    # It takes a while to import, which a run without the check does not need.
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
        enough=_enough(fine.drops, float((found.upper - found.lower).max())),
    )


def _enough(drops: int, widest: float) -> int:
    # Intervals get narrower with the root of the drops.
    drops = math.ceil(drops * (widest / (2 * TELLING)) ** 2)
    step = 10 ** (len(str(drops)) - 1)
    return -(-drops // step) * step
