"""Other engines that simulate drops of the same hull: MuJoCo, and Blender's rigid body world.

The suite needs neither of them; an engine that cannot be imported is skipped. Each engine runs in
its own process.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bench_case import Trial, drop_until_decided, drop_until_still, steps_in
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.rotations import Array, rotate, wxyz_from_xyzw, xyzw_from_wxyz
from resting_aspects_ros.simulation.bullet_world import PENETRATION_TIME
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import BodyStates
from resting_aspects_ros.simulation.settling import (
    CHECK_INTERVAL,
    REST_MOTION,
    TIME_LIMIT,
)

# Names of the packages for pip. A Blender package supports one version of Python, this one 3.11.
MUJOCO = 'mujoco'
BLENDER = 'bpy==4.2.0'

# MuJoCo's soft contacts creep: with the suite's REST_MOTION, most drops would never be still.
MUJOCO_MOTION = 10 * REST_MOTION
# Number of solver iterations, which is fixed in Blender; the default is 10.
ITERATIONS = 20
# Half the side of the block that is Blender's surface, R.
BLOCK = 50.0


class MujocoBody:
    """A bench_case.Body in MuJoCo.

    A contact is a spring whose damping corresponds to the restitution, and whose half-period is
    the time in which the suite's engine corrects penetration. Friction cones are elliptic, because
    with pyramidal cones, MuJoCo's default, a fifth of the drops never come to rest. There is no
    rolling friction, because a part with flat sides does not need it and a step is faster without.

    ``planes`` are the frictions of planes through the origin, by their axis z or y; the friction
    of a pair is the larger one of the two, so that of the part is then 0.
    """

    def __init__(
        self,
        job: DropJob,
        gravity: Sequence[float] = (0, 0, -1),
        planes: Mapping[str, float] | None = None,
    ) -> None:
        import mujoco

        self._step = mujoco.mj_step
        self._reset = mujoco.mj_resetData
        c = job.conditions
        loss = -math.log(max(c.restitution, 1e-3))
        ratio = loss / math.hypot(math.pi, loss)
        contact = (
            f'condim="3" solref="{PENETRATION_TIME / (math.pi * ratio)} {ratio}" '
            'friction="{} 0 0"'
        )
        axes = {'z': '0 0 1', 'y': '0 1 0'}
        ground = '\n'.join(
            f'<geom type="plane" size="0 0 1" zaxis="{axes[axis]}" {contact.format(friction)}/>'
            for axis, friction in (planes or {'z': c.friction}).items()
        )
        of_part = contact.format(0.0 if planes else c.friction)
        down = _numbers(np.array(gravity))
        self.model = mujoco.MjModel.from_xml_string(f"""
            <mujoco>
              <compiler inertiafromgeom="false"/>
              <option timestep="{1 / job.steps_per_t}" gravity="{down}" cone="elliptic"/>
              <asset><mesh name="hull" vertex="{_numbers(job.hull)}"/></asset>
              <worldbody>
                {ground}
                <body>
                  <freejoint/>
                  <inertial pos="0 0 0" mass="1" diaginertia="{_numbers(job.moments)}"/>
                  <geom type="mesh" mesh="hull" {of_part}/>
                </body>
              </worldbody>
            </mujoco>""")
        self.data = mujoco.MjData(self.model)

    def place(self, position: Array, orientation: Array) -> None:
        """Place the body at rest."""
        self._reset(self.model, self.data)
        self.data.qpos[:] = [*position, *wxyz_from_xyzw(orientation)]

    def start(
        self, position: list[float], orientation: list[float], velocity: list[float]
    ) -> None:
        """Place the body with a velocity."""
        self.place(np.array(position), np.array(orientation))
        self.data.qvel[:3] = velocity

    def step(self, steps: int) -> None:
        """Simulate this number of time steps."""
        self._step(self.model, self.data, steps)

    def pose(self) -> list[float]:
        """Return position and orientation xyzw."""
        x, y, z, qw, qx, qy, qz = self.data.qpos.tolist()
        return [x, y, z, qx, qy, qz, qw]

    def states(self) -> BodyStates:
        """Return pose and motion."""
        position, wxyz = np.split(self.data.qpos[None].copy(), [3], axis=1)
        # MuJoCo returns the spin in body axes.
        velocity, spin = np.split(self.data.qvel[None].copy(), [3], axis=1)
        orientation = xyzw_from_wxyz(wxyz)
        return BodyStates(position, orientation, velocity, rotate(orientation, spin))


class BlenderBody:
    """A bench_case.Body in Blender, without ``states``; each frame is a check.

    Blender uses the inertia of the hull's bounding box and has no rolling friction. Its contacts
    are the default of Bullet.
    """

    def __init__(self, job: DropJob) -> None:
        import bpy

        self._bpy: Any = bpy
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = self._scene = bpy.context.scene
        self._look = steps_in(job, CHECK_INTERVAL)
        last = 2 + round(TIME_LIMIT / CHECK_INTERVAL)
        scene.gravity = (0, 0, -1)
        # Frames per T; fps must be an integer, so the base has the fraction.
        scene.render.fps, scene.render.fps_base = 1, CHECK_INTERVAL
        scene.frame_start, scene.frame_end = 1, last
        bpy.ops.rigidbody.world_add()
        world = scene.rigidbody_world
        world.substeps_per_frame = self._look
        world.solver_iterations = ITERATIONS
        world.point_cache.frame_start, world.point_cache.frame_end = 1, last
        corners = BLOCK * (2 * np.indices((2, 2, 2)).reshape(3, 8).T - 1.0)
        ground = self._add('ground', corners, 'PASSIVE', 'BOX')
        ground.location = (0, 0, -BLOCK)
        ground.rigid_body.friction = ground.rigid_body.restitution = 1
        self.part = self._add('part', job.hull, 'ACTIVE', 'CONVEX_HULL')
        self.part.rotation_mode = 'QUATERNION'
        body = self.part.rigid_body
        body.mass = 1
        body.friction = job.conditions.friction
        body.restitution = job.conditions.restitution
        body.linear_damping = body.angular_damping = 0
        body.use_deactivation = False

    def _add(self, name: str, points: Array, kind: str, shape: str) -> Any:
        bpy = self._bpy
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(points.tolist(), [], ConvexHull(points).simplices.tolist())
        body = bpy.data.objects.new(name, mesh)
        self._scene.collection.objects.link(body)
        bpy.context.view_layer.objects.active = body
        bpy.ops.rigidbody.object_add(type=kind)
        body.rigid_body.collision_shape = shape
        body.rigid_body.use_margin = True
        body.rigid_body.collision_margin = 0.001
        return body

    def place(self, position: Array, orientation: Array) -> None:
        """Place the body at rest in the first frame, which discards the simulated frames."""
        self._scene.frame_set(1)
        self.part.location = position
        self.part.rotation_quaternion = wxyz_from_xyzw(orientation)
        self._bpy.context.view_layer.update()

    def step(self, steps: int) -> None:
        """Simulate one frame."""
        if steps != self._look:
            raise ValueError(f'invalid steps {steps}: expected {self._look}, the steps of a frame')
        self._scene.frame_set(self._scene.frame_current + 1)

    def pose(self) -> list[float]:
        """Return position and orientation xyzw."""
        pose = self.part.matrix_world
        w, x, y, z = pose.to_quaternion()
        return [*pose.translation, x, y, z, w]

    def states(self) -> BodyStates:
        """Raise NotImplementedError: Blender does not provide velocities."""
        raise NotImplementedError


def mujoco_still(job: DropJob, chunks: range) -> Trial:
    """Simulate drops in MuJoCo until they are still; ImportError without MuJoCo."""
    return drop_until_still(MujocoBody(job), job, chunks, MUJOCO_MOTION)


def mujoco_energy(job: DropJob, chunks: range) -> Trial:
    """Simulate drops in MuJoCo until the suite's rule ends them; ImportError without MuJoCo."""
    return drop_until_decided(MujocoBody(job), job, chunks)


def blender_still(job: DropJob, chunks: range) -> Trial:
    """Simulate drops in Blender until they are still; ImportError without Blender."""
    return drop_until_still(BlenderBody(job), job, chunks)


def _numbers(array: Array) -> str:
    return ' '.join(map(str, array.ravel().tolist()))
