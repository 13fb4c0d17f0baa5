"""Retention curves: how likely a part leaves its aspect, by the energy of a disturbance."""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.statistics.intervals import INTERVAL, Array, Counts, bounds

# Probabilities to leave whose lift heights are reported.
LEVELS = (0.01, 0.1, 0.5)


@dataclass(frozen=True, eq=False)
class RetentionCurve:
    """Counts of the parts that left one aspect after disturbances of m energies.

    The curve need not be monotone, because a strongly disturbed part can return to its aspect.
    Between the heights it is interpolated linearly; at height 0 the probability is 0.

    aspect : int
        Id of the aspect.
    barrier : float
        Minimum rise of the centre of mass to leave the aspect, m; infinite for the only aspect.
    lift : (m,) float
        Energy of the disturbance / (mass x gravity), a lift height of the centre of mass, m;
        positive and ascending.
    left : (m,) int
        Parts that left the aspect: at rest elsewhere, unclassified, unsettled, failed or lost.
    parts : (m,) int
        Parts that were disturbed, at least one for each height.
    confidence : float
        Confidence of the intervals, each by itself.
    """

    aspect: int
    barrier: float
    lift: Array
    left: Counts
    parts: Counts
    confidence: float

    @property
    def probability(self) -> Array:
        """(m,) share of the parts that left the aspect."""
        return np.asarray(self.left / self.parts)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper Wilson bounds (m,) of the probability."""
        lower, upper = bounds(self.left[:, None], self.parts, INTERVAL, self.confidence)
        return lower[:, 0], upper[:, 0]

    def lift_at(self, level: float) -> float:
        """Return the lift height at which the probability first reaches a level, m.

        It is NaN if the level is not reached up to the maximum height. Raises InvalidValueError
        unless the level is more than 0 and less than 1.
        """
        return self._first_crossing(self.probability, level)

    def lift_interval(self, level: float) -> tuple[float, float]:
        """Return the interval of `lift_at`, m.

        Its ends are the heights at which the upper and the lower bound of the probability first
        reach the level. The lower end is at least the barrier, unless `lift_at` is below it: the
        counts then contradict the barrier. An end that is not reached up to the maximum height is
        NaN.
        """
        lower, upper = self.bounds()
        lift = self.lift_at(level)
        lowest, highest = (self._first_crossing(curve, level) for curve in (upper, lower))
        if lowest < self.barrier < np.inf and not lift < self.barrier:
            lowest = max(lowest, min(self.barrier, float(self.lift[-1])))
        # A rounding error in the interpolation must not separate the interval from the lift.
        return float(np.fmin(lowest, lift)), float(np.maximum(highest, lift))

    def _first_crossing(self, curve: Array, level: float) -> float:
        if not 0 < level < 1:
            raise InvalidValueError(
                f'invalid level {level!r}: expected more than 0 and less than 1'
            )
        curve, lift = np.append(0.0, curve), np.append(0.0, self.lift)
        reached = np.flatnonzero(curve >= level)
        if not len(reached):
            return float('nan')
        step = slice(reached[0] - 1, reached[0] + 1)
        return float(np.interp(level, curve[step], lift[step]))
