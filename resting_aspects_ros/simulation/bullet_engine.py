"""Drops in Bullet, also those over the edge of a belt, which need two worlds."""

import math

import numpy as np

from resting_aspects_ros.arrays import Bytes, Flags, Indices
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation.bullet_world import (
    NO_TURN,
    PART_GROUP,
    SURFACE_GROUP,
    World,
    compound,
)
from resting_aspects_ros.simulation.conditions import MAX_SEED
from resting_aspects_ros.simulation.job import EDGE_CHECKS_PER_T, STEPS_PER_T, DropJob
from resting_aspects_ros.simulation.release import (
    REST_MARGIN,
    InitialState,
    initial_states,
    resting_poses,
)
from resting_aspects_ros.simulation.scene import X, depth_of
from resting_aspects_ros.simulation.settling import (
    CHECK_INTERVAL,
    MAX_DEPTH,
    Settling,
    settling_of,
)
from resting_aspects_ros.simulation.starts import RestStarts, States
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# Number of drops that are simulated together, in the same place. All of them are, even if only
# some are wanted: Bullet sorts the contacts of a part with several bodies in an order that depends
# on the other parts. A drop takes 4 times as long alone, and 1.6 times as long with 125.
GROUP = 25


def drop_range(job: DropJob, first: int, end: int) -> RestingPoses:
    """Simulate the drops ``first`` to ``end - 1`` until they end; see workers.drop_range."""
    poses = []
    for low in range(first // GROUP * GROUP, end, GROUP):
        states = initial_states(job, low, min(low + GROUP, MAX_SEED + 1))
        if job.edge is None:
            ends = World(job).drop(states)
        else:
            # The states are relative to the wall below the edge, and the ends to the lower belt.
            passed, status = over_edge(job, states)
            # Only the newest world is valid.
            ends = WallWorld(job).settled(passed, status)
        poses.append(resting_poses(job, low, ends))
    return RestingPoses.join(poses).between(first, end)


# -- Over an edge ---------------------------------------------------------------------------------


# A part is beyond the edge if its hull is further than this, R, from the plane of the wall. A hull
# this close to a surface is about to touch it: Bullet's margin is 0.001, and gravity moves a part
# by 0.008 between two checks, in addition to its speed.
CLEARANCE = 0.02
# A part stays at the edge if it is not beyond it after TIME_LIMIT, T, and the times of a fall and
# of a motion of the belt by CARRIED, R. Parts need up to 5 T; a belt carries them by at most 4 R.
TIME_LIMIT = 20.0
CARRIED = 4.0
# As CARRIED, in surroundings, where a part starts as a whole behind the edge.
CARRIED_IN_SCENE = CARRIED + 2.0
# Minimum radius of the roller, R: that of a sharp edge.
MIN_RADIUS = 0.02
# Capsules of the roller (PyBullet ignores all shapes of a compound after the 16th) and their
# length, R. Beyond them is one long capsule on each side, for parts that drift.
CAPSULES = 4
CAPSULE_LENGTH = 1.0
SHORT = (np.arange(CAPSULES) - (CAPSULES - 1) / 2) * CAPSULE_LENGTH  # their places along y
# Number of time steps per T for parts that land before they are beyond the edge. Each step takes
# several times as long as one without the edge. With 1280, shares of L brackets and of t_prisms
# change by 0.004 at most (n = 500 and 1000, standard error 0.005); with 160, by 0.024 (0.006).
LANDING_STEPS_PER_T = 640
# Distance of the wall below the axis of the roller, R. A part that lies on the belt is not near
# it, which saves time.
DROP = 0.05

# As SOLVER_RESIDUAL, while parts are at the edge, where they have many contacts. With 1e-7, a part
# that lies on both belts leaves them with 0.02 / T less spin; the time is the same.
RESIDUAL = 1e-9
_ALONG_Y = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]


# Time, T, for which a part that is about to land has the steps of first impacts, and number of
# time steps per T later. With 2 T, the shares of 5000 boxes change by 0.0006 at most (standard
# error 0.002); with 320 in place of 160 later steps, by 0.0046 (0.002).
FINE_TIME = 1.0
LATER_STEPS_PER_T = 320
# Extent of the bodies, R: more than parts can drift.
FAR = 20.0


