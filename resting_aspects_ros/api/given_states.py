"""Drops from given initial states, counted by state."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.surroundings import scene_of
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.reorientation.transition_matrix import OUTCOMES, columns_of
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.noise import Noise
from resting_aspects_ros.simulation.run_description import MAX_DROPS
from resting_aspects_ros.simulation.starts import GivenStarts, GivenStates
from resting_aspects_ros.simulation.surroundings.release import depth_along, in_scene_axes
from resting_aspects_ros.simulation.surroundings.scene import Scene

DEFAULT_REPLICATES = 1
# A part may reach into a plane of surroundings by this, R; the engine moves it out.
MAX_OVERLAP = 0.01
# States that are checked together.
_BLOCK = 1000


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
    scene = scene_of(part, conditions)
    if scene is not None:
        _check_outside(part, scene, given)
    starts = GivenStarts(given, noise, conditions.gravity, part.hull_radius)
    return starts, replicates * len(given)


def _check_outside(part: Part, scene: Scene, given: GivenStates) -> None:
    """Raise InvalidValueError if a part begins inside a half-space of the surroundings."""
    corners = part.hull_vertices - part.centre_of_mass
    for first in range(0, len(given), _BLOCK):
        rows = slice(first, first + _BLOCK)
        position = scene.in_scene(given.position[rows])
        orientation = in_scene_axes(scene, given.orientation[rows])
        for plane in scene.half_spaces:
            reach = depth_along(orientation, -plane.normal, corners)
            gap = (position * plane.normal).sum(axis=1) - plane.offset - reach
            worst = int(gap.argmin())
            if gap[worst] < -MAX_OVERLAP * part.hull_radius:
                raise InvalidValueError(
                    f'invalid initial state {first + worst}: the part is '
                    f'{-1000 * gap[worst]:.4g} mm inside the {plane.name.replace("_", " ")}; '
                    'expected outside of the surroundings'
                )
