"""The entry to the kernel: drops of a part that only touches planes, in any range of indices."""

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.simulation import kernel_data as kernel
from resting_aspects_ros.simulation.actions import RAMP_PERIODS
from resting_aspects_ros.simulation.compiled_kernel import simulate
from resting_aspects_ros.simulation.ends import Ends, resting_poses
from resting_aspects_ros.simulation.job import CUDA, DropJob
from resting_aspects_ros.simulation.release import initial_states
from resting_aspects_ros.simulation.scene import HalfSpace
from resting_aspects_ros.simulation.settling import TIME_LIMIT
from resting_aspects_ros.statistics.poses import RestingPoses

# A part in surroundings that is faster than this, R / T, and than this multiple of the speed of
# its first impact slides for ever: it has come down by at least 50 R.
MAX_SPEED, MAX_SPEEDUP = 10.0, 3.0


def drop_range(job: DropJob, first: int, end: int) -> RestingPoses:
    """Simulate the drops ``first`` to ``end - 1`` until they end.

    The pose of a drop depends only on the job and its index. Several threads can simulate ranges
    at the same time: the compiled code holds no lock of Python.
    """
    states = initial_states(job, first, end)
    ends, codes = np.empty((end - first, 15)), np.empty((end - first, 2), dtype=np.int64)
    motion = job.motion
    limit = TIME_LIMIT + states.flight
    if motion is not None:
        limit += motion.duration / job.time_unit
    numerics = kernel.Numerics().refined(job.refinement, not job.until_still)
    (_on_gpu() if job.engine == CUDA else simulate)(
        body_of(job),
        ground_of(job),
        numerics,
        limit,
        (states.position, states.velocity, states.spin, states.orientation),
        ends,
        codes,
    )
    found = Ends(
        position=ends[:, :3],
        orientation=ends[:, 3:7],
        status=codes[:, 0].astype(np.uint8),
        minimum=codes[:, 1],
        time=ends[:, 7] + states.elapsed,
        growth=ends[:, 8],
    )
    return resting_poses(job, first, found)


@cache
def _on_gpu() -> Callable[..., None]:
    """Return the simulation on a GPU; raises EngineError if there is none."""
    # This needs numba-cuda and a driver.
    from resting_aspects_ros.simulation import kernel_cuda

    kernel_cuda.check_device()
    return kernel_cuda.simulate


@lru_cache(maxsize=16)
def body_of(job: DropJob) -> kernel.Body:
    """Return the part of a job for the kernel."""
    rule, axes = job.rest, Rotation.from_quat(job.axes)
    hull, landscape = rule.landscape.hull, rule.landscape

    def in_body(vectors: Array) -> Array:
        return np.ascontiguousarray(axes.apply(vectors, inverse=True))

    fans = hull.edges_of_points
    pairs = _edges(hull.points)
    return kernel.Body(
        points=np.ascontiguousarray(in_body(hull.points).T),
        starts=np.searchsorted(pairs[:, 0], np.arange(len(hull.points) + 1)),
        near=np.ascontiguousarray(pairs[:, 1]),
        fans=np.cumsum([0, *map(len, fans)]),
        edges=np.concatenate([np.array(each) for each in fans]),
        ends=np.ascontiguousarray(hull.ends),
        sides=np.ascontiguousarray(hull.sides),
        feet=np.ascontiguousarray(hull.feet),
        normals=in_body(hull.normals),
        minima=np.ascontiguousarray(landscape.minima_of_facets),
        directions=in_body(landscape.directions),
        exits=np.ascontiguousarray(rule.exits),
        margins=np.ascontiguousarray(rule.margins),
        heights=landscape.heights / landscape.radius,
        rollers=in_body(rule.rollers),
        moments=np.ascontiguousarray(job.moments),
    )


def _edges(points: Array) -> Array:
    """Return (k, 2) the edges of a convex hull in both directions, ordered by their first end."""
    hull = ConvexHull(points)
    beside = hull.equations[hull.neighbors]
    # Not those between triangles of one plane, which can be many at one corner.
    bent = np.abs(beside - hull.equations[:, None]).max(axis=2) > 1e-9
    # The neighbour k of a triangle is opposite to its corner k.
    edges = hull.simplices[:, [[1, 2], [2, 0], [0, 1]]][bent].astype(np.int64)
    return np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)


@lru_cache(maxsize=16)
def ground_of(job: DropJob) -> kernel.Ground:
    """Return what the part of a job touches, for the kernel."""
    scale = job.time_unit / job.radius
    scene = job.scene
    planes = np.array([_plane(job, space) for space in scene.half_spaces])
    return kernel.Ground(
        planes=planes,
        gravity=job.down,
        carriers=scene.velocities() * scale,
        motion=_motion(job),
        level=scene.level,
        endless=scene.free,
        driven=scene.driven,
        fastest=max(MAX_SPEED, MAX_SPEEDUP * job.impact_speed * scale),
    )


def _plane(job: DropJob, space: HalfSpace) -> Array:
    """Return the columns of a plane, in R and T."""
    row, normal, contact = np.zeros(kernel.PLANE), space.normal, space.contact
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= np.linalg.norm(across)
    row[:9] = np.concatenate([normal, np.cross(across, normal), across])
    row[kernel.OFFSET] = space.offset / job.radius
    row[kernel.RESTITUTION], row[kernel.FRICTION] = contact.restitution, contact.friction
    row[kernel.ROLL] = contact.rolling_friction * job.rolling_length
    row[kernel.SPIN] = job.conditions.spinning_friction
    row[kernel.CARRIES : kernel.CARRIES + 3] = space.velocity * (job.time_unit / job.radius)
    return row


def _motion(job: DropJob) -> Array:
    """Return the numbers of the motion of the surfaces, in R and T."""
    numbers = np.zeros(kernel.MOTION)
    motion = job.motion
    if motion is None:
        return numbers
    unit, radius = job.time_unit, job.radius
    numbers[kernel.RATE] = 2 * np.pi * motion.frequency * unit
    numbers[kernel.RAMP] = RAMP_PERIODS / motion.frequency / unit
    numbers[kernel.DURATION] = motion.duration / unit
    numbers[kernel.SHIFT_PHASE] = motion.horizontal_phase
    numbers[kernel.ROCK_PHASE] = motion.rocking_phase
    vectors = np.array(
        [
            [0.0, 0.0, motion.vertical_amplitude / radius],
            [motion.horizontal_amplitude / radius, 0.0, 0.0],
            [motion.rocking_x, motion.rocking_y, 0.0],
        ]
    )
    if job.scene.level:
        numbers[kernel.SIZE] = motion.plate_size / radius
    numbers[kernel.LIFT :] = job.scene.in_scene(vectors).ravel()
    return numbers
