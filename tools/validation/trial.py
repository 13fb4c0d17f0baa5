"""Drops from the full height in an engine other than those of the suite: start, planes and end."""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.rotations import down_in_part
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import (
    InitialState,
    depth_of,
    initial_states,
    part_from_body,
)


@dataclass(frozen=True, eq=False)
class Trial:
    """Timed drops, and down in part, (m, 3), of those that came to rest."""

    drops: int
    seconds: float
    down: Array


def released(job: DropJob, first: int, drops: int) -> InitialState:
    """Return the states at the release; on the plane with the fall that the suite leaves out."""
    states, c = initial_states(job, first, first + drops), job.conditions
    if job.scene.level:
        if c.height_of is not HeightOf.LOWEST_POINT or c.speed_horizontal or c.speed_vertical:
            raise ValueError(f'invalid conditions {c}: expected a release at rest, by clearance')
        states.position[:, 2] = c.height / job.radius + depth_of(states.orientation, job.hull)
        states.velocity[:] = 0
    return states


def contacts_of(job: DropJob) -> list[tuple[Array, float, float, float]]:
    """Return normal, offset (R), friction and restitution of each plane."""
    c = job.conditions
    if job.scene.level:
        return [(np.array([0.0, 0.0, 1.0]), 0.0, c.friction, c.restitution)]
    return [
        (p.normal, p.offset / job.radius, p.contact.friction, p.contact.restitution)
        for p in job.scene.half_spaces
    ]


def ended(job: DropJob, seconds: float, drops: int, orientation: Array) -> Trial:
    """Return the trial of drops whose orientations at rest, (m, 4), are those of the body."""
    return Trial(drops, seconds, down_in_part(part_from_body(orientation, job.axes)))
