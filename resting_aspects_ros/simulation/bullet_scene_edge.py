"""A step in surroundings in Bullet: parts move over the edge of the floor onto a lower floor.

The axes are those of the scene frame, in which the lower floor is z = 0, and the walls are the
same above and below the edge. Parts move over the edge as they do without walls; see
bullet_edge.py.
"""

import math
from functools import partial

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.bullet_edge import (
    CAPSULE_LENGTH,
    CAPSULES,
    CARRIED,
    GROUP,
    SHORT,
    EdgeWorld,
    move_over_edge,
)
from resting_aspects_ros.simulation.bullet_scene import TOGETHER, SceneWorld
from resting_aspects_ros.simulation.bullet_wall import FAR, WallWorld, WorldWithEdge
from resting_aspects_ros.simulation.bullet_world import SLOT_SPACING
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK, InitialState
from resting_aspects_ros.simulation.surroundings.scene_settling import (
    SceneSettling,
    poses_in_scene,
)

# Distance, R, by which the belt carries a part until it is beyond the edge: it starts as a whole
# behind it.
CARRIED_IN_SCENE = CARRIED + 2.0


def step_in_scene(job: DropJob, states: InitialState, first_drop: int, end: int) -> RestingPoses:
    """Return the resting poses of the drops ``first_drop`` to ``end - 1`` of one chunk.

    All parts of a group are simulated; see bullet_scene.py.
    """
    scene = job.scene
    assert scene is not None
    start = first_drop // CHUNK * CHUNK
    status = np.full(CHUNK, RestStatus.UNSETTLED, dtype=np.uint8)
    everyone = np.arange(CHUNK)
    size = CHUNK if scene.free == 2 else TOGETHER
    low, high = ((each - start) // size for each in (first_drop, end - 1))
    wanted = everyone[(everyone // size >= low) & (everyone // size <= high)]
    across = states.position[:, 1].min(), states.position[:, 1].max()
    world = partial(SceneEdgeWorld, job, across)
    for group in np.unique(wanted // GROUP):
        move_over_edge(job, world, states, status, everyone[everyone // GROUP == group])
    poses = []
    for slots in wanted.reshape(-1, size):
        ends = SceneWallWorld(job).ended(states, slots, status[slots])
        poses.append(poses_in_scene(job, start + int(slots[0]), ends))
    return RestingPoses.join(poses).between(first_drop, end)


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

    def ended(
        self, states: InitialState, slots: npt.NDArray[np.int64], status: npt.NDArray[np.uint8]
    ) -> SceneSettling:
        """Step until all parts that passed the edge have ended; ``status``: see move_over_edge."""
        apart = float(self._scene.free == 2)
        origins = np.stack([0 * slots, slots, 0 * slots], axis=1) * SLOT_SPACING * apart
        settling = SceneSettling(self._job, states, slots)
        return self._from_edge(settling, states, slots, status, origins)
