"""The entry to the Bullet engine: the drops of a chunk, in the world that their job needs."""

import numpy as np

from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.bullet_world import World
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK, initial_states
from resting_aspects_ros.simulation.settling import resting_poses


def drop_chunk(job: DropJob, first_drop: int, end: int) -> RestingPoses:
    """Simulate the drops ``first_drop`` to ``end - 1`` of one chunk until they come to rest.

    The poses depend only on the job and on the index of each drop. They do not depend on which
    other drops of the chunk are simulated, or in which process.
    """
    chunk = first_drop // CHUNK
    if not chunk * CHUNK <= first_drop < end <= (chunk + 1) * CHUNK:
        raise ValueError(
            f'invalid drops {first_drop} to {end - 1}: expected drops of one chunk of {CHUNK}'
        )
    slots = np.arange(first_drop - chunk * CHUNK, end - chunk * CHUNK)
    states = initial_states(job, chunk)
    if job.scene is not None and job.edge is not None:
        from resting_aspects_ros.simulation.bullet_scene_edge import step_in_scene

        return step_in_scene(job, states, first_drop, end)
    if job.scene is not None:
        from resting_aspects_ros.simulation.bullet_scene import drop_in_scene

        return drop_in_scene(job, states, first_drop, end)
    if job.edge is None:
        return resting_poses(job, first_drop, World(job).drop(states, slots))
    from resting_aspects_ros.simulation.bullet_edge import fall_over_edge

    return resting_poses(job, first_drop, fall_over_edge(job, states, slots))
