"""Drops of the same hull in MuJoCo, many at once in the threads of `mujoco.rollout`.

The suite does not need MuJoCo; without it, the comparison is left out.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation.bullet_world import PENETRATION_TIME
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import TIME_LIMIT
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL, REST_MOTION, REST_WINDOW
from validation.trial import down_at_rest, released

# MuJoCo's soft contacts creep: with the suite's REST_MOTION, most drops would never be still.
MOTION = 10 * REST_MOTION


def mujoco_loop(threads: int, job: DropJob, first: int, drops: int) -> Array:
    """Simulate drops until they are still; ImportError without MuJoCo.

    After each CHECK_INTERVAL, the drops that still move are rolled out further. Returns down in
    part of those that came to rest.
    """
    import mujoco
    from mujoco.rollout import Rollout

    model = _model(mujoco, job)
    start = released(job, first, drops)
    # Time, position, orientation wxyz, velocity, and spin in body axes.
    states = np.column_stack(
        [
            np.zeros(drops),
            start.position,
            np.roll(start.orientation, 1, axis=-1),
            start.velocity,
            rotate(start.orientation * [-1, -1, -1, 1], start.spin),
        ]
    )
    assert states.shape[1] == mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    look = round(CHECK_INTERVAL * job.steps_per_t)
    still, moving = np.zeros(drops), np.arange(drops)
    with Rollout(nthread=threads) as pool:
        data = [mujoco.MjData(model) for _ in range(threads)]
        for _ in range(round(TIME_LIMIT / CHECK_INTERVAL)):
            after = pool.rollout(model, data, states[moving], nstep=look)[0][:, -1]
            moved = np.abs(after - states[moving])[:, 1:8].max(axis=1)
            still[moving] = np.where(moved < MOTION, still[moving] + 1, 0)
            states[moving] = after
            moving = moving[still[moving] < REST_WINDOW / CHECK_INTERVAL]
            if not len(moving):
                break
    at_rest = np.delete(states, moving, axis=0)
    return down_at_rest(job, np.roll(at_rest[:, 4:8], -1, axis=-1))


def _model(mujoco: Any, job: DropJob) -> Any:
    """Return the hull of the part and the plane.

    A contact is a damped spring, whose half-period is the time in which the suite corrects
    penetration in Bullet, divided by the refinement of the job. MuJoCo states spring and damping
    as accelerations, so that each contact has its restitution for any mass at its corner. Friction
    cones are elliptic, because with pyramidal cones, MuJoCo's default, a fifth of the drops never
    come to rest. There is no rolling friction, because a part with flat sides does not need it and
    a step is faster without. Because of their priority, the values of a plane are those of the
    pair.
    """
    c, period, down = job.conditions, PENETRATION_TIME / job.refinement, job.scene.down
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <compiler inertiafromgeom="false"/>
          <option timestep="{1 / job.steps_per_t}" gravity="{_numbers(down)}" cone="elliptic"/>
          <asset><mesh name="hull" vertex="{_numbers(job.hull)}"/></asset>
          <worldbody>
            <geom type="plane" size="0 0 1" {_contact(c.friction, c.restitution, period)}/>
            <body>
              <freejoint/>
              <inertial pos="0 0 0" mass="1" diaginertia="{_numbers(job.moments)}"/>
              <geom type="mesh" mesh="hull"/>
            </body>
          </worldbody>
        </mujoco>""")


def ball_after_impact(slip: float, friction: float, restitution: float, refinement: int) -> float:
    """Return the normal speed of a ball in MuJoCo that struck a plane at speed 1, with a slip.

    Without gravity; the radius is 1, and lengths and times are those of `mujoco_loop`.
    """
    import mujoco

    period = PENETRATION_TIME / refinement
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{period / 30}" gravity="0 0 0" cone="elliptic"/>
          <worldbody>
            <geom type="plane" size="0 0 1" {_contact(friction, restitution, period)}/>
            <body pos="0 0 1.05">
              <freejoint/>
              <inertial pos="0 0 0" mass="1" diaginertia="0.4 0.4 0.4"/>
              <geom type="sphere" size="1"/>
            </body>
          </worldbody>
        </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:3] = slip, 0, -1
    while data.time < 1:
        mujoco.mj_step(model, data)
    return float(data.qvel[2])


def _contact(friction: float, restitution: float, period: float) -> str:
    """Return the attributes of a plane whose contacts are damped springs with a half-period."""
    ratio = _damping_ratio(restitution)
    return (
        f'priority="1" condim="3" solref="{period / (math.pi * ratio)} {ratio}" '
        f'friction="{friction} 0 0"'
    )


def _damping_ratio(restitution: float) -> float:
    """Return the damping ratio cos(a) of a spring that pushes only, at least exp(-2).

    It lets go at an acceleration of 0, with exp(-2 a / tan(a)) of the speed (Schwager and
    Poeschel, Granular Matter 9, 2007).
    """
    loss = min(-math.log(restitution), 2.0) / 2 if restitution > 0 else 1.0
    if loss == 1:
        return 1.0
    return math.cos(brentq(lambda a: a / math.tan(a) - loss, 1e-6, math.pi / 2))


def _numbers(array: Array) -> str:
    return ' '.join(map(str, array.ravel().tolist()))
