"""Transition matrices and retention curves: counts, probabilities and intervals."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics import intervals
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    bounds,
    stopping_confidence,
)
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# What an action leads to if not to an aspect: rest in no aspect, no rest within the time limit,
# a numerical error, or a part that left the surface. These are the last columns of a matrix.
OUTCOMES = ('unclassified', 'unsettled', 'failed', 'lost')
# The outcome for each status but that of a part at rest. A part that slides is not at rest.
_OUTCOME_OF = {
    RestStatus.UNSETTLED: 'unsettled',
    RestStatus.FAILED: 'failed',
    RestStatus.LOST: 'lost',
    RestStatus.SLIDING: 'unsettled',
}


@dataclass(frozen=True, eq=False)
class TransitionMatrix:
    """Counts of one action on the parts at rest in each aspect; each action is counted once.

    counts : (k, k + 4) int
        Actions from each aspect (row, by id from 1) to each aspect and to each of OUTCOMES
        (columns). After `by_class` it is (c, c + 4), with symmetry classes for aspects.
    interval : str
        Method of the intervals, one of intervals.METHODS.
    confidence : float
        Confidence of the intervals.
    by_precision : bool
        Whether the simulation stopped when its intervals were narrow enough.
    sliding : int
        Of all unsettled, those that slide or roll for ever; only in surroundings.
    energy_growth : float
        Maximum energy growth during the actions, m g R; see RestingPoses.
    """

    aspects: AspectSet
    counts: Counts
    interval: str = INTERVAL
    confidence: float = CONFIDENCE
    by_precision: bool = False
    energy_growth: float = 0.0
    sliding: int = 0

    @property
    def actions(self) -> Counts:
        """(k,) number of simulated actions from each aspect."""
        return np.asarray(self.counts.sum(axis=1))

    @property
    def probability(self) -> Array:
        """(k, k + 4) count / actions of the row; NaN in a row without actions."""
        actions = self.actions[:, None]
        return np.where(actions > 0, self.counts / np.maximum(actions, 1), np.nan)

    @property
    def transitions(self) -> Array:
        """(k, k) probabilities from each aspect to each aspect."""
        return self.probability[:, : len(self.counts)]

    @property
    def left(self) -> Array:
        """(k,) probability that an action leads to one of OUTCOMES."""
        return np.asarray(self.probability[:, len(self.counts) :].sum(axis=1))

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper bounds (k, k + 4) of the probabilities; see intervals.

        The intervals of a row use its number of actions; without actions they are 0 to 1.
        Simultaneous intervals hold together in each row, not in the whole matrix. After a stop by
        precision the intervals are slightly wider, to preserve their coverage; see stopping.
        """
        confidence = self.confidence
        if self.by_precision:
            confidence = stopping_confidence(confidence)
        return intervals.bounds(self.counts, self.actions, self.interval, confidence)

    def by_class(self) -> 'TransitionMatrix':
        """Return the matrix over the symmetry classes, in their order.

        The counts of the aspects of a class are summed in rows and columns, so an aspect with more
        simulated actions has more weight. Only for a matrix over aspects.
        """
        classes = self.aspects.classes()
        member = np.zeros((len(self.counts), len(classes)), dtype=np.int64)
        for number, members in enumerate(classes):
            member[[aspect.id - 1 for aspect in members], number] = 1
        rows = member.T @ self.counts
        aspects, outcomes = np.split(rows, [len(self.counts)], axis=1)
        return dataclasses.replace(self, counts=np.hstack([aspects @ member, outcomes]))

    def __add__(self, other: 'TransitionMatrix') -> 'TransitionMatrix':
        """Return the matrix over the actions of both: different simulations of the same action."""
        if self.aspects.part_sha256 != other.aspects.part_sha256:
            raise ValueError('transition matrices of different parts cannot be added')
        return dataclasses.replace(
            self,
            counts=self.counts + other.counts,
            sliding=self.sliding + other.sliding,
            energy_growth=max(self.energy_growth, other.energy_growth),
        )


def no_actions(
    aspects: AspectSet,
    *,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    by_precision: bool = False,
) -> TransitionMatrix:
    """Return the transition matrix before the first action."""
    none = np.zeros((len(aspects), len(aspects) + len(OUTCOMES)), dtype=np.int64)
    return TransitionMatrix(aspects, none, interval, confidence, by_precision)


def columns_of(poses: RestingPoses, ids: Counts, aspects: int) -> Counts:
    """Return the column (n,) of a matrix with a number of aspects in which each pose is counted.

    ``ids`` (n,) are the ids of the aspects of the poses; see `aspect_ids`.
    """
    column = np.where(ids > 0, ids - 1, aspects)
    for status, outcome in _OUTCOME_OF.items():
        column[poses.status == status] = aspects + OUTCOMES.index(outcome)
    return column


# -- Retention ------------------------------------------------------------------------------------


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
