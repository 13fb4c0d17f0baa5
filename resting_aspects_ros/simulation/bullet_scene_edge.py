"""A step in surroundings in Bullet: parts move over the edge of the floor onto a lower floor.

The axes are those of the scene frame, in which the lower floor is z = 0, and the walls are the
same above and below the edge. Parts move over the edge as they do without walls; see
bullet_edge.py.
"""

import math
from functools import partial

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.bullet_edge import (
    CAPSULE_LENGTH,
    CAPSULES,
    CARRIED,
    SHORT,
    EdgeWorld,
    over_edge,
)
from resting_aspects_ros.simulation.bullet_scene import SceneWorld
from resting_aspects_ros.simulation.bullet_wall import FAR, WallWorld, WorldWithEdge
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import InitialState
from resting_aspects_ros.simulation.surroundings.scene_settling import SceneSettling

# Distance, R, by which the belt carries a part until it is beyond the edge: it starts as a whole
# behind it.
CARRIED_IN_SCENE = CARRIED + 2.0


def step_in_scene(job: DropJob, states: InitialState) -> SceneSettling:
    """Move parts over the edge, and step until each has ended."""
    across = states.position[:, 1].min(), states.position[:, 1].max()
    passed, status = over_edge(job, partial(SceneEdgeWorld, job, across), states)
    return SceneWallWorld(job).ended(passed, status)


class SceneWithEdge(WorldWithEdge, SceneWorld):
    """A world with surroundings, in which bodies can be added that belong to the upper floor."""

    def _add_at_rest(self, shape: int) -> int:
        # As the level belt below an edge. With useMaximalCoordinates, the shares of a box that
        # falls from an edge differ by up to 0.1: it hits the floor with two corners at almost the
        # same time. With the same kind of body, they agree (n = 1500).
        return self._add_static(shape)

    def _add_of_edge(self, shape: int) -> int:
        """Add a static body with the contact of the floor, changed as the step states."""
        edge = self._job.edge
        assert edge is not None
        body, floor = self._add_static(shape), self._scene.bodies[0]
        self._set_pair(body, floor)
        self._set(
            body,
            lateralFriction=floor.contact.friction * edge.friction_factor,
            restitution=floor.contact.restitution * edge.restitution_factor,
        )
        return body


class SceneEdgeWorld(EdgeWorld, SceneWithEdge):
    """A world with both floors, the edge and the walls; it does not move.

    across : (float, float)
        Between which places across the edge the parts are, R.
    """

    _carried = CARRIED_IN_SCENE

    def __init__(self, job: DropJob, across: tuple[float, float], min_steps_per_t: int) -> None:
        self._across = across
        super().__init__(job, min_steps_per_t)

    def _frame_velocity(self, job: DropJob) -> Array:
        del job
        return np.zeros(3)

    def _place_lower_belt(self) -> None:
        """Do nothing: the floor of the scene has its speed already."""

    def _add_rollers(self) -> list[int]:
        """Add rollers of short capsules where the parts are, and one of long capsules beside."""
        length = CAPSULES * CAPSULE_LENGTH
        low, high = self._across
        count = math.ceil((high - low) / length) + 1  # parts reach by up to R beyond their places
        first = (low + high - count * length) / 2
        rollers = [
            self._add_roller(
                (SHORT + first + (k + 0.5) * length).tolist(), [CAPSULE_LENGTH] * CAPSULES
            )
            for k in range(count)
        ]
        last = first + count * length
        beside = [first - FAR / 2, last + FAR / 2]
        return [*rollers, self._add_roller(beside, [FAR, FAR])]


class SceneWallWorld(WallWorld, SceneWithEdge):
    """A world with the lower floor, at rest, the walls, and the wall below the edge."""

    def ended(self, states: InitialState, status: npt.NDArray[np.uint8]) -> SceneSettling:
        """Step until all parts that passed the edge have ended; ``status``: see over_edge."""
        return self._from_edge(SceneSettling(self._job, states), states, status)
