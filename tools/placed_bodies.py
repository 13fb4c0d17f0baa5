"""Bodies that are placed in surroundings, for comparisons with mechanics."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.bullet_client import pybullet
from resting_aspects_ros.simulation.bullet_scene import SceneWorld
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import REST_MARGIN, BodyStates, InitialState
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.kinds import Kind
from resting_aspects_ros.simulation.surroundings.release import depth_along
from resting_aspects_ros.simulation.surroundings.scene_settling import SceneSettling

# A block that slides meets more friction than Coulomb's by up to this number times the time step,
# T, as a share of its friction. A contact whose normal force becomes 0 while Bullet's solver
# iterates keeps the friction that it had before, which exceeds its limit. Measured: 0.2 to 1.8.
FRICTION_EXCESS = 2.0


class Placed(SceneWorld):
    """Bodies in the surroundings of a job, from given states: scene frame, R and T."""

    def __init__(
        self,
        job: DropJob,
        position: Array,
        orientation: Array,
        velocity: Array | Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        assert job.scene is not None
        shape = (len(position), 3)
        self.frame = job.frame_velocity
        super().__init__(job)
        self.job = job
        start = InitialState(
            np.array(position, dtype=float),
            np.array(orientation, dtype=float),
            np.array(np.broadcast_to(velocity, shape) - self.frame),
            np.zeros(shape),
            elapsed=np.zeros(len(position)),
        )
        self.slots = np.arange(len(position))
        self.origins = self._origins(self.slots)
        self.bodies = self._add(start, self.slots, self.origins)
        self.settling = SceneSettling(job, start, self.slots)

    def step(self, time: float) -> BodyStates:
        """Step for a time, T; returns the states."""
        self._advance(0, round(time * self.job.steps_per_t))
        return self.states

    def put(self, position: Array, orientation: Array) -> None:
        """Put all bodies at rest at positions (n, 3) and orientations (n, 4), scene frame."""
        for body, at, facing in zip(self.bodies, position, orientation, strict=True):
            self._place(body, at.tolist(), facing.tolist(), [0.0] * 3, [0.0] * 3)

    def advance_one(self) -> dict[int, float]:
        """Make one time step; returns the normal force on the first body by other body."""
        self._advance(0, 1)
        forces: dict[int, float] = {}
        points = pybullet.getContactPoints(self.bodies[0], physicsClientId=self._client)
        for point in points:
            forces[point[2]] = forces.get(point[2], 0.0) + point[9]
        return forces

    def tilt(self, angle: float) -> None:
        """Incline the level plane z = 0 by an angle, downhill along x."""
        down = (math.sin(angle), 0.0, -math.cos(angle))
        pybullet.setGravity(*down, physicsClientId=self._client)

    def settle(self) -> npt.NDArray[np.uint8]:
        """Step until all have ended; returns their statuses."""
        self._settled(self.bodies, self.origins, self.settling)
        return self.settling.status

    @property
    def states(self) -> BodyStates:
        """The states of all bodies, scene frame."""
        found = self._states(self.bodies, self.origins, self.slots)
        return dataclasses.replace(found, velocity=found.velocity + self.frame)


def job_in(
    part: Part,
    conditions: DropConditions,
    kind: Kind,
    bodies: Mapping[str, Any] | None = None,
    release: Mapping[str, Any] | None = None,
    **more: Any,
) -> DropJob:
    """Return the job of a part in a kind of surroundings; ``more`` is for make_job."""
    found = Surroundings(kind, bodies=bodies or {}, release=release or {})
    return make_job(part, dataclasses.replace(conditions, surroundings=found.key), 1, **more)


def flat_on(
    job: DropJob,
    yaws: Sequence[float] | Array,
    velocity: Array | Sequence[float] = (0.0, 0.0, 0.0),
    x: float = 0.0,
    y: float = 0.0,
    lift: float = REST_MARGIN,
) -> Placed:
    """Place bodies with their part frames turned by angles about z on the plane z = 0."""
    turned = Rotation.from_euler('z', np.reshape(yaws, (-1, 1)))
    orientation = (turned * Rotation.from_quat(job.axes)).as_quat()
    height = depth_along(orientation, np.array([0.0, 0.0, -1.0]), job.hull) + lift
    position = np.stack([0 * height + x, 0 * height + y, height], axis=1)
    return Placed(job, position, orientation, velocity)


def point_path(angle: float, friction: float, velocity: Array, step: float = 1e-3) -> Array:
    """Return the displacement (2,) of a point mass with Coulomb friction until it stops.

    On a slope that is inclined by an angle, downhill along x, with g = 1.
    """
    at, speed = np.zeros(2), np.array(velocity)
    for _ in range(20_000):
        norm = np.linalg.norm(speed)
        if norm < step:
            break
        slowed = -friction * math.cos(angle) * speed / norm
        speed = speed + step * (slowed + np.array([math.sin(angle), 0]))
        at = at + step * speed
    return at


def groove_height(job: DropJob, rolls: Array, corners: Array) -> Array:
    """Return the heights (n,) at which a turned cross-section (k, 2) touches both planes."""
    assert job.scene is not None
    planes = [body.normal for body in job.scene.half_spaces]
    return np.asarray(sum(_reaches(job, rolls, corners)) / sum(n[2] for n in planes))


def in_groove(job: DropJob, rolls: Array, corners: Array) -> Placed:
    """Place bodies along a groove that are turned by rolls (n,), a little above both planes."""
    assert job.scene is not None
    placed = flat_on(job, 0 * rolls)
    planes = [body.normal[1:] for body in job.scene.half_spaces]
    reach = 0.003 + np.array(_reaches(job, rolls, corners))
    at = np.linalg.solve(np.array(planes), reach).T
    turned = Rotation.from_euler('x', rolls[:, None]) * Rotation.from_quat(job.axes)
    placed.put(np.column_stack([placed.origins[:, 0], at]), turned.as_quat())
    return placed


def _reaches(job: DropJob, rolls: Array, corners: Array) -> list[Array]:
    """Return how far a cross-section that is turned by rolls reaches into each plane, (n,)."""
    assert job.scene is not None
    c, s = np.cos(rolls)[:, None], np.sin(rolls)[:, None]
    y, z = c * corners[:, 0] - s * corners[:, 1], s * corners[:, 0] + c * corners[:, 1]
    return [-(p.normal[1] * y + p.normal[2] * z).min(axis=1) for p in job.scene.half_spaces]
