"""Single impacts in the kernel and in Bullet, side by side, for `make validate`."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.simulation import kernel
from resting_aspects_ros.simulation.bullet_world import World, pybullet
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import DropJob, make_job
from resting_aspects_ros.simulation.kernel_data import work_of
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of
from resting_aspects_ros.simulation.release import REST_MARGIN, InitialState, depth_of

# Factor by which Bullet's time step is finer than in a drop, so that gravity adds little.
REFINEMENT = 64
# Number of its steps: it finds one corner after the other.
STEPS = 12
# Speeds of the corners that touch, R / T, and distance between a single one and the next, R.
SLOWEST, APART = 0.1, 0.05
TOUCHING = 1e-6
KINDS = ('one corner', 'two corners', 'a side')

Pose = Callable[[DropJob, np.random.Generator], Array]


def compared(part: Part, conditions: DropConditions, kind: str, n: int) -> dict[str, float]:
    """Return figures of n random impacts with one corner, two corners or a side.

    The rolling friction is left out. Keys: ``difference``, the median of the difference of the
    changes of the velocity, as a share of that in the kernel, and ``worst``, its 95 % quantile. Of
    one corner that slips also ``normal``, the median of the relative difference of the normal
    impulse, ``friction``, the median of Bullet's friction impulse in units of mu p_n, and
    ``angle`` and ``angle_kernel``, the 95 % quantile of the angle between the friction impulse and
    the slip that remains, in degrees.
    """
    smooth = conditions.changed(rolling_friction=0.0)
    of_bullet = make_job(part, smooth, 1, engine='bullet', refinement=REFINEMENT)
    job = make_job(part, smooth, 1)
    rng = np.random.default_rng(1)
    found = [_both(job, of_bullet, _impact(job, kind, rng)) for _ in range(n)]
    share = np.array([each[0] for each in found])
    figures = {'difference': float(np.median(share)), 'worst': float(np.quantile(share, 0.95))}
    slips = np.array([each[1] for each in found if each[1] is not None])
    if kind == KINDS[0] and len(slips):
        figures['normal'] = float(np.median(np.abs(slips[:, 0])))
        figures['friction'] = float(np.median(slips[:, 1]))
        figures['angle'] = float(np.quantile(slips[:, 2], 0.95))
        figures['angle_kernel'] = float(np.quantile(slips[:, 3], 0.95))
    return figures


def _impact(job: DropJob, kind: str, rng: np.random.Generator) -> InitialState:
    """Return a state in which the corners that touch the plane approach it."""
    while True:
        q = _oriented(job, kind, rng)
        corners = Rotation.from_quat(q).apply(job.hull)
        heights = np.sort(corners[:, 2]) - corners[:, 2].min()
        if kind == KINDS[0] and heights[1] < APART:
            continue
        v, w = rng.normal(size=3) * [0.7, 0.7, 0.5], rng.normal(size=3) * 0.7
        v[2] = -abs(v[2]) - 0.5
        touching = corners[:, 2] < corners[:, 2].min() + TOUCHING
        if ((v + np.cross(w, corners[touching]))[:, 2] > -SLOWEST).any():
            continue
        place = np.array([[0.0, 0.0, depth_of(q[None], job.hull)[0]]])
        return InitialState(place, q[None], v[None], w[None], np.zeros(1))


def _oriented(job: DropJob, kind: str, rng: np.random.Generator) -> Array:
    """Return a quaternion xyzw with one corner, an edge or a side at the bottom."""
    if kind == KINDS[0]:
        return random_orientations(rng, 1)[0]
    body = body_of(job)
    down = body.normals[rng.integers(len(body.normals))]
    if kind == KINDS[1]:
        one, other = body.normals[body.sides[rng.integers(len(body.ends))]]
        down = one + (other - one) * rng.uniform(0.2, 0.8)
    tilt = Rotation.align_vectors([[0.0, 0.0, -1.0]], [down])[0]
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 2 * np.pi)])
    return np.asarray((yaw * tilt).as_quat())


def _both(
    job: DropJob, of_bullet: DropJob, state: InitialState
) -> tuple[float, tuple[float, float, float, float] | None]:
    """Return by which share the changes of the velocity differ, and figures of a slip."""
    after = np.empty((1, 6))
    body, ground = body_of(job), ground_of(job)
    kernel.collide(
        body,
        ground,
        work_of(body, ground),
        state.position,
        state.velocity,
        state.spin,
        state.orientation,
        TOUCHING,
        after,
    )
    ours = after[0, :3] - state.velocity[0]
    theirs = _in_bullet(of_bullet, state)
    share = float(np.linalg.norm(theirs - ours) / np.linalg.norm(ours))
    friction = job.conditions.friction
    if np.hypot(*ours[:2]) < friction * ours[2] * (1 - TOUCHING):
        return share, None
    slip = (
        theirs[2] / ours[2] - 1,
        np.hypot(*theirs[:2]) / (friction * theirs[2]),
        _angle(job, state, theirs),
        _angle(job, state, ours),
    )
    return share, tuple(map(float, slip))  # type: ignore[return-value]


def _angle(job: DropJob, state: InitialState, impulse: Array) -> float:
    """Return the angle between a friction impulse and the slip after it, degrees."""
    matrix = Rotation.from_quat(state.orientation[0]).as_matrix()
    corners = job.hull @ matrix.T
    arm = corners[corners[:, 2].argmin()]
    spin = state.spin[0] + matrix @ (matrix.T @ np.cross(arm, impulse) / job.moments)
    slip = (state.velocity[0] + impulse + np.cross(spin, arm))[:2]
    cosine = -slip @ impulse[:2] / (np.linalg.norm(slip) * np.linalg.norm(impulse[:2]))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _in_bullet(job: DropJob, state: InitialState) -> npt.NDArray[np.float64]:
    """Return the change of the velocity in the steps in which Bullet finds the contacts."""
    world = World(job)
    above = state.position + np.array([0.0, 0.0, REST_MARGIN - 1e-5])
    (body,) = world._add(  # noqa: SLF001
        InitialState(above, state.orientation, state.velocity, state.spin, state.elapsed)
    )
    for _ in range(STEPS):
        pybullet.stepSimulation(physicsClientId=world._client)  # noqa: SLF001
    now = np.array(pybullet.getBaseVelocity(body, physicsClientId=world._client)[0])  # noqa: SLF001
    fallen = np.array([0.0, 0.0, -STEPS / job.steps_per_t])
    return np.asarray(now - state.velocity[0] - fallen)
