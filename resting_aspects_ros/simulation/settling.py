"""Simulation in Bullet until parts rest: on a level plane, and in surroundings."""

import math

import numpy as np

from resting_aspects_ros.arrays import Array, Bytes, Flags, Indices
from resting_aspects_ros.rotations import down_in_part, rotate
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import (
    TIME_LIMIT,
    Ends,
    InitialState,
    part_from_body,
)
from resting_aspects_ros.simulation.scene import depth_of
from resting_aspects_ros.simulation.starts import States
from resting_aspects_ros.statistics.poses import RestStatus

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
# A drop has failed if its energy exceeds the minimum of all earlier checks by more than this
# fraction of the minimum plus m g R. Newton's law of restitution with friction adds energy in some
# impacts (Kane and Levinson 1985): with restitution 0.8 and friction 0.5 by a fraction of up to
# 0.05 between checks, with 0.95 and 1 by 0.2. Numerical failures grow without bounds.
MAX_GROWTH = 0.5
# A part whose centre of mass is further than this, R, from the wall below an edge cannot touch it
# when it rolls to its minimum: it turns about a point that is less than R away, and reaches R.
WALL_DISTANCE = 2.0


class Settling(Ends):
    """The drops of one world, from release until each has ended; of others, the last check.

    moving : (m,) int
        Rows of the drops that have not ended.
    """

    def __init__(self, job: DropJob, states: InitialState) -> None:
        n = len(states.elapsed)
        super().__init__(
            position=states.position.copy(),
            orientation=states.orientation.copy(),
            status=np.full(n, RestStatus.UNSETTLED, dtype=np.uint8),
            minimum=np.full(n, -1),
            time=np.zeros(n),
            growth=np.zeros(n),
        )
        self._job = job
        self.moving = np.arange(n)
        self._elapsed = states.elapsed
        motion = job.motion
        self._limit = TIME_LIMIT + (float(states.flight.max()) if job.edge is None else 0.0)
        if motion is not None:
            self._limit += motion.duration / job.time_unit
        self._window = REST_WINDOW
        self._now = 0.0
        self._shaken = False  # whether the surface moved since the last check
        self._still = np.zeros(n, dtype=np.int64)  # consecutive checks without motion
        self._energy = self._energies(states)
        self._min_energy = self._energy.copy()  # of all checks

    def check(self, now: float, states: States) -> Indices:
        """Update the moving bodies, ``now`` T after the start; returns the drops that ended.

        While the surface moves, a part can only be lost or fail: its energy and its stillness
        count from the first check after the end of the motion.
        """
        moving = self.moving
        self._shaken = self._job.in_motion(self._now)
        self._now = now
        failed = self._failed(states)
        self.status[moving[failed]] = RestStatus.FAILED
        self.time[moving[failed]] = math.nan
        sound, at = moving[~failed], states.select(~failed)
        calm = self._calm(sound, at) & (not self._shaken)
        self.position[sound], self.orientation[sound] = at.position, at.orientation
        self._still[sound] = np.where(calm, self._still[sound] + 1, 0)
        still = self._still[sound] * CHECK_INTERVAL >= self._window
        lost = self._left(at.position)
        still &= ~lost
        other = self._other(sound, at, lost)
        status = np.select([lost, still], [RestStatus.LOST, RestStatus.SETTLED], other)
        self.status[sound] = status
        self.time[sound] = now + self._elapsed[sound]
        self.time[sound[still & (self.minimum[sound] < 0)]] -= self._window
        continues = (status == RestStatus.UNSETTLED) & (now < self._limit)
        self.moving = sound[continues]
        return np.concatenate([moving[failed], sound[~continues]])

    def _other(self, which: Indices, states: States, lost: Flags) -> Bytes:
        """Return codes of RestStatus (n,) of drops that end although they move, or UNSETTLED.

        Here, the drops that are decided by their energy.
        """
        if not (self._job.until_still or self._shaken):
            free = ~lost & self._clear(states)
            self._decide(which[free])
            self._decide_sliding(which[free], states.select(free))
        decided = self.minimum[which] >= 0
        return np.where(decided, RestStatus.SETTLED, RestStatus.UNSETTLED).astype(np.uint8)

    def _clear(self, states: States) -> Flags:
        """Return which parts (n,) cannot touch the wall below an edge when they roll."""
        if self._job.edge is None:
            return np.ones(len(states.position), dtype=np.bool_)
        wall = -self._job.lower_speed * self._now
        return np.asarray(states.position[:, 0] - wall > WALL_DISTANCE)

    def _on_surface(self, position: Array) -> Array:
        """Return positions (n, 3) in the frame of the surface, R."""
        motion = self._job.motion
        if motion is None:
            return position
        at, turned = motion.pose(np.array([self._now * self._job.time_unit]))
        return rotate(turned * [-1, -1, -1, 1], position - at / self._job.radius)

    def _left(self, position: Array) -> Flags:
        """Return which parts at positions (n, 3) have left the surface."""
        motion = self._job.motion
        if motion is None:
            return np.zeros(len(position), dtype=np.bool_)
        place = self._on_surface(position)[:, :2] * self._job.radius
        return np.asarray(np.abs(place).max(axis=1) > motion.plate_size / 2)

    def _failed(self, states: States) -> Flags:
        """Update the energies; returns which of the moving drops failed numerically."""
        sound = states.finite
        # For parts that can gain energy from what moves, no growth is counted up to this check.
        gains = np.full(len(sound), self._shaken)
        gains |= ~self._clear(states) & (self._job.lower_speed != 0)
        height = self._on_surface(states.position)[:, 2]
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

    def _calm(self, which: Indices, states: States) -> Flags:
        """Return which drops did not move since the last check."""
        moved = np.abs(states.position - self.position[which])
        # A part that a wall pushes along is at rest, too.
        pushed = states.position[:, 0] - self.position[which, 0]
        pushed -= -self._job.lower_speed * CHECK_INTERVAL
        moved[:, 0] = np.minimum(moved[:, 0], np.abs(pushed))
        motion = np.maximum(
            moved.max(axis=1), turned_by(states.orientation, self.orientation[which])
        )
        return np.asarray(motion < REST_MOTION)

    def _decide(self, which: Indices) -> None:
        """Set the minima of the drops that are decided by their energy."""
        rest = self._job.rest
        low = which[self._energy[which] < rest.highest]
        if len(low):
            down = down_in_part(part_from_body(self.orientation[low], self._job.axes))
            self.minimum[low] = rest.decided(down, self._energy[low])

    def _decide_sliding(self, which: Indices, states: States) -> None:
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

    def _energies(self, states: States) -> Array:
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


