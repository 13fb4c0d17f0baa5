"""Detection of the end of a drop: at rest, decided by its energy, lost, failed or timed out."""

import math

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.core.rotations import Array, down_in_part, rotate
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.ends import Ends
from resting_aspects_ros.simulation.initial_state import (
    BodyStates,
    InitialState,
    depth_of,
    part_from_body,
)

# Time between checks of the bodies, T.
CHECK_INTERVAL = 0.5
# A part is at rest if, for REST_WINDOW T, no coordinate and no quaternion component changes by
# more than REST_MOTION between checks. The tilt of a part about to topple from an edge grows by a
# factor of e in about T, so only a tilt below 1e-4 could be mistaken for rest. Windows of 0.5 to
# 60 T gave the same aspects (L bracket, T prism, hex nut; 500 drops of each).
REST_WINDOW = 2.0
REST_MOTION = 1e-4
# A part slides on the surface if its distance from it, R, is at most this, and its vertical speed,
# R / T, and its rates of tilting, 1 / T, are below that at which impacts begin to bounce.
MAX_SLIDE_GAP = 0.01
MAX_SLIDE_RATE = 0.05
# A drop has failed if its centre of mass is further below the surface than this, R. The
# penetration of an impact is at most the travel of one step, a tenth of this limit.
MAX_DEPTH = 0.5
# A drop that still moves after this time, T, is unsettled.
TIME_LIMIT = 500.0
# A drop has failed if its energy exceeds the minimum of all earlier checks by more than this
# fraction of the minimum plus m g R. Newton's law of restitution with friction adds energy in some
# impacts (Kane and Levinson 1985): with restitution 0.8 and friction 0.5 by a fraction of up to
# 0.05 between checks, with 0.95 and 1 by 0.2. Numerical failures grow without bounds.
MAX_GROWTH = 0.5


