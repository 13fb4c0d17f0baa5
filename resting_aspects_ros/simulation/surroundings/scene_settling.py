"""Detection of the end of a drop in surroundings: at rest, sliding, lost, failed or timed out."""

import math

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.core.rotations import Array, rotate
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import BodyStates, InitialState
from resting_aspects_ros.simulation.settling import (
    CHECK_INTERVAL,
    MAX_DEPTH,
    MAX_GROWTH,
    REST_MOTION,
    Settling,
    turned_by,
)

# Time, T, for which a part must be still. The last T before the end is the most expensive one,
# because the part touches several bodies. A quarter of the window of the level plane: of 12,000
# drops on a slope, in a groove and in a chute with a moving belt, 10 that were still for 0.5 T had
# turned by more than 0.005 (a quaternion component) after 4 T, three of them by more than 0.05; of
# those that were still for T, one, by 0.0064.
WINDOW = 0.5
# A part slides for ever if for this time, T, it turns by at most SLIDE_TURN, and its speed does
# not decrease. Coulomb friction slows a part at a constant rate, or not at all. On a single plane,
# only a tilt counts: a part can spin about the normal of the plane while it slides.
SLIDE_WINDOW = 10.0
SLIDE_TURN = 1e-3
# Minimum speed of a sliding part, R / T; a slower part creeps or trembles.
MIN_SLIDE_SPEED = 1e-3
# A part that moves faster than this, R / T, and three times as fast as it can hit a surface first,
# slides or rolls away, and so does one that has come down by MAX_FALL, R.
MAX_SLIDE_SPEED, MAX_FALL = 10.0, 50.0
# A part that a belt carries along a wall creeps on the belt by up to this, R, between checks: the
# wall pulls on it, and the solver finds its friction within a tolerance.
MAX_CREEP = 1e-3


class SceneSettling(Settling):
    """The drops of one world in surroundings; see Settling for the attributes."""

    def __init__(self, job: DropJob, states: InitialState) -> None:
        assert job.scene is not None
        self._scene = job.scene
        scale = job.time_unit / job.radius
        # The states are relative to a frame that moves; the positions at the end are not.
        self._frame = job.frame_velocity
        self._surface_velocities = self._scene.velocities() * scale - self._frame
        self._max_speed = max(MAX_SLIDE_SPEED, 3 * job.impact_speed * scale)
        super().__init__(job, states)
        n = len(states.elapsed)
        self._start = states.position @ self._scene.down
        self._anchor = self._pointing(self.orientation)
        self._anchor_speed = np.full(n, np.inf)
        self._anchor_time = np.zeros(n)

    def check(self, now: float, states: BodyStates) -> npt.NDArray[np.int64]:
        """Update the moving bodies, ``now`` T after the start; returns the drops that ended."""
        moving = self.moving
        shaken = self._job.in_motion(self._now)
        self._now = now
        failed = self._failed_in_scene(states, shaken=shaken)
        self.status[moving[failed]] = RestStatus.FAILED
        self.time[moving[failed]] = math.nan
        sound, at = moving[~failed], states.select(~failed)
        still = self._still_on_surface(sound, at, restart=shaken)
        lost = self._lost(at.position)
        sliding = self._slides(sound, at) & ~still & ~lost & (not shaken)
        timed_out = ~(still | lost | sliding) & (now >= self._limit)
        speed = self._relative_speed(at.velocity)
        sliding |= timed_out & (speed > MIN_SLIDE_SPEED)
        self.status[sound[still & ~lost]] = RestStatus.SETTLED
        self.status[sound[sliding]] = RestStatus.SLIDING
        self.status[sound[lost]] = RestStatus.LOST
        self.time[sound] = now + self._elapsed[sound]
        self.time[sound[still & ~lost]] -= WINDOW
        ended = still | lost | sliding | timed_out
        self.position[sound[ended]] += self._frame * now
        self.moving = sound[~ended]
        return np.concatenate([moving[failed], sound[ended]])

    def _failed_in_scene(self, states: BodyStates, *, shaken: bool) -> npt.NDArray[np.bool_]:
        """Update the energies; returns which of the moving drops failed numerically."""
        numbers = (states.position, states.orientation, states.velocity, states.spin)
        sound = np.asarray(np.isfinite(np.hstack(numbers)).all(axis=1))
        radius = self._job.radius
        for plane in self._scene.half_spaces:
            height = states.position @ plane.normal - plane.offset / radius
            sound = np.asarray(sound & (height >= -MAX_DEPTH))
        rows = self.moving[sound]
        found = states.select(sound)
        energy = self._energies(found)
        if shaken or self._scene.driven:  # what moves adds energy
            return np.asarray(~sound)
        self.growth[rows] = np.maximum(self.growth[rows], energy - self._energy[rows])
        lowest = np.minimum(self._min_energy[rows], energy)
        self._energy[rows], self._min_energy[rows] = energy, lowest
        kinetic = energy + found.position @ self._scene.down
        sound[sound] = energy - lowest <= MAX_GROWTH * (kinetic + 1)
        return np.asarray(~sound)

    def _energies(self, states: BodyStates) -> Array:
        """Return the sum, (n,), of kinetic energy and height in the tray frame, m g R."""
        spin = rotate(states.orientation * [-1, -1, -1, 1], states.spin)
        kinetic = (states.velocity**2).sum(axis=1) + (self._job.moments * spin**2).sum(axis=1)
        return np.asarray(kinetic / 2 - states.position @ self._scene.down)

    def _still_on_surface(
        self, which: npt.NDArray[np.int64], states: BodyStates, *, restart: bool
    ) -> npt.NDArray[np.bool_]:
        """Update the poses; returns which drops did not move with some surface, or at all."""
        moved = states.position - self.position[which]
        carried = self._surface_velocities * CHECK_INTERVAL
        distance = np.abs(moved[:, None, :] - carried).max(axis=2).min(axis=1)
        turned = turned_by(states.orientation, self.orientation[which])
        self.position[which] = states.position
        self.orientation[which] = states.orientation
        creep = MAX_CREEP if self._scene.driven else REST_MOTION
        still = (distance < creep) & (turned < REST_MOTION) & (not restart)
        self._still[which] = np.where(still, self._still[which] + 1, 0)
        return np.asarray(self._still[which] * CHECK_INTERVAL >= WINDOW)

    def _relative_speed(self, velocity: Array) -> Array:
        """Return the speeds (n,) relative to the surface that moves most nearly alike."""
        apart = velocity[:, None, :] - self._surface_velocities
        return np.asarray(np.sqrt((apart**2).sum(axis=2)).min(axis=1))

    def _slides(self, which: npt.NDArray[np.int64], states: BodyStates) -> npt.NDArray[np.bool_]:
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

    def _lost(self, position: Array) -> npt.NDArray[np.bool_]:
        """Return which parts (n,) have left the surroundings."""
        radius = self._job.radius
        inside = [position @ space.normal < space.offset / radius for space in self._scene.lost]
        return np.asarray(np.any([np.zeros(len(position), dtype=np.bool_), *inside], axis=0))
