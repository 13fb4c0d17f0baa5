"""Drops from given initial states, counted by state."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.reorientation.transition_matrix import OUTCOMES, columns_of
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.noise import Noise
from resting_aspects_ros.simulation.run_description import MAX_DROPS
from resting_aspects_ros.simulation.starts import GivenStarts, GivenStates

DEFAULT_REPLICATES = 1


@dataclass(frozen=True, eq=False)
class CountsByState:
    """Counts of replicates by initial state; with k aspects.

    counts : (n, k + 4) int
        Replicates of each state that ended in each aspect, by id from 1, and then in each of
        unclassified, unsettled, failed, lost.
    """

    counts: npt.NDArray[np.int64]

    @property
    def columns(self) -> list[int | str]:
        """Ids of the aspects, then the names of the other outcomes."""
        return [*range(1, self.counts.shape[1] - len(OUTCOMES) + 1), *OUTCOMES]

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk of poses, given the ids of their aspects."""
        aspects = self.counts.shape[1] - len(OUTCOMES)
        column = columns_of(poses, ids, aspects)
        row = np.arange(poses.first_drop, poses.end) % len(self.counts)
        np.add.at(self.counts, (row, column), 1)

    @classmethod
    def none(cls, states: int, aspects: int) -> 'CountsByState':
        """Return counts without drops."""
        return cls(np.zeros((states, aspects + len(OUTCOMES)), dtype=np.int64))


def given_starts(
    part: Part, given: GivenStates, noise: Noise, conditions: DropConditions, replicates: int
) -> tuple[GivenStarts, int]:
    """Return the starts of a run and its number of drops; raises InvalidValueError."""
    limit = MAX_DROPS // len(given)
    if (
        not isinstance(replicates, int)
        or isinstance(replicates, bool)
        or not 1 <= replicates <= limit
    ):
        raise InvalidValueError(
            f'invalid replicates {replicates!r}: expected 1 to {limit} for {len(given)} states'
        )
    starts = GivenStarts(given, noise, conditions.gravity, part.hull_radius)
    return starts, replicates * len(given)
