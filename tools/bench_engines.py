"""Other engines that drop the same hull: MuJoCo, and Blender's rigid body world.

Neither is needed by the suite; what cannot be imported is skipped. Each runs in a process of its
own.
"""

import math
from typing import Any

import numpy as np
from bench_case import Trial, drop_until_decided, drop_until_still, steps_in
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.rotations import Array, rotate, wxyz_from_xyzw, xyzw_from_wxyz
from resting_aspects_ros.simulation.bullet_engine import PENETRATION_TIME
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.settling import (
    CHECK_INTERVAL,
    REST_MOTION,
    TIME_LIMIT,
    BodyStates,
)

# As pip names them; Blender has a package for each of its versions for one version of Python, this
# one for 3.11.
MUJOCO = 'mujoco'
BLENDER = 'bpy==4.2.0'

# MuJoCo's soft contacts creep: with the suite's REST_MOTION most drops are never still.
MUJOCO_MOTION = 10 * REST_MOTION
# Blender's solver has a fixed number; it asks for 10 by default.
ITERATIONS = 20
# Half the side of the block that is Blender's surface, R.
BLOCK = 50.0


class MujocoBody:
    """A body of bench_case.Body in MuJoCo.

    A contact is a spring with the damping that bounces as high as the restitution says, and with a
    half-period of the time in which the suite's engine pushes overlap apart. Elliptic friction
    cones, because with MuJoCo's default, pyramids, a fifth of the drops never come to rest; no
    rolling friction, because a part with flat sides needs none and a step then takes less.
    """

    def __init__(self, job: DropJob) -> None:
        import mujoco

        self._step = mujoco.mj_step
        self._reset = mujoco.mj_resetData
        c = job.conditions
        loss = -math.log(max(c.restitution, 1e-3))
        ratio = loss / math.hypot(math.pi, loss)
        contact = (
            f'friction="{c.friction} 0 0" condim="3" '
            f'solref="{PENETRATION_TIME / (math.pi * ratio)} {ratio}"'
        )
        self.model = mujoco.MjModel.from_xml_string(f"""
            <mujoco>
              <compiler inertiafromgeom="false"/>
              <option timestep="{1 / job.steps_per_t}" gravity="0 0 -1" cone="elliptic"/>
              <asset><mesh name="hull" vertex="{_numbers(job.hull)}"/></asset>
              <worldbody>
                <geom type="plane" size="0 0 1" {contact}/>
                <body>
                  <freejoint/>
                  <inertial pos="0 0 0" mass="1" diaginertia="{_numbers(job.moments)}"/>
                  <geom type="mesh" mesh="hull" {contact}/>
                </body>
              </worldbody>
            </mujoco>""")
        self.data = mujoco.MjData(self.model)

    def place(self, position: Array, orientation: Array) -> None:
        """Put it there, without motion."""
        self._reset(self.model, self.data)
        self.data.qpos[:] = [*position, *wxyz_from_xyzw(orientation)]

    def step(self, steps: int) -> None:
        """Let time pass."""
        self._step(self.model, self.data, steps)

    def pose(self) -> list[float]:
        """Position, orientation xyzw."""
        x, y, z, qw, qx, qy, qz = self.data.qpos.tolist()
        return [x, y, z, qx, qy, qz, qw]

    def states(self) -> BodyStates:
        """Pose and motion."""
        position, wxyz = np.split(self.data.qpos[None].copy(), [3], axis=1)
        # MuJoCo has the spin in body axes.
        velocity, spin = np.split(self.data.qvel[None].copy(), [3], axis=1)
        orientation = xyzw_from_wxyz(wxyz)
        return BodyStates(position, orientation, velocity, rotate(orientation, spin))


class BlenderBody:
    """A body of bench_case.Body in Blender, without ``states``; a frame of it is a look.

    Blender takes the inertia of a hull's bounding box and knows no rolling friction; its contacts
    are Bullet's by default.
    """

    def __init__(self, job: DropJob) -> None:
        import bpy

        self._bpy: Any = bpy
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = self._scene = bpy.context.scene
        self._look = steps_in(job, CHECK_INTERVAL)
        last = 2 + round(TIME_LIMIT / CHECK_INTERVAL)
        scene.gravity = (0, 0, -1)
        # Frames in a unit of time, which is T; what is not a whole number goes into the base.
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
        """Put it there, without motion, in the first frame: what was simulated is forgotten."""
        self._scene.frame_set(1)
        self.part.location = position
        self.part.rotation_quaternion = wxyz_from_xyzw(orientation)
        self._bpy.context.view_layer.update()

    def step(self, steps: int) -> None:
        """Let time pass, a frame."""
        if steps != self._look:
            raise ValueError(f'invalid steps {steps}: expected {self._look}, the steps of a frame')
        self._scene.frame_set(self._scene.frame_current + 1)

    def pose(self) -> list[float]:
        """Position, orientation xyzw."""
        pose = self.part.matrix_world
        w, x, y, z = pose.to_quaternion()
        return [*pose.translation, x, y, z, w]

    def states(self) -> BodyStates:
        """Blender does not tell how bodies move."""
        raise NotImplementedError


def mujoco_still(job: DropJob, chunks: range) -> Trial:
    """Raises ImportError without MuJoCo."""
    return drop_until_still(MujocoBody(job), job, chunks, MUJOCO_MOTION)


def mujoco_energy(job: DropJob, chunks: range) -> Trial:
    """The same, ended by the suite's own rule."""
    return drop_until_decided(MujocoBody(job), job, chunks)


def blender_still(job: DropJob, chunks: range) -> Trial:
    """Raises ImportError without Blender."""
    return drop_until_still(BlenderBody(job), job, chunks)


def _numbers(array: Array) -> str:
    return ' '.join(map(str, array.ravel().tolist()))