# -- In surroundings ------------------------------------------------------------------------------


# Time, T, for which a part must be still. The last T before the end is the most expensive one,
# because the part touches several bodies. Of 12,000 drops, 10 that were still for it turned by
# more than 0.005 (a quaternion component) later.
WINDOW = 0.5
# A part slides for ever if for this time, T, it turns by at most SLIDE_TURN, and its speed does
# not decrease. Coulomb friction slows a part at a constant rate, or not at all. On a single plane,
# only a tilt counts: a part can spin about the normal of the plane while it slides.
SLIDE_WINDOW = 10.0
SLIDE_TURN = 1e-3
# Minimum speed of a sliding part, R / T; a slower part creeps or trembles.
MIN_SLIDE_SPEED = 1e-3
# A part that has come down by this, R, slides or rolls away, as one that is faster than
# ``DropJob.max_speed``.
MAX_FALL = 50.0
# A part that a belt carries along a wall creeps on the belt by up to this, R, between checks: the
# wall pulls on it, and the solver finds its friction within a tolerance.
MAX_CREEP = 1e-3


class SceneSettling(Settling):
    """The drops of one world in surroundings; see Settling for the attributes."""

    def __init__(self, job: DropJob, states: InitialState) -> None:
        self._scene = job.scene
        scale = job.time_unit / job.radius
        # The states are relative to a frame that moves; the positions at the end are not.
        self._frame = job.frame_velocity
        self._surface_velocities = self._scene.velocities() * scale - self._frame
        self._max_speed = job.max_speed
        super().__init__(job, states)
        self._window = WINDOW
        n = len(states.elapsed)
        self._start = states.position @ self._scene.down
        self._anchor = self._pointing(self.orientation)
        self._anchor_speed = np.full(n, np.inf)
        self._anchor_time = np.zeros(n)

    def check(self, now: float, states: States) -> Indices:
        """See Settling."""
        ended = super().check(now, states)
        self.position[ended] += self._frame * now
        return ended

    def _other(self, which: Indices, states: States, lost: Flags) -> Bytes:
        """Return codes of RestStatus (n,); here, of the drops that slide or roll for ever."""
        del lost
        sliding = self._slides(which, states) & (not self._shaken)
        if self._now >= self._limit:
            sliding |= self._relative_speed(states.velocity) > MIN_SLIDE_SPEED
        return np.where(sliding, RestStatus.SLIDING, RestStatus.UNSETTLED).astype(np.uint8)

    def _failed(self, states: States) -> Flags:
        """Update the energies; returns which of the moving drops failed numerically."""
        sound = states.finite
        radius = self._job.radius
        for plane in self._scene.half_spaces:
            height = states.position @ plane.normal - plane.offset / radius
            sound = np.asarray(sound & (height >= -MAX_DEPTH))
        rows = self.moving[sound]
        found = states.select(sound)
        energy = self._energies(found)
        if self._shaken or self._scene.driven:  # what moves adds energy
            return np.asarray(~sound)
        self.growth[rows] = np.maximum(self.growth[rows], energy - self._energy[rows])
        lowest = np.minimum(self._min_energy[rows], energy)
        self._energy[rows], self._min_energy[rows] = energy, lowest
        kinetic = energy + found.position @ self._scene.down
        sound[sound] = energy - lowest <= MAX_GROWTH * (kinetic + 1)
        return np.asarray(~sound)

    def _energies(self, states: States) -> Array:
        """Return the sum, (n,), of kinetic energy and height in the tray frame, m g R."""
        spin = rotate(states.orientation * [-1, -1, -1, 1], states.spin)
        kinetic = (states.velocity**2).sum(axis=1) + (self._job.moments * spin**2).sum(axis=1)
        return np.asarray(kinetic / 2 - states.position @ self._scene.down)

    def _calm(self, which: Indices, states: States) -> Flags:
        """Return which drops did not move, or moved with some surface, since the last check."""
        moved = states.position - self.position[which]
        carried = self._surface_velocities * CHECK_INTERVAL
        distance = np.abs(moved[:, None, :] - carried).max(axis=2).min(axis=1)
        turned = turned_by(states.orientation, self.orientation[which])
        creep = MAX_CREEP if self._scene.driven else REST_MOTION
        return np.asarray((distance < creep) & (turned < REST_MOTION))

    def _relative_speed(self, velocity: Array) -> Array:
        """Return the speeds (n,) relative to the surface that moves most nearly alike."""
        apart = velocity[:, None, :] - self._surface_velocities
        return np.asarray(np.sqrt((apart**2).sum(axis=2)).min(axis=1))

    def _slides(self, which: Indices, states: States) -> Flags:
        """Return which drops slide or roll for ever."""
        speed = self._relative_speed(states.velocity)
        pointing = self._pointing(states.orientation)
        turned = self._turned(pointing, self._anchor[which]) > SLIDE_TURN
        over = self._now - self._anchor_time[which] >= SLIDE_WINDOW
        steady = over & ~turned & (speed > MIN_SLIDE_SPEED)
        steady &= speed >= self._anchor_speed[which] * (1 - REST_MOTION)
        # Towards a wall, a part does not slide for ever.
        across = np.abs(states.velocity[:, self._scene.free :]).max(axis=1, initial=0.0)
        steady &= (self._scene.free == 2) | (across < MIN_SLIDE_SPEED) & (self._scene.free > 0)
        new = turned | over
        self._anchor[which[new]] = pointing[new]
        self._anchor_speed[which[new]] = speed[new]
        self._anchor_time[which[new]] = self._now
        fallen = states.position @ self._scene.down - self._start[which]
        away = (speed > self._max_speed) | (fallen > MAX_FALL)
        return np.asarray(steady | away & (self._scene.free > 0))

    def _turned(self, pointing: Array, anchor: Array) -> Array:
        """Return by how much what _pointing returns has changed, (n,)."""
        if self._scene.free < 2:
            return turned_by(pointing, anchor)
        return np.asarray(np.abs(pointing - anchor).max(axis=1))

    def _pointing(self, orientation: Array) -> Array:
        """Return what does not change while a part slides: its orientation, or its tilt."""
        if self._scene.free < 2:
            return np.array(orientation)
        normal = np.tile(self._scene.half_spaces[0].normal, (len(orientation), 1))
        turned: Array = rotate(orientation * [-1, -1, -1, 1], normal)
        return turned

    def _left(self, position: Array) -> Flags:
        """Return which parts (n,) have left the surroundings."""
        radius = self._job.radius
        inside = [position @ space.normal < space.offset / radius for space in self._scene.lost]
        return np.asarray(np.any([np.zeros(len(position), dtype=np.bool_), *inside], axis=0))


def settling_of(job: DropJob, states: InitialState) -> Settling:
    """Return the drops of a world, before any check."""
    return (Settling if job.scene.level else SceneSettling)(job, states)