def over_edge(job: DropJob, states: InitialState) -> tuple[InitialState, Bytes]:
    """Move parts over the edge; returns their states, and codes of RestStatus.

    The states are then relative to the lower belt and to the wall. The status is SETTLED for a
    part that is beyond the edge, FAILED for one that failed, and UNSETTLED for others.
    """
    across = states.position[:, 1].min(), states.position[:, 1].max()
    at = InitialState(*(each.copy() for each in (*states.arrays, states.elapsed)))
    status = np.full(len(at.elapsed), RestStatus.UNSETTLED, dtype=np.uint8)
    everyone = np.arange(len(status))
    at.position[:, 2] += REST_MARGIN
    # With half of these steps, an upright box leaves the edge with 2 % too much spin, and its
    # shares change by 0.03; with four times as many, its spin changes by 0.2 %.
    low = EdgeWorld(job, across, STEPS_PER_T).pass_over(at, status, everyone, landed=False)
    if len(low):
        EdgeWorld(job, across, LANDING_STEPS_PER_T).pass_over(at, status, low, landed=True)
    at.velocity[:, 0] -= job.lower_speed
    return at, status


class BeltWorld(World):
    """A world in which bodies can be added that belong to the upper belt."""

    def _add_of_belt(self, shape: int, state: tuple[list[float], ...]) -> int:
        """Add a body with the contact of the floor."""
        body = self._add_fixed(shape, self._scene.bodies[0].contact, movable=True)
        self._place(body, *state)
        return body

    def _add_box(self, back: float, front: float, top: float, speed: float) -> int:
        """Add a box from ``back`` to ``front`` in x, with its top at the height ``top``."""
        half = [(front - back) / 2, FAR, FAR / 2]
        shape = self._bullet.createCollisionShape(self._bullet.GEOM_BOX, halfExtents=half)
        return self._add_of_belt(shape, _box_state(back, front, top, speed))


def _box_state(back: float, front: float, top: float, speed: float) -> tuple[list[float], ...]:
    """Return position, orientation, velocity and spin of a box; see BeltWorld."""
    middle = [(front + back) / 2, 0.0, top - FAR / 2]
    return middle, NO_TURN, [speed, 0.0, 0.0], [0.0] * 3


