"""The part on which methods are compared, and the simulation of one body after another."""

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from dropper import ROOT, SEED

from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.core.rotations import Array, down_in_part
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import (
    CHUNK,
    BodyStates,
    InitialState,
    depth_of,
    initial_states,
    part_from_body,
)
from resting_aspects_ros.simulation.part_library import PartLibrary
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.settling import (
    CHECK_INTERVAL,
    REST_MOTION,
    REST_WINDOW,
    TIME_LIMIT,
    Settling,
)
from resting_aspects_ros.simulation.surfaces import Surfaces

EXAMPLE = 'l_bracket'


@dataclass(frozen=True, eq=False)
class Trial:
    """Timed drops.

    steps : float
        Total number of time steps of all bodies.
    down : (m, 3) float
        Down in part of the drops that came to rest.
    """

    drops: int
    seconds: float
    steps: float
    down: Array


class Body(Protocol):
    """One body in a world of any engine, in R and T, in tray axes."""

    def place(self, position: Array, orientation: Array) -> None:
        """Place the body at rest; orientation xyzw."""

    def step(self, steps: int) -> None:
        """Simulate this number of time steps."""

    def pose(self) -> list[float]:
        """Return x y z of the centre of mass, then the orientation xyzw, tray from body."""

    def states(self) -> BodyStates:
        """Return pose and motion, as arrays with one row."""


def example_part() -> Part:
    """Return the example part."""
    return PartLibrary(ROOT / 'config' / 'parts').load(EXAMPLE)


def job_of(part: Part) -> DropJob:
    """Return the job of a part on the default surface."""
    return make_job(part, Surfaces.read(ROOT / 'config' / 'surfaces.yaml').get(), SEED)


def example_job() -> DropJob:
    """Return the job of the example part on the default surface."""
    return job_of(example_part())


def full_starts(job: DropJob, chunks: range) -> list[InitialState]:
    """Return the orientations of the suite's drops, each at its full height and at rest."""
    c = job.conditions
    if c.height_of is not HeightOf.LOWEST_POINT or c.speed_horizontal or c.speed_vertical:
        raise ValueError('the comparison supports only a release at rest from a clearance')
    found = []
    for chunk in chunks:
        orientation = initial_states(job, chunk).orientation
        none = np.zeros((CHUNK, 3))
        position = none.copy()
        position[:, 2] = c.height / job.radius + depth_of(orientation, job.hull)
        found.append(InitialState(position, orientation, none, none, np.zeros(CHUNK)))
    return found


def drop_until_still(
    body: Body, job: DropJob, chunks: range, motion: float = REST_MOTION
) -> Trial:
    """Simulate one drop after another until it was still for REST_WINDOW."""
    look, window = steps_in(job, CHECK_INTERVAL), round(REST_WINDOW / CHECK_INTERVAL)
    starts = full_starts(job, chunks)
    ends, looks = [], 0
    started = time.perf_counter()
    for start in starts:
        for slot in range(CHUNK):
            body.place(start.position[slot], start.orientation[slot])
            before, still = body.pose(), 0
            for _ in range(round(TIME_LIMIT / CHECK_INTERVAL)):
                body.step(look)
                looks += 1
                now = body.pose()
                moved = max(abs(a - b) for a, b in zip(now, before, strict=True))
                before, still = now, still + 1 if moved < motion else 0
                if still == window:
                    ends.append(now)
                    break
    return still_trial(job, len(starts) * CHUNK, time.perf_counter() - started, looks * look, ends)


def drop_until_decided(body: Body, job: DropJob, chunks: range) -> Trial:
    """Simulate one drop after another until the suite's rule ends it, by energy or stillness."""
    look = steps_in(job, CHECK_INTERVAL)
    starts = full_starts(job, chunks)
    ends, looks = [], 0
    started = time.perf_counter()
    for start in starts:
        for slot in range(CHUNK):
            body.place(start.position[slot], start.orientation[slot])
            settling = Settling(job, start, np.array([slot]))
            drop_looks = 0
            while len(settling.moving):
                body.step(look)
                drop_looks += 1
                settling.check(drop_looks * CHECK_INTERVAL, body.states())
            looks += drop_looks
            ends.append(settling)
    seconds = time.perf_counter() - started
    settled = [end for end in ends if end.status[0] == RestStatus.SETTLED]
    down = down_in_part(part_from_body(np.vstack([s.orientation for s in settled]), job.axes))
    minima = np.concatenate([end.minimum for end in settled])
    down[minima >= 0] = job.rest.directions[minima[minima >= 0]]
    return Trial(len(ends), seconds, looks * look, down)


def still_trial(
    job: DropJob, drops: int, seconds: float, steps: int, ends: list[list[float]]
) -> Trial:
    """Return the trial of drops whose last poses are ``ends``."""
    orientation = np.array(ends).reshape(-1, 7)[:, 3:]
    down = down_in_part(part_from_body(orientation, job.axes))
    return Trial(drops, seconds, steps, down)


def steps_in(job: DropJob, duration: float) -> int:
    """Return the number of time steps in a duration, T."""
    return round(duration * job.steps_per_t)
