"""The physics world of Bullet: a part and what it touches."""

import math
import os
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import pybullet

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.rotations import product, rotate
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import BodyStates, InitialState
from resting_aspects_ros.simulation.scene import (
    Block,
    HalfSpace,
    MeshBody,
    SceneBody,
    in_scene_axes,
)
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL, SceneSettling, Settling
from resting_aspects_ros.statistics.poses import RestStatus

# -- Client ---------------------------------------------------------------------------------------


@contextmanager
def _silenced_stderr() -> Iterator[None]:
    """Discard standard error, including the output of C code, which bypasses sys.stderr."""
    sys.stderr.flush()
    saved = os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(null)


with _silenced_stderr():  # pybullet prints its build time on import, in every process
    import pybullet

__all__ = ['compound', 'empty_client', 'pybullet']


def empty_client() -> int:
    """Return the thread's Bullet client with an empty world; connecting again would take 5 ms."""
    if not hasattr(_thread_data, 'client'):
        _thread_data.client = _Client()
    number = _thread_data.client.number
    pybullet.resetSimulation(physicsClientId=number)
    return number


def compound(pieces: tuple[Array, ...], client: int) -> int:
    """Return a shape of convex pieces, each given by its corners (n, 3).

    PyBullet reads a compound of more than one set of corners only from a file.
    """
    with tempfile.NamedTemporaryFile('w', suffix='.obj') as file:
        file.write(_obj_text(pieces))
        file.flush()
        shape: int = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, fileName=file.name, physicsClientId=client
        )
    if shape < 0:
        raise EngineError('Bullet cannot read convex pieces')
    return shape


def _obj_text(pieces: tuple[Array, ...]) -> str:
    """Return the content of an OBJ file with each piece as an object.

    The triangles only name all corners: Bullet makes the convex hull of each object.
    """
    lines, first = [], 1
    for k, corners in enumerate(pieces):
        n = len(corners)
        lines.append(f'o {k}')
        lines += [f'v {x!r} {y!r} {z!r}' for x, y, z in corners.tolist()]
        lines += [f'f {first + i} {first + (i + 1) % n} {first + (i + 2) % n}' for i in range(n)]
        first += n
    return '\n'.join(lines) + '\n'


class _Client:
    """A connection to Bullet that closes when its thread ends."""

    def __init__(self) -> None:
        self.number: int = pybullet.connect(pybullet.DIRECT)
        if self.number < 0:
            raise EngineError('Bullet cannot create another world in this process')
        weakref.finalize(self, pybullet.disconnect, self.number)


class _PerThread(threading.local):
    client: _Client


_thread_data = _PerThread()


# -- A level plane --------------------------------------------------------------------------------


# Simultaneous impacts at several points, such as those of a cylinder's side, need many solver
# iterations: with a fixed 20, a cylinder came to rest on its ends in 0.37 of the drops, with 320
# or more in 0.40 (n = 8000). Each body therefore iterates until no speed changes by more than the
# square root of the residual, R / T, or until the maximum. A few drops in 100 have an impact that
# reaches the maximum; doubling the maximum does not change any aspect's probability.
SOLVER_RESIDUAL = 1e-10
MAX_SOLVER_ITERATIONS = 1000
# As SOLVER_RESIDUAL, on a surface that moves, which a part touches most of the time. With the
# smaller residual, the action `bowl` takes 2.8 times as long. No class of an L bracket or a box
# becomes more or less frequent (`bowl` and `flip`, 29,600 pairs of actions from the same states:
# chi-square 43 with 47 degrees of freedom).
MOTION_RESIDUAL = 1e-8
# Penetration from an impact is corrected over this time, T. Bullet's default corrects it within a
# few steps, which adds speed: with finer steps, bounces then exceed e^2 h instead of converging to
# it.
PENETRATION_TIME = 0.25
# A contact persists until its points are this far apart, R. This is Bullet's default. For parts
# so thin that a contact on one side would persist on the other, the distance is limited to this
# fraction of the minimum height of the centre of mass.
CONTACT_BREAKING = 0.02
THIN_PART_FRACTION = 0.2
# Impacts slower than this, R / T, do not bounce, which avoids an endless series of small bounces.
RESTITUTION_THRESHOLD = 0.05