class EdgeWorld(BeltWorld):
    """A world with both floors, the edge and the walls; it does not move.

    across : (float, float)
        Between which places across the edge the parts are, R.
    min_steps_per_t : int
        Minimum number of time steps per T.
    """

    def __init__(self, job: DropJob, across: tuple[float, float], min_steps_per_t: int) -> None:
        super().__init__(job, np.zeros(3))
        self._set_steps(job.steps(min_steps_per_t))
        self._bullet.setPhysicsEngineParameter(solverResidualThreshold=RESIDUAL)
        edge, starts = job.edge, job.starts
        assert edge is not None
        assert isinstance(starts, RestStarts)
        self._upper = edge.belt_speed * job.time_unit / job.radius
        self._radius = max(edge.edge_radius / job.radius, MIN_RADIUS)
        self._height = edge.step_height / job.radius
        # In the body frame, R.
        inverse = job.axes * [-1, -1, -1, 1]
        pieces = [rotate(inverse, corners) / job.radius for corners in starts.pieces]
        self._shape = compound(tuple(pieces), self._bullet)
        box = -FAR, -self._radius, self._height, self._upper
        self._belt, self._belt_state = self._add_box(*box), _box_state(*box)
        self._add_box(-FAR, 0.0, self._height - self._radius - DROP, 0.0)
        self._rollers = self._add_rollers(*across)

    def _add_rollers(self, low: float, high: float) -> list[int]:
        """Add rollers of short capsules where the parts are, and one of long capsules beside."""
        length = CAPSULES * CAPSULE_LENGTH
        if self._scene.level:  # where all parts are at y = 0, one body takes less time
            end = length / 2
            places = [*SHORT.tolist(), -(end + FAR) / 2, (end + FAR) / 2]
            return [self._add_roller(places, [CAPSULE_LENGTH] * CAPSULES + [FAR - end] * 2)]
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

    def _add_roller(self, places: list[float], lengths: list[float]) -> int:
        """Add a roller of capsules in places along y, and return it."""
        shape = self._bullet.createCollisionShapeArray(
            shapeTypes=[self._bullet.GEOM_CAPSULE] * len(places),
            radii=[self._radius] * len(places),
            lengths=lengths,
            collisionFramePositions=[[0.0, y, 0.0] for y in places],
            collisionFrameOrientations=[_ALONG_Y] * len(places),
        )
        axis = [-self._radius, 0.0, self._height - self._radius]
        turn = [0.0, self._upper / self._radius, 0.0]
        return self._add_of_belt(shape, (axis, NO_TURN, [0.0] * 3, turn))

    def pass_over(
        self, at: InitialState, status: Bytes, which: Indices, *, landed: bool
    ) -> Indices:
        """Move some parts over the edge until they are about to land; see over_edge.

        Returns the parts that are about to land before they are beyond the edge. Parts that
        ``landed`` in this way move on until they are beyond it, and none is returned.
        """
        bodies = dict(zip(which.tolist(), self._add(at.select(which)), strict=True))
        moving, early, now = which, [which[:0]], 0.0
        fall = math.sqrt(2 * self._height / -self._job.scene.down[2])
        carried = CARRIED if self._scene.level else CARRIED_IN_SCENE
        limit = TIME_LIMIT + carried / self._upper + fall
        while len(moving):
            if landed and now == FINE_TIME:
                self._set_steps(self._job.steps(LATER_STEPS_PER_T))
            self._advance_renewed(self._steps_per_t // EDGE_CHECKS_PER_T)
            now += 1 / EDGE_CHECKS_PER_T
            at.elapsed[moving] += 1 / EDGE_CHECKS_PER_T
            found = self._states(bodies, moving)
            sound = found.finite & (found.position[:, 2] > -MAX_DEPTH)
            beyond, landing = self._beyond(found), self._landing(found)
            timed_out = at.elapsed[moving] >= limit
            passed = sound & beyond & (landing | landed | timed_out)
            low = sound & ~beyond & landing & (not landed)
            status[moving[~sound]] = RestStatus.FAILED
            status[moving[passed]] = RestStatus.SETTLED
            rows, found = moving[sound], found.select(sound)
            for whole, part in zip(at.arrays, found.arrays, strict=True):
                whole[rows] = part
            self._change_steps(at, moving[passed], self._job.steps_per_t)
            self._change_steps(at, moving[low], self._job.steps(LANDING_STEPS_PER_T))
            early.append(moving[low])
            ended = ~sound | passed | low | timed_out
            for i in moving[ended].tolist():
                self._bullet.removeBody(bodies[i])
            moving = moving[~ended]
        return np.concatenate(early)

    def _change_steps(self, at: InitialState, which: Indices, steps: int) -> None:
        """Adapt the velocities of parts to the number of steps per T with which they continue.

        Bullet changes the velocity before the position, so that the velocity of a part in flight
        is that half a time step before its position. Otherwise a box would fall longer by 0.002 T,
        which changes its shares by 0.02. For a part that still touches the edge, the change is too
        small for a bounce.
        """
        shorter = 1 / self._steps_per_t - 1 / steps
        at.velocity[which] += self._job.scene.down * (shorter / 2)

    def _advance_renewed(self, steps: int) -> None:
        for _ in range(steps):
            self._place(self._belt, *self._belt_state)
            for body in (self._belt, *self._rollers):
                # Setting the mask discards the contacts of a body, although it is the same mask.
                self._collide(body, SURFACE_GROUP, PART_GROUP)
            self._bullet.stepSimulation()

    def _beyond(self, at: States) -> Flags:
        """Return which parts (n,) have their whole hull beyond the wall."""
        reach = depth_of(at.orientation, self._job.hull, -X)
        return np.asarray(at.position[:, 0] - reach > CLEARANCE)

    def _landing(self, at: States) -> Flags:
        """Return which parts (n,) can touch the lower belt before the next check."""
        speed = np.linalg.norm(at.velocity, axis=1) + np.linalg.norm(at.spin, axis=1)
        reach = CLEARANCE + speed / EDGE_CHECKS_PER_T
        ahead = at.position[:, 0] + depth_of(at.orientation, self._job.hull, X) > -reach
        lowest = at.position[:, 2] - depth_of(at.orientation, self._job.hull)
        return np.asarray(ahead & (lowest < reach))


class WallWorld(BeltWorld):
    """A world with the lower floor, at rest, the walls, and the wall below the edge.

    The wall below the edge moves if the lower floor moves.
    """

    def __init__(self, job: DropJob) -> None:
        super().__init__(job)
        edge = job.edge
        assert edge is not None
        self._speed = -job.lower_speed
        self._top = edge.step_height / job.radius
        self._wall = self._add_box(-FAR, 0.0, self._top, self._speed)

    def settled(self, states: InitialState, status: Bytes) -> Settling:
        """Step until all parts that passed the edge have ended; ``status``: see over_edge."""
        settling = settling_of(self._job, states)
        passed = status == RestStatus.SETTLED
        settling.moving = np.flatnonzero(passed)
        settling.status = np.where(passed, settling.status, status)
        settling.time = states.elapsed.copy()
        settling.time[status == RestStatus.FAILED] = math.nan
        bodies = self._add(states)
        for i in np.flatnonzero(~passed):
            self._bullet.removeBody(bodies[i])
        self._settle(bodies, settling)
        return settling

    def _until_check(self, now: float) -> float:
        later = self._job.steps(LATER_STEPS_PER_T)
        if now > FINE_TIME - CHECK_INTERVAL / 2 and self._steps_per_t != later:
            self._set_steps(later)
        return super()._until_check(now)

    def _advance(self, made: int, steps: int) -> None:
        if self._speed == 0:
            super()._advance(made, steps)
            return
        for step in range(made, made + steps):
            front = self._speed * step * self._step
            self._place(self._wall, *_box_state(front - FAR, front, self._top, self._speed))
            self._bullet.stepSimulation()
