"""Watching drops until they are over: energies, rest, and what goes wrong."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import Array, canonical, down_in_part, rotate, turned_down
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import (
    InitialState,
    body_from_part,
    depth_of,
    part_from_body,
)

# Time between looks, T.
LOOK = 0.5
# At rest: for REST_WINDOW T no coordinate and no quaternion component changes by more than
# REST_MOTION between looks. A part about to topple from an edge grows its tilt e-fold in about T,
# so that only a tilt below 1e-4 could be taken for rest. Windows of 0.5 to 60 T gave the same
# aspects (L bracket, T prism, hex nut; 500 drops of each).
REST_WINDOW = 2.0
REST_MOTION = 1e-4
# A drop failed if its centre of mass is deeper below the surface than this, R: an impact overlaps
# by the way of a step, a tenth of it.
DEEPEST = 0.5
# A drop that still moves after so many T is unsettled.
TIME_LIMIT = 500.0
# A drop failed if its energy is more than at any look before, by more than this part of it and of
# m g R. Newton's law of restitution with friction adds energy in some impacts (Kane and Levinson
# 1985): at 0.8 and 0.5 by up to 0.05 of it from look to look, at 0.95 and 1 by 0.2. What goes
# numerically wrong grows without bounds.
MAX_GROWTH = 0.5


@dataclass(frozen=True, eq=False)
class BodyStates:
    """Of n bodies, in R and T, tray axes.

    position, velocity : (n, 3) of the centre of mass, from the slot's origin; orientation : (n, 4)
    tray from body; spin : (n, 3).
    """

    position: Array
    orientation: Array
    velocity: Array
    spin: Array

    def of(self, which: npt.NDArray[Any]) -> 'BodyStates':
        """Of some of them."""
        return BodyStates(
            self.position[which], self.orientation[which], self.velocity[which], self.spin[which]
        )


class Settling:
    """The drops of one world, from release until each is over.

    The attributes have a row for each drop, in the order of the slots asked for.

    moving : (m,) int
        The drops that are not over.
    position, orientation
        As last seen; as States has them.
    status : (n,) uint8
        Codes of RestStatus.
    minimum : (n,) int
        The minimum of the landscape to which a drop rolls that was decided by its energy; else -1.
    time : (n,) float
        From release to the end, T.
    growth : (n,) float
        Largest growth of the energy from one look to the next, m g R.
    """

    def __init__(self, job: DropJob, release: InitialState, slots: npt.NDArray[np.int64]) -> None:
        n = len(slots)
        self._job = job
        self.moving = np.arange(n)
        self.position = release.position[slots]
        self.orientation = release.orientation[slots]
        self.status = np.full(n, RestStatus.UNSETTLED, dtype=np.uint8)
        self.minimum = np.full(n, -1)
        self.time = np.zeros(n)
        self.growth = np.zeros(n)
        self._elapsed = release.elapsed[slots]
        self._limit = TIME_LIMIT + release.flight
        self._still = np.zeros(n, dtype=np.int64)  # looks in a row without motion
        start = BodyStates(release.position, release.orientation, release.velocity, release.spin)
        self._energy = self._energies(start.of(slots))
        self._least = self._energy.copy()  # at any look so far

    @property
    def decided_by(self) -> npt.NDArray[np.uint8]:
        """(n,) codes of DecidedBy."""
        by_energy = self.minimum >= 0
        return np.where(by_energy, DecidedBy.ENERGY, DecidedBy.STILLNESS).astype(np.uint8)

    def look(self, now: float, states: BodyStates) -> npt.NDArray[np.int64]:
        """Look at the bodies that move, ``now`` T from the start; returns those that are over."""
        moving = self.moving
        failed = self._failed(states)
        self.status[moving[failed]] = RestStatus.FAILED
        self.time[moving[failed]] = math.nan
        sound = moving[~failed]
        still = self._still_ones(sound, states.of(~failed))
        if not self._job.until_still:
            self._decide(sound)
        decided = self.minimum[sound] >= 0
        self.status[sound[still | decided]] = RestStatus.SETTLED
        self.time[sound] = now + self._elapsed[sound]
        self.time[sound[still & ~decided]] -= REST_WINDOW
        goes_on = ~still & ~decided & (now < self._limit)
        self.moving = sound[goes_on]
        return np.concatenate([moving[failed], sound[~goes_on]])

    def _failed(self, states: BodyStates) -> npt.NDArray[np.bool_]:
        """Note the energies; returns which of the drops that move went numerically wrong."""
        numbers = (states.position, states.orientation, states.velocity, states.spin)
        sound = np.isfinite(np.hstack(numbers)).all(axis=1)
        # A thin part overlaps in an impact until its centre of mass is below the surface; so
        # deep it has fallen through.
        sound &= states.position[:, 2] >= -DEEPEST
        seen = self.moving[sound]
        before, energy = self._energy[seen], self._energies(states.of(sound))
        self._energy[seen] = energy
        self.growth[seen] = np.maximum(self.growth[seen], energy - before)
        least = self._least[seen] = np.minimum(self._least[seen], energy)
        sound[sound] = energy - least <= MAX_GROWTH * (least + 1)
        return np.asarray(~sound)

    def _still_ones(
        self, which: npt.NDArray[np.int64], states: BodyStates
    ) -> npt.NDArray[np.bool_]:
        """Keep what is seen of drops; returns which of them have been still for long enough."""
        motion = np.maximum(
            np.abs(states.position - self.position[which]).max(axis=1),
            np.abs(states.orientation - self.orientation[which]).max(axis=1),
        )
        self.position[which] = states.position
        self.orientation[which] = states.orientation
        self._still[which] = np.where(motion < REST_MOTION, self._still[which] + 1, 0)
        return np.asarray(self._still[which] * LOOK >= REST_WINDOW)

    def _decide(self, which: npt.NDArray[np.int64]) -> None:
        """Note the minima of drops whose energy has decided them."""
        rest = self._job.rest
        low = which[self._energy[which] < rest.highest]
        if len(low):
            down = down_in_part(part_from_body(self.orientation[low], self._job.axes))
            self.minimum[low] = rest.decided(down, self._energy[low])

    def _energies(self, states: BodyStates) -> Array:
        """(n,) kinetic energy and height above the surface, m g R."""
        job = self._job
        v, height = states.velocity, states.position[:, 2]
        spin = rotate(states.orientation * [-1, -1, -1, 1], states.spin)
        moments = job.moments
        kinetic = v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2
        for axis in range(3):
            kinetic += moments[axis] * spin[:, axis] ** 2
        # An impact overlaps, and the hull gets out of it again.
        return np.asarray(kinetic / 2 + np.maximum(height, depth_of(states.orientation, job.hull)))


def resting_poses(job: DropJob, first_drop: int, ends: Settling) -> RestingPoses:
    """The poses of drops that are over, the first of them with the index ``first_drop``."""
    failed = ends.status == RestStatus.FAILED
    body = np.where(failed[:, None], [0.0, 0.0, 0.0, 1.0], ends.orientation)
    orientation = canonical(part_from_body(body, job.axes))
    # What is decided by energy rolls on, to the minimum; how it turns and slides meanwhile is no
    # prediction.
    decided = ends.minimum >= 0
    orientation[decided] = turned_down(
        orientation[decided], job.rest.directions[ends.minimum[decided]]
    )
    centre = ends.position * job.radius
    # A hull rests a margin (0.001 R) above Bullet's plane; a part rests on the surface.
    settled = ends.status == RestStatus.SETTLED
    depth = depth_of(body_from_part(orientation, job.axes), job.hull) * job.radius
    centre[:, 2] = np.where(settled, depth, centre[:, 2])
    position = centre - rotate(orientation, job.centre_of_mass)
    return RestingPoses(
        first_drop=first_drop,
        position=np.where(failed[:, None], 0.0, position),
        orientation=orientation,
        status=ends.status,
        decided_by=ends.decided_by,
        time_to_rest=ends.time * job.time_unit,
        energy_growth=ends.growth,
    )
