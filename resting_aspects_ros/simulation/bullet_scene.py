"""Surroundings in Bullet: parts meet half-spaces, blocks and meshes instead of a level plane."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pybullet

from resting_aspects_ros.core.rotations import Array, product, rotate
from resting_aspects_ros.simulation.bullet_client import compound
from resting_aspects_ros.simulation.bullet_world import PART_GROUP, SURFACE_GROUP, World
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import InitialState
from resting_aspects_ros.simulation.surroundings.release import in_scene_axes
from resting_aspects_ros.simulation.surroundings.scene import (
    Block,
    HalfSpace,
    MeshBody,
    SceneBody,
)
from resting_aspects_ros.simulation.surroundings.scene_settling import SceneSettling

# As SOLVER_RESIDUAL: a part in a groove has twice as many contacts. A smaller residual multiplies
# the time by up to 10.
RESIDUAL = 1e-7
# Half of the length, R, of a block that is infinitely long.
LONG = 2000.0


class SceneWorld(World):
    """A world with the bodies of the surroundings.

    Its axes are those of the scene frame, and it moves with ``DropJob.frame_velocity``.
    """

    _residual = RESIDUAL

    def __init__(self, job: DropJob) -> None:
        scene = job.scene
        assert scene is not None
        self._scene = scene
        self._frame = self._frame_velocity(job)
        self._moving: list[tuple[int, tuple[list[float], ...]]] = []
        super().__init__(job)
        if not scene.flat and len(job.pieces) > 1:
            self._shape = compound(job.pieces, self._client)

    def _frame_velocity(self, job: DropJob) -> Array:
        """Return the velocity (3,) with which the world moves, R / T."""
        return job.frame_velocity

    def _add_surface(self) -> None:
        for body in self._scene.bodies:
            self._add_body(body)

    def _pair_values(self) -> dict[str, float]:
        # Bullet multiplies restitution and friction of two bodies; the pair's rolling friction is
        # r_part mu_body + r_body mu_part. The values of the pair are those of the body.
        return {
            'restitution': 1.0,
            'lateralFriction': 1.0,
            'rollingFriction': 0.0,
            'spinningFriction': 0.0,
        }

    def _add_body(self, body: SceneBody) -> None:
        job = self._job
        velocity = body.velocity * (job.time_unit / job.radius) - self._frame
        moves = job.motion is not None or bool(velocity.any())
        for shape, position in self._shapes(body):
            made = self._add_static(shape) if moves else self._add_at_rest(shape)
            self._set_pair(made, body)
            state = (position.tolist(), [0.0, 0.0, 0.0, 1.0], velocity.tolist(), [0.0] * 3)
            self._place(made, *state)
            if job.motion is not None or (moves and not isinstance(body, HalfSpace)):
                self._moving.append((made, state))

    def _set_pair(self, made: int, body: SceneBody) -> None:
        c = body.contact
        self._set(
            made,
            restitution=c.restitution,
            lateralFriction=c.friction,
            rollingFriction=c.rolling_friction * self._job.rolling_length,
            spinningFriction=self._job.conditions.spinning_friction,
        )

    def _shapes(self, body: SceneBody) -> Iterator[tuple[int, Array]]:
        """Yield the shapes of a body, and the place (3,) of each, R."""
        radius = self._job.radius
        if isinstance(body, HalfSpace):
            plane = pybullet.createCollisionShape(
                pybullet.GEOM_PLANE,
                planeNormal=body.normal.tolist(),
                physicsClientId=self._client,
            )
            yield plane, body.normal * body.offset / radius
        elif isinstance(body, Block):
            low, high = body.low / radius, body.high / radius
            if self._scene.free:  # the same everywhere along x, where the parts are side by side
                low[0], high[0] = -LONG, LONG
            box = pybullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=((high - low) / 2).tolist(),
                physicsClientId=self._client,
            )
            yield box, (high + low) / 2
        else:
            assert isinstance(body, MeshBody)
            yield from ((shape, np.zeros(3)) for shape in self._mesh_shapes(body))

    def _mesh_shapes(self, body: MeshBody) -> Iterator[int]:
        radius = self._job.radius
        if body.prisms:
            yield compound(tuple(corners / radius for corners in body.prisms), self._client)
        remaining = body.vertices[body.triangles] if body.remaining is None else body.remaining
        if len(remaining):
            vertices, indices = _lists((remaining / radius).tobytes())
            yield pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                vertices=vertices,
                indices=indices,
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
                physicsClientId=self._client,
            )

    def _add_at_rest(self, shape: int) -> int:
        # With useMaximalCoordinates, a step takes half the time, and friction has the direction
        # of the motion; without it, a box that slides obliquely to the axes of a plane travels up
        # to 14 % too far or too short. But Bullet then ignores a velocity.
        body: int = pybullet.createMultiBody(
            0, shape, useMaximalCoordinates=1, physicsClientId=self._client
        )
        self._collide(body, SURFACE_GROUP, PART_GROUP)
        return body

    def drop(self, states: InitialState) -> SceneSettling:
        """Release parts and step until each is at rest, slides, is lost, failed or timed out."""
        states = replace(states, velocity=states.velocity - self._frame)
        settling = SceneSettling(self._job, states)
        self._settled(self._add(states), settling)
        return settling

    def _advance(self, made: int, steps: int) -> None:
        if not self._moving:
            super()._advance(made, steps)
            return
        if self._job.in_motion(made * self._step):
            self._shake(made, steps)
            return
        for _ in range(steps):
            # A body with a velocity moves with it, and is put back. This needs no care for
            # half-spaces, which move along themselves.
            for body, state in self._moving:
                self._place(body, *state)
            pybullet.stepSimulation(physicsClientId=self._client)

    def _shake(self, made: int, steps: int) -> None:
        """Step the world and move all its bodies together; see DropJob.surface_states."""
        *states, last = self._job.surface_states(made, steps)
        for state in states:
            self._move(*map(np.array, state))
            pybullet.stepSimulation(physicsClientId=self._client)
        self._move(*map(np.array, last))

    def _move(self, position: Array, turn: Array, velocity: Array, spin: Array) -> None:
        """Put all bodies where a motion of the tray, in tray axes, R and T, brings them."""
        scene = self._scene
        at, v, w = scene.in_scene(np.stack([position, velocity, spin]))
        turned = in_scene_axes(scene, product(turn[None], scene.tray_from_scene[None]))[0]
        for body, (place, orientation, belt, _) in self._moving:
            arm, own = rotate(turned, np.array([place, belt]))
            facing = product(turned[None], np.array([orientation]))[0]
            moved = (at + arm, facing, v + np.cross(w, arm) + own, w)
            self._place(body, *(values.tolist() for values in moved))


@lru_cache(maxsize=16)
def _lists(corners: bytes) -> tuple[list[list[float]], list[int]]:
    """Return a mesh for PyBullet; the same objects for every world, see bullet_world._corners."""
    points, rows = np.unique(np.frombuffer(corners).reshape(-1, 3), axis=0, return_inverse=True)
    return points.tolist(), rows.ravel().tolist()
