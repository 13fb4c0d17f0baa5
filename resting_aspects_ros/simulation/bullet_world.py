"""The physics world of Bullet: a part and what it touches."""

import os
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.rotations import product, rotate
from resting_aspects_ros.simulation.conditions import NO_BULLET
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import InitialState
from resting_aspects_ros.simulation.scene import (
    Block,
    HalfSpace,
    MeshBody,
    PairValues,
    SceneBody,
    in_scene_axes,
)
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL, Settling, settling_of
from resting_aspects_ros.simulation.starts import States

# -- Client ---------------------------------------------------------------------------------------


# PyBullet prints its build time on standard error when a process imports it.
_stderr, _null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
os.dup2(_null, 2)
try:
    import pybullet
    from pybullet_utils.bullet_client import BulletClient
except ImportError:
    raise EngineError(NO_BULLET) from None
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)
    os.close(_null)

_own = threading.local()  # the client of each thread


def empty_client() -> BulletClient:
    """Return the thread's Bullet client with an empty world; connecting again would take 5 ms."""
    if not hasattr(_own, 'client'):
        _own.client = BulletClient(pybullet.DIRECT)
    _own.client.resetSimulation()
    return _own.client


def compound(pieces: tuple[Array, ...], bullet: BulletClient) -> int:
    """Return a shape of convex pieces, each given by its corners (n, 3).

    PyBullet reads a compound of more than one set of corners only from a file.
    """
    with tempfile.NamedTemporaryFile('w', suffix='.obj') as file:
        file.write(_obj_text(pieces))
        file.flush()
        shape: int = bullet.createCollisionShape(bullet.GEOM_MESH, fileName=file.name)
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


# -- World ----------------------------------------------------------------------------------------


# Simultaneous impacts at several points, such as those of a cylinder's side, need many solver
# iterations: with a fixed 20, a cylinder came to rest on its ends in 0.37 of the drops, with 320
# or more in 0.40 (n = 8000). Each body iterates until no speed changes by more than the root of
# the residual, R / T, or until the maximum; doubling it does not change any probability.
SOLVER_RESIDUAL = 1e-10
MAX_SOLVER_ITERATIONS = 1000
# As SOLVER_RESIDUAL, on a surface that moves, which a part touches most of the time. With the
# smaller residual, the action `bowl` takes 2.8 times as long and has the same shares (29,600 pairs
# of actions from the same states: chi-square 43 with 47 degrees of freedom).
MOTION_RESIDUAL = 1e-8
# As SOLVER_RESIDUAL, in surroundings: a part in a groove has twice as many contacts. A smaller
# residual multiplies the time by up to 10.
RESIDUAL = 1e-7
# Half of the length, R, of a block that is infinitely long.
LONG = 2000.0
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
NO_TURN = [0.0, 0.0, 0.0, 1.0]
SURFACE_GROUP, PART_GROUP = 1, 2