# A time step, T, in which nothing moves. Bullet makes no step below about 1e-16.
SHORT = 1e-12
SURFACE_GROUP, PART_GROUP = 1, 2


class World:
    """A Bullet world with a surface; only this class creates, steps and removes bodies.

    All worlds of a thread share one Bullet client, so only the newest world of a thread is valid.
    """

    _residual = SOLVER_RESIDUAL

    def __init__(self, job: DropJob) -> None:
        client = empty_client()
        residual = self._residual
        if job.motion is not None:
            residual = max(residual, MOTION_RESIDUAL)
        self._job = job
        self._client = client
        pybullet.setGravity(*job.down.tolist(), physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            numSubSteps=0,
            numSolverIterations=MAX_SOLVER_ITERATIONS,
            solverResidualThreshold=residual,
            # Bullet solves small islands together until they exceed this size. With 0, each body
            # is an island of its own and stops iterating independently.
            minimumSolverIslandSize=0,
            restitutionVelocityThreshold=RESTITUTION_THRESHOLD,
            contactBreakingThreshold=min(CONTACT_BREAKING, THIN_PART_FRACTION * job.min_height),
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        self._set_steps(job.steps_per_t)
        self._add_surface()
        self._shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=_corners(job.hull.tobytes()), physicsClientId=client
        )

    def _add_surface(self) -> None:
        """Add the bodies that the parts can touch."""
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self._client)
        self._ground = self._add_static(plane)

    def _pair_values(self) -> dict[str, float]:
        """Return restitution and friction of the part; those of the surface are 1."""
        c = self._job.conditions
        return {
            'restitution': c.restitution,
            'lateralFriction': c.friction,
            'rollingFriction': c.rolling_friction * self._job.rolling_length,
            'spinningFriction': c.spinning_friction,
        }

    def _set_steps(self, steps_per_t: int) -> None:
        """Set the number of time steps per T."""
        self._steps_per_t, self._step = steps_per_t, 1 / steps_per_t
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            erp=self._step / PENETRATION_TIME,
            contactERP=self._step / PENETRATION_TIME,
            physicsClientId=self._client,
        )

    def _add_static(self, shape: int) -> int:
        # With useMaximalCoordinates, Bullet would ignore the velocity that _place gives it.
        body: int = pybullet.createMultiBody(0, shape, physicsClientId=self._client)
        # Bullet multiplies the values of the two bodies; the part has the values of the pair.
        self._set(body, restitution=1, lateralFriction=1, rollingFriction=0, spinningFriction=0)
        self._collide(body, SURFACE_GROUP, PART_GROUP)
        return body

    def _place(self, body: int, *state: list[float]) -> None:
        """Set position, orientation, velocity and spin of a body."""
        client = self._client
        pybullet.resetBasePositionAndOrientation(body, *state[:2], physicsClientId=client)
        pybullet.resetBaseVelocity(body, *state[2:], physicsClientId=client)

    def _set(self, body: int, **values: float | list[float]) -> None:
        pybullet.changeDynamics(body, -1, physicsClientId=self._client, **values)

    def _collide(self, body: int, group: int, mask: int) -> None:
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self._client)

    def _add(self, states: InitialState) -> list[int]:
        """Add the parts, which a collision mask keeps from touching each other."""
        pair = self._pair_values()
        # Creating all bodies at once and placing them afterwards is faster: creating them one by
        # one takes a tenth of the time of a drop.
        bodies: tuple[int, ...] = pybullet.createMultiBody(
            1,
            self._shape,
            batchPositions=states.position.tolist(),
            useMaximalCoordinates=1,
            physicsClientId=self._client,
        )
        for body in bodies:
            self._set(
                body,
                # Mass and inertia must be set together: without the mass it becomes 0, without
                # the inertia Bullet uses the inertia of the bounding box.
                mass=1,
                localInertiaDiagonal=self._job.moments.tolist(),
                **pair,
                linearDamping=0,
                angularDamping=0,
                # Contacts act only on touch. By default, Bullet slows an approaching part before
                # the contact, and with fine steps no speed is left to bounce (bullet3 issue 4341).
                contactProcessingThreshold=0,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            )
        rows = (states.position, states.orientation, states.velocity, states.spin)
        starts = list(zip(*(each.tolist() for each in rows), strict=True))
        self._apply_inertia(bodies, starts)
        for body, start in zip(bodies, starts, strict=True):
            self._collide(body, PART_GROUP, SURFACE_GROUP)
            self._place(body, *start)
        return list(bodies)

    def _apply_inertia(self, bodies: Iterable[int], starts: list[tuple[list[float], ...]]) -> None:
        """Make a very short step without contacts, after which new bodies have their inertia.

        Bullet computes the inertia in world axes only at the end of a step. In the first step, a
        body would have that of its bounding box in the orientation in which it was created.
        """
        for body, (position, orientation, *_) in zip(bodies, starts, strict=True):
            self._collide(body, 0, 0)
            self._place(body, position, orientation, [0.0] * 3, [0.0] * 3)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=SHORT, physicsClientId=self._client)
        pybullet.stepSimulation(physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=self._step, physicsClientId=self._client)

    def drop(self, states: InitialState) -> Settling:
        """Release parts and step until each is at rest, failed or timed out."""
        return self._settled(self._add(states), Settling(self._job, states))

    def _settled(self, bodies: list[int], settling: Settling) -> Settling:
        now = 0.0
        while len(settling.moving):
            now = self._until_check(now)
            moving = self._states(bodies, settling.moving)
            for i in settling.check(now, moving):
                pybullet.removeBody(bodies[i], physicsClientId=self._client)
        return settling

    def _until_check(self, now: float) -> float:
        """Step the world from the time ``now``, T, to the next check; returns the time of it."""
        made, steps = (round(t * self._steps_per_t) for t in (now, CHECK_INTERVAL))
        self._advance(made, steps)
        return (made + steps) * self._step

    def _advance(self, made: int, steps: int) -> None:
        """Step the world, in which ``made`` steps were made, and move the surface with it."""
        if not self._job.in_motion(made * self._step):
            for _ in range(steps):
                pybullet.stepSimulation(physicsClientId=self._client)
            return
        *states, last = self._job.surface_states(made, steps)
        for state in states:
            self._place(self._ground, *state)
            pybullet.stepSimulation(physicsClientId=self._client)
        self._place(self._ground, *last)

    def _states(
        self, bodies: list[int] | dict[int, int], which: npt.NDArray[np.int64]
    ) -> BodyStates:
        ids, client = [bodies[i] for i in which.tolist()], self._client
        poses = [pybullet.getBasePositionAndOrientation(i, physicsClientId=client) for i in ids]
        speeds = [pybullet.getBaseVelocity(i, physicsClientId=client) for i in ids]
        position, orientation = map(np.array, zip(*poses, strict=True))
        velocity, spin = map(np.array, zip(*speeds, strict=True))
        return BodyStates(position, orientation, velocity, spin)


@lru_cache(maxsize=16)
def _corners(hull: bytes) -> list[list[float]]:
    """Return the hull vertices, (k, 3) float64, for Bullet; the same objects for every world.

    PyBullet never releases its reference to each number. Without the cache, a hull of 3000
    vertices would leak 0.3 MB per world.
    """
    corners: list[list[float]] = np.frombuffer(hull).reshape(-1, 3).tolist()
    return corners


# -- A wall ---------------------------------------------------------------------------------------


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


# -- A scene --------------------------------------------------------------------------------------


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
