"""Drops on the plane from the full height in an engine other than those of the suite."""

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.rotations import down_in_part
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import InitialState, initial_states, part_from_body
from resting_aspects_ros.simulation.scene import depth_of


def released(job: DropJob, first: int, drops: int) -> InitialState:
    """Return the states at the release, with the fall that the suite leaves out."""
    states, c = initial_states(job, first, first + drops), job.conditions
    if c.height_of is not HeightOf.LOWEST_POINT or c.speed_horizontal or c.speed_vertical:
        raise ValueError(f'invalid conditions {c}: expected a release at rest, by clearance')
    states.position[:, 2] = c.height / job.radius + depth_of(states.orientation, job.hull)
    states.velocity[:] = 0
    return states


def down_at_rest(job: DropJob, orientation: Array) -> Array:
    """Return down in part, (m, 3), of drops with these orientations of the body, (m, 4)."""
    return down_in_part(part_from_body(orientation, job.axes))
