"""The lower belt and the wall below an edge in Bullet: parts that passed the edge come to rest."""

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.simulation.bullet_client import pybullet
from resting_aspects_ros.simulation.bullet_world import World
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import InitialState
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL, Settling

# Time, T, for which a part that is about to land has the steps of first impacts, and number of
# time steps per T later. With 2 T, the shares of 5000 boxes change by 0.0006 at most (standard
# error 0.002). With 320 later steps in place of 160, as in a drop, those of 5000 boxes and 5000
# t_prisms change by 0.0046 and 0.0044 (0.002 and 0.001).
FINE_TIME = 1.0
LATER_STEPS_PER_T = 320
# Extent of the bodies, R: more than parts can drift.
FAR = 20.0
NO_TURN = [0.0, 0.0, 0.0, 1.0]

SettlingT = TypeVar('SettlingT', bound=Settling)


class WorldWithEdge(World):
    """A world in which boxes can be added that belong to the upper belt."""

    def __init__(self, job: DropJob) -> None:
        super().__init__(job)
        self._boxes: dict[int, tuple[list[float], ...]] = {}  # states when they were added

    def _add_of_edge(self, shape: int) -> int:
        edge = self._job.edge
        assert edge is not None
        body = self._add_static(shape)
        self._set(body, lateralFriction=edge.friction_factor, restitution=edge.restitution_factor)
        return body

    def _add_box(self, back: float, front: float, top: float, velocity: list[float]) -> int:
        """Add a static box from ``back`` to ``front`` in x, with its top at the height ``top``."""
        half = [(front - back) / 2, FAR, FAR / 2]
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self._client
        )
        body = self._add_of_edge(shape)
        middle = [(front + back) / 2, 0.0, top - FAR / 2]
        self._boxes[body] = (middle, NO_TURN, velocity, [0.0] * 3)
        self._place(body, *self._boxes[body])
        return body


class WallWorld(WorldWithEdge):
    """A world with the lower belt, at rest, and the wall, which moves if that belt moves."""

    def __init__(self, job: DropJob) -> None:
        super().__init__(job)
        edge = job.edge
        assert edge is not None
        self._speed = job.wall_speed
        self._top = edge.height / job.radius
        velocity = [self._speed, 0.0, 0.0]
        self._wall = self._add_box(-FAR, 0.0, self._top, velocity)

    def settled(self, states: InitialState, status: npt.NDArray[np.uint8]) -> Settling:
        """Step until parts that passed the edge are at rest; ``status``: see over_edge."""
        return self._from_edge(Settling(self._job, states), states, status)

    def _from_edge(
        self,
        settling: SettlingT,
        states: InitialState,
        status: npt.NDArray[np.uint8],
    ) -> SettlingT:
        passed = status == RestStatus.SETTLED
        settling.moving = np.flatnonzero(passed)
        settling.status = np.where(passed, settling.status, status)
        settling.time = states.elapsed.copy()
        settling.time[status == RestStatus.FAILED] = math.nan
        bodies = self._add(states)
        for i in np.flatnonzero(~passed):
            pybullet.removeBody(bodies[i], physicsClientId=self._client)
        self._settled(bodies, settling)
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
            middle = [front - FAR / 2, 0.0, self._top - FAR / 2]
            self._place(self._wall, middle, NO_TURN, [self._speed, 0.0, 0.0], [0.0] * 3)
            pybullet.stepSimulation(physicsClientId=self._client)
