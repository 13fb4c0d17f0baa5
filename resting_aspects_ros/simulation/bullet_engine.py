"""The entry to Bullet: drops of any range of indices, in the worlds that their job needs."""

from resting_aspects_ros.simulation.bullet_edge import fall_over_edge, step_in_scene
from resting_aspects_ros.simulation.bullet_world import SceneWorld, World
from resting_aspects_ros.simulation.ends import resting_poses
from resting_aspects_ros.simulation.job import MAX_SEED, DropJob
from resting_aspects_ros.simulation.release import InitialState, initial_states
from resting_aspects_ros.simulation.settling import Settling
from resting_aspects_ros.statistics.poses import RestingPoses

# Number of drops that are simulated together, in the same place. All of them are, even if only
# some are wanted: Bullet sorts the contacts of a part with several bodies in an order that depends
# on the other parts, so that its motion depends on which there are. A drop takes 4 times as long
# alone, and 1.6 times as long with 125, because each pair costs time in each step, although the
# parts do not touch each other.
GROUP = 25


def drop_range(job: DropJob, first: int, end: int) -> RestingPoses:
    """Simulate the drops ``first`` to ``end - 1`` until they end; see engine.drop_range."""
    poses = []
    for low in range(first // GROUP * GROUP, end, GROUP):
        states = initial_states(job, low, min(low + GROUP, MAX_SEED + 1))
        poses.append(resting_poses(job, low, _settled(job, states).ends))
    return RestingPoses.join(poses).between(first, end)


def _settled(job: DropJob, states: InitialState) -> Settling:
    """Simulate drops in the world that they need."""
    if job.edge is None:
        return (World if job.scene is None else SceneWorld)(job).drop(states)
    return (fall_over_edge if job.scene is None else step_in_scene)(job, states)