class Settling:
    """The drops of one world, from release until each has ended.

    The attributes have one row for each drop.

    moving : (m,) int
        Rows of the drops that have not ended.
    position, orientation
        At the last check; see BodyStates.
    status : (n,) uint8
        Codes of RestStatus.
    minimum : (n,) int
        For a drop decided by its energy, the minimum of the landscape to which it will roll;
        otherwise -1.
    time : (n,) float
        From release to the end, T.
    growth : (n,) float
        Maximum growth of the energy between two checks, m g R.
    """

    def __init__(self, job: DropJob, states: InitialState) -> None:
        n = len(states.elapsed)
        self._job = job
        self.moving = np.arange(n)
        self.position = states.position.copy()
        self.orientation = states.orientation.copy()
        self.status = np.full(n, RestStatus.UNSETTLED, dtype=np.uint8)
        self.minimum = np.full(n, -1)
        self.time = np.zeros(n)
        self.growth = np.zeros(n)
        self._elapsed = states.elapsed
        motion = job.motion
        self._limit = TIME_LIMIT + (float(states.flight.max()) if job.edge is None else 0.0)
        if motion is not None:
            self._limit += motion.duration / job.time_unit
        self._now = 0.0
        self._still = np.zeros(n, dtype=np.int64)  # consecutive checks without motion
        start = BodyStates(states.position, states.orientation, states.velocity, states.spin)
        self._energy = self._energies(start)
        self._min_energy = self._energy.copy()  # of all checks

    @property
    def ends(self) -> Ends:
        """How the drops have ended."""
        return Ends(
            self.position, self.orientation, self.status, self.minimum, self.time, self.growth
        )

    def check(self, now: float, states: BodyStates) -> npt.NDArray[np.int64]:
        """Update the moving bodies, ``now`` T after the start; returns the drops that ended.

        While the surface moves, a part can only be lost or fail: its energy and its stillness
        count from the first check after the end of the motion.
        """
        moving = self.moving
        shaken = self._job.in_motion(self._now)  # at some time since the last check
        self._now = now
        place = self._on_surface(states.position, now)
        clear = self._job.clear_of_wall(states.position[:, 0], now)
        gains = np.full(len(moving), shaken) | (~clear & (self._job.wall_speed != 0))
        failed = self._failed(states, place[:, 2], gains)
        self.status[moving[failed]] = RestStatus.FAILED
        self.time[moving[failed]] = math.nan
        sound = moving[~failed]
        still = self._update_still(sound, states.select(~failed), restart=shaken)
        lost = self._left(place[~failed])
        self.status[sound[lost]] = RestStatus.LOST
        if not (self._job.until_still or shaken):
            free = ~lost & clear[~failed]
            self._decide(sound[free])
            self._decide_sliding(sound[free], states.select(~failed).select(free))
        decided = self.minimum[sound] >= 0
        still &= ~lost
        self.status[sound[still | decided]] = RestStatus.SETTLED
        self.time[sound] = now + self._elapsed[sound]
        self.time[sound[still & ~decided]] -= REST_WINDOW
        continues = ~still & ~decided & ~lost & (now < self._limit)
        self.moving = sound[continues]
        return np.concatenate([moving[failed], sound[~continues]])

    def _on_surface(self, position: Array, now: float) -> Array:
        """Return positions (n, 3) in the frame of the surface, R."""
        motion = self._job.motion
        if motion is None:
            return position
        at, turned = motion.pose(np.array([now * self._job.time_unit]))
        return rotate(turned * [-1, -1, -1, 1], position - at / self._job.radius)

    def _left(self, place: Array) -> npt.NDArray[np.bool_]:
        """Return which parts at places (n, 3) in the frame of the surface have left it."""
        motion = self._job.motion
        if motion is None:
            return np.zeros(len(place), dtype=np.bool_)
        return motion.left(place * self._job.radius)

    def _failed(
        self, states: BodyStates, height: Array, gains: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Update the energies; returns which of the moving drops failed numerically.

        ``height`` (n,) is that above the surface. For parts that can gain energy from what moves,
        ``gains`` (n,), no growth is counted up to this check.
        """
        numbers = (states.position, states.orientation, states.velocity, states.spin)
        sound = np.isfinite(np.hstack(numbers)).all(axis=1)
        # The penetration of a thin part can bring its centre of mass below the surface. Below
        # this depth, the part has fallen through the surface.
        sound &= height >= -MAX_DEPTH
        seen = self.moving[sound]
        energy = self._energies(states.select(sound))
        before = np.where(gains[sound], energy, self._energy[seen])
        lowest = np.where(gains[sound], energy, np.minimum(self._min_energy[seen], energy))
        self._energy[seen], self._min_energy[seen] = energy, lowest
        self.growth[seen] = np.maximum(self.growth[seen], energy - before)
        sound[sound] = energy - lowest <= MAX_GROWTH * (lowest + 1)
        return np.asarray(~sound)

    def _update_still(
        self, which: npt.NDArray[np.int64], states: BodyStates, *, restart: bool
    ) -> npt.NDArray[np.bool_]:
        """Update positions and orientations; returns which drops were still for REST_WINDOW."""
        moved = np.abs(states.position - self.position[which])
        # A part that a wall pushes along is at rest, too.
        pushed = states.position[:, 0] - self.position[which, 0]
        pushed -= self._job.wall_speed * CHECK_INTERVAL
        moved[:, 0] = np.minimum(moved[:, 0], np.abs(pushed))
        motion = np.maximum(
            moved.max(axis=1), turned_by(states.orientation, self.orientation[which])
        )
        self.position[which] = states.position
        self.orientation[which] = states.orientation
        still = (motion < REST_MOTION) & (not restart)
        self._still[which] = np.where(still, self._still[which] + 1, 0)
        return np.asarray(self._still[which] * CHECK_INTERVAL >= REST_WINDOW)

    def _decide(self, which: npt.NDArray[np.int64]) -> None:
        """Set the minima of the drops that are decided by their energy."""
        rest = self._job.rest
        low = which[self._energy[which] < rest.highest]
        if len(low):
            down = down_in_part(part_from_body(self.orientation[low], self._job.axes))
            self.minimum[low] = rest.decided(down, self._energy[low])

    def _decide_sliding(self, which: npt.NDArray[np.int64], states: BodyStates) -> None:
        """Set the minima of undecided drops that slide on a flat side and cannot tip any more."""
        job, v, spin = self._job, states.velocity, states.spin
        height = depth_of(states.orientation, job.hull)
        slides = (
            (self.minimum[which] < 0)
            & (np.abs(v[:, 2]) < MAX_SLIDE_RATE)
            & (np.abs(spin[:, :2]).max(axis=1) < MAX_SLIDE_RATE)
            & (states.position[:, 2] - height < MAX_SLIDE_GAP)
        )
        which, height, spin = which[slides], height[slides], spin[slides]
        if len(which):
            down = down_in_part(part_from_body(self.orientation[which], job.axes))
            # The moment of friction, and that of the inertia of a part that turns about an axis
            # which is not a principal one; its products of inertia are at most half the
            # difference of the principal moments.
            products = np.ptp(job.moments) / 2
            tipping = job.conditions.friction * height + products * spin[:, 2] ** 2
            calm = height + MAX_SLIDE_GAP + 1.5 * MAX_SLIDE_RATE**2
            self.minimum[which] = job.rest.sliding(down, tipping, calm)

    def _energies(self, states: BodyStates) -> Array:
        """Return the sum, (n,), of kinetic energy and height above the surface, m g R."""
        job = self._job
        v, height = states.velocity, states.position[:, 2]
        spin = rotate(states.orientation * [-1, -1, -1, 1], states.spin)
        moments = job.moments
        kinetic = v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2
        for axis in range(3):
            kinetic += moments[axis] * spin[:, axis] ** 2
        # A penetrating hull will be pushed back to the surface, so its height is at least that.
        return np.asarray(kinetic / 2 + np.maximum(height, depth_of(states.orientation, job.hull)))


def turned_by(orientation: Array, other: Array) -> Array:
    """Return the maximum change (n,) of a component between unit quaternions (n, 4).

    A quaternion and its negative are the same orientation. Bullet returns one or the other where
    two components have almost the same magnitude.
    """
    near = np.abs(orientation - other).max(axis=1)
    return np.asarray(np.minimum(near, np.abs(orientation + other).max(axis=1)))