class World:
    """A Bullet world with the bodies of a scene, the only one that creates and steps bodies.

    Its axes are those of the scene frame. All worlds of a thread share one Bullet client, so only
    the newest world of a thread is valid.

    Parameters
    ----------
    frame : (3,) float
        Velocity with which the world moves, R / T; by default ``DropJob.frame_velocity``.
    breaking : float
        Contacts persist until their points are this far apart, R. See CONTACT_BREAKING.
    """

    def __init__(
        self, job: DropJob, frame: Array | None = None, breaking: float = CONTACT_BREAKING
    ) -> None:
        residual = SOLVER_RESIDUAL if job.scene.level else RESIDUAL
        if job.motion is not None:
            residual = max(residual, MOTION_RESIDUAL)
        self._job, self._scene, self._bullet = job, job.scene, empty_client()
        self._frame = job.frame_velocity if frame is None else frame
        self._bodies: list[tuple[int, tuple[list[float], ...]]] = []
        self._belts: list[tuple[int, tuple[list[float], ...]]] = []
        self._bullet.setGravity(*job.scene.down.tolist())
        self._bullet.setPhysicsEngineParameter(
            numSubSteps=0,
            numSolverIterations=MAX_SOLVER_ITERATIONS,
            solverResidualThreshold=residual,
            # Bullet solves small islands together until they exceed this size. With 0, each body
            # is an island of its own and stops iterating independently.
            minimumSolverIslandSize=0,
            restitutionVelocityThreshold=RESTITUTION_THRESHOLD,
            contactBreakingThreshold=min(breaking, THIN_PART_FRACTION * job.min_height),
            deterministicOverlappingPairs=1,
        )
        self._set_steps(job.steps_per_t)
        for body in job.scene.bodies:
            self._add_body(body)
        if len(job.pieces) > 1:
            self._shape = compound(job.pieces, self._bullet)
        else:
            self._shape = self._bullet.createCollisionShape(
                self._bullet.GEOM_MESH, vertices=_corners(job.hull.tobytes())
            )

    def _set_steps(self, steps_per_t: int) -> None:
        """Set the number of time steps per T."""
        self._steps_per_t, self._step = steps_per_t, 1 / steps_per_t
        self._bullet.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            erp=self._step / PENETRATION_TIME,
            contactERP=self._step / PENETRATION_TIME,
        )

    def _add_body(self, body: SceneBody) -> None:
        """Add a body of the scene."""
        job = self._job
        velocity = body.velocity * (job.time_unit / job.radius) - self._frame
        # Below an edge, the shares of a box would differ by up to 0.1 with the other kind of body:
        # it hits the floor with two corners at almost the same time.
        movable = bool(
            velocity.any() or job.motion is not None or job.edge is not None or job.scene.level
        )
        for shape, position in self._shapes(body):
            made = self._add_fixed(shape, body.contact, movable=movable)
            state = (position.tolist(), NO_TURN, velocity.tolist(), [0.0] * 3)
            self._place(made, *state)
            self._bodies.append((made, state))
            if velocity.any() and not isinstance(body, HalfSpace):
                self._belts.append((made, state))

    def _add_fixed(self, shape: int, contact: PairValues, *, movable: bool) -> int:
        """Add a body that nothing pushes; only a ``movable`` one can be given a velocity."""
        # With useMaximalCoordinates, a step takes half the time, and friction has the direction
        # of the motion; without it, a box that slides obliquely to the axes of a plane travels up
        # to 14 % too far or too short. But Bullet then ignores a velocity.
        options = {} if movable else {'useMaximalCoordinates': 1}
        body: int = self._bullet.createMultiBody(0, shape, **options)
        self._set(
            body,
            restitution=contact.restitution,
            lateralFriction=contact.friction,
            rollingFriction=contact.rolling_friction * self._job.rolling_length,
            spinningFriction=self._job.conditions.spinning_friction,
        )
        self._collide(body, SURFACE_GROUP, PART_GROUP)
        return body

    def _shapes(self, body: SceneBody) -> Iterator[tuple[int, Array]]:
        """Yield the shapes of a body, and the place (3,) of each, R."""
        radius = self._job.radius
        if isinstance(body, HalfSpace):
            plane = self._bullet.createCollisionShape(
                self._bullet.GEOM_PLANE, planeNormal=body.normal.tolist()
            )
            yield plane, body.normal * body.offset / radius
        elif isinstance(body, Block):
            low, high = body.low / radius, body.high / radius
            if self._scene.free:  # the same everywhere along x, where the parts are side by side
                low[0], high[0] = -LONG, LONG
            box = self._bullet.createCollisionShape(
                self._bullet.GEOM_BOX, halfExtents=((high - low) / 2).tolist()
            )
            yield box, (high + low) / 2
        else:
            assert isinstance(body, MeshBody)
            yield from ((shape, np.zeros(3)) for shape in self._mesh_shapes(body))

    def _mesh_shapes(self, body: MeshBody) -> Iterator[int]:
        radius = self._job.radius
        if body.prisms:
            yield compound(tuple(corners / radius for corners in body.prisms), self._bullet)
        remaining = body.vertices[body.triangles] if body.remaining is None else body.remaining
        if len(remaining):
            vertices, indices = _lists((remaining / radius).tobytes())
            yield self._bullet.createCollisionShape(
                self._bullet.GEOM_MESH,
                vertices=vertices,
                indices=indices,
                flags=self._bullet.GEOM_FORCE_CONCAVE_TRIMESH,
            )

    def _place(self, body: int, *state: list[float]) -> None:
        """Set position, orientation, velocity and spin of a body."""
        self._bullet.resetBasePositionAndOrientation(body, *state[:2])
        self._bullet.resetBaseVelocity(body, *state[2:])

    def _set(self, body: int, **values: float | list[float]) -> None:
        self._bullet.changeDynamics(body, -1, **values)

    def _collide(self, body: int, group: int, mask: int) -> None:
        self._bullet.setCollisionFilterGroupMask(body, -1, group, mask)

    def _add(self, states: States) -> list[int]:
        """Add the parts, which a collision mask keeps from touching each other."""
        # Creating all bodies at once and placing them afterwards is faster: creating them one by
        # one takes a tenth of the time of a drop.
        bodies: tuple[int, ...] = self._bullet.createMultiBody(
            1, self._shape, batchPositions=states.position.tolist(), useMaximalCoordinates=1
        )
        for body in bodies:
            self._set(
                body,
                # Mass and inertia must be set together: without the mass it becomes 0, without
                # the inertia Bullet uses the inertia of the bounding box.
                mass=1,
                localInertiaDiagonal=self._job.moments.tolist(),
                # Bullet multiplies restitution and friction of two bodies; the rolling friction of
                # a pair is r_part mu_body + r_body mu_part. The body has the values of the pair.
                restitution=1,
                lateralFriction=1,
                rollingFriction=0,
                spinningFriction=0,
                linearDamping=0,
                angularDamping=0,
                # Contacts act only on touch. By default, Bullet slows an approaching part before
                # the contact, and with fine steps no speed is left to bounce (bullet3 issue 4341).
                contactProcessingThreshold=0,
                activationState=self._bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            )
        starts = list(zip(*(each.tolist() for each in states.arrays), strict=True))
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
        self._bullet.setPhysicsEngineParameter(fixedTimeStep=SHORT)
        self._bullet.stepSimulation()
        self._bullet.setPhysicsEngineParameter(fixedTimeStep=self._step)

    def drop(self, states: InitialState) -> Settling:
        """Release parts and step until each has ended."""
        states = replace(states, velocity=states.velocity - self._frame)
        settling = settling_of(self._job, states)
        self._settle(self._add(states), settling)
        return settling

    def follow(
        self,
        states: States,
        ended: Callable[[States], Flags],
        limit: float,
    ) -> States:
        """Step parts from n states until each has ended, and return their last states.

        ended : callable
            Returns which of some parts have ended; asked often.
        limit : float
            Time after which all parts have ended, T.
        """
        bodies = self._add(states)
        last = [np.array(each) for each in states.arrays]
        moving, now = np.arange(len(states.position)), 0.0
        while len(moving) and now < limit:
            now = self._until_check(now)
            here = self._states(bodies, moving)
            for whole, part in zip(last, here.arrays, strict=True):
                whole[moving] = part
            over = ended(here)
            for i in moving[over].tolist():
                self._bullet.removeBody(bodies[i])
            moving = moving[~over]
        return States(*last)

    def _settle(self, bodies: list[int], settling: Settling) -> None:
        """Step until each part has ended, and remove it then."""
        now = 0.0
        while len(settling.moving):
            now = self._until_check(now)
            moving = self._states(bodies, settling.moving)
            for i in settling.check(now, moving):
                self._bullet.removeBody(bodies[i])

    def _until_check(self, now: float) -> float:
        """Step the world from the time ``now``, T, to the next check; returns the time of it."""
        made, steps = (round(t * self._steps_per_t) for t in (now, CHECK_INTERVAL))
        self._advance(made, steps)
        return (made + steps) * self._step

    def _advance(self, made: int, steps: int) -> None:
        """Step the world, in which ``made`` steps were made, and move its bodies."""
        if self._job.in_motion(made * self._step):
            self._shake(made, steps)
            return
        for _ in range(steps):
            # A body with a velocity moves with it, and is put back. This needs no care for
            # half-spaces, which move along themselves.
            for body, state in self._belts:
                self._place(body, *state)
            self._bullet.stepSimulation()

    def _shake(self, made: int, steps: int) -> None:
        """Step the world and move all its bodies together.

        The velocity is that in the middle of a step, which leads from one position to the next.
        """
        job = self._job
        motion, unit = job.motion, job.time_unit
        assert motion is not None
        step = unit / job.steps_per_t
        times = np.arange(made, made + steps + 1, dtype=np.float64) * step
        position, orientation = motion.pose(times)
        velocity, spin = motion.velocity(times + step / 2)
        scaled = position / job.radius, orientation, velocity * (unit / job.radius), spin * unit
        *states, last = zip(*(values.tolist() for values in scaled), strict=True)
        for state in states:
            self._move(state)
            self._bullet.stepSimulation()
        self._move(last)

    def _move(self, state: tuple[list[float], ...]) -> None:
        """Put all bodies where a motion of the tray, in tray axes, R and T, brings them."""
        scene = self._scene
        if scene.level:
            self._place(self._bodies[0][0], *state)
            return
        position, turn, velocity, spin = map(np.array, state)
        at, v, w = scene.in_scene(np.stack([position, velocity, spin]))
        turned = in_scene_axes(scene, product(turn[None], scene.tray_from_scene[None]))[0]
        for body, (place, orientation, belt, _) in self._bodies:
            arm, own = rotate(turned, np.array([place, belt]))
            facing = product(turned[None], np.array([orientation]))[0]
            moved = (at + arm, facing, v + np.cross(w, arm) + own, w)
            self._place(body, *(values.tolist() for values in moved))

    def _states(self, bodies: list[int] | dict[int, int], which: Indices) -> States:
        ids = [bodies[i] for i in which.tolist()]
        poses = [self._bullet.getBasePositionAndOrientation(i) for i in ids]
        speeds = [self._bullet.getBaseVelocity(i) for i in ids]
        position, orientation = map(np.array, zip(*poses, strict=True))
        velocity, spin = map(np.array, zip(*speeds, strict=True))
        return States(position, orientation, velocity, spin)


@lru_cache(maxsize=16)
def _corners(hull: bytes) -> list[list[float]]:
    """Return the hull vertices, (k, 3) float64, for Bullet; the same objects for every world.

    PyBullet never releases its reference to each number. Without the cache, a hull of 3000
    vertices would leak 0.3 MB per world.
    """
    corners: list[list[float]] = np.frombuffer(hull).reshape(-1, 3).tolist()
    return corners


@lru_cache(maxsize=16)
def _lists(corners: bytes) -> tuple[list[list[float]], list[int]]:
    """Return a mesh for PyBullet; the same objects for every world, see bullet_world._corners."""
    points, rows = np.unique(np.frombuffer(corners).reshape(-1, 3), axis=0, return_inverse=True)
    return points.tolist(), rows.ravel().tolist()
