"""Bodies that are placed on a plane or in surroundings, for comparisons with mechanics."""

import dataclasses
import math

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.kernel_data import Numerics
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of, simulate
from resting_aspects_ros.simulation.release import TIME_LIMIT
from resting_aspects_ros.simulation.scene import depth_of
from resting_aspects_ros.simulation.starts import States
from resting_aspects_ros.simulation.surroundings import Surroundings


class Placed:
    """Bodies in the kernel, from given states: frame of the surroundings, R and T.

    states : States
    time : (n,) float
        How long each was simulated, T.
    status : (n,) uint8
        Codes of RestStatus of the last run.
    """

    def __init__(self, job, position, orientation, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)):
        n = len(position)
        self.job = job
        self.states = States(
            *(
                np.array(np.broadcast_to(each, (n, columns)), dtype=float)
                for each, columns in ((position, 3), (orientation, 4), (velocity, 3), (spin, 3))
            )
        )
        self.time = np.zeros(n)
        self.status = np.zeros(n, dtype=np.uint8)
        self._ground = ground_of(job)

    def run(self, time):
        """Simulate each body until it has ended, or for ``time`` T or up to 0.5 T longer."""
        s, n = self.states, len(self.time)
        ends, codes = np.empty((n, 15)), np.empty((n, 2), dtype=np.int64)
        simulate(
            body_of(self.job),
            self._ground,
            Numerics().refined(self.job.refinement, decides=False),
            time,
            (s.position, s.velocity, s.spin, s.orientation),
            ends,
            codes,
        )
        rows = ends[:, :3], ends[:, 3:7], ends[:, 9:12], ends[:, 12:]
        self.states = States(*(np.ascontiguousarray(each) for each in rows))
        self.time = self.time + ends[:, 7]
        self.status = codes[:, 0].astype(np.uint8)
        return self.states

    def settle(self):
        """Simulate until all have ended; returns their statuses."""
        self.run(TIME_LIMIT)
        return self.status

    def tilt(self, angle):
        """Incline the level plane z = 0 by an angle, downhill along x."""
        down = np.array([math.sin(angle), 0.0, -math.cos(angle)])
        self._ground = self._ground._replace(gravity=down)


def job_in(part, conditions, kind, bodies=None, release=None, **more):
    """Return the job of a part in a kind of surroundings; ``more`` is for make_job."""
    found = Surroundings(kind, bodies=bodies or {}, release=release or {})
    return make_job(part, dataclasses.replace(conditions, surroundings=found), 1, **more)


def flat_on(job, yaws, velocity=(0.0, 0.0, 0.0), x=0.0, y=0.0, lift=0.0):
    """Place bodies with their part frames turned by angles about z on the plane z = 0."""
    turned = Rotation.from_euler('z', np.reshape(yaws, (-1, 1)))
    orientation = (turned * Rotation.from_quat(job.axes)).as_quat()
    height = depth_of(orientation, job.hull) + lift
    position = np.stack([0 * height + x, 0 * height + y, height], axis=1)
    return Placed(job, position, orientation, velocity)


def point_path(angle, friction, velocity, step=1e-3):
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


def groove_height(job, rolls, corners):
    """Return the heights (n,) at which a turned cross-section (k, 2) touches both planes."""
    planes = [body.normal for body in job.scene.half_spaces]
    return np.asarray(sum(_reaches(job, rolls, corners)) / sum(n[2] for n in planes))


def in_groove(job, rolls, corners):
    """Place bodies along a groove that are turned by rolls (n,), a little above both planes."""
    planes = [body.normal[1:] for body in job.scene.half_spaces]
    reach = 0.002 + np.array(_reaches(job, rolls, corners))
    at = np.linalg.solve(np.array(planes), reach).T
    turned = Rotation.from_euler('x', rolls[:, None]) * Rotation.from_quat(job.axes)
    return Placed(job, np.column_stack([0 * rolls, at]), turned.as_quat())


def _reaches(job, rolls, corners):
    """Return how far a cross-section that is turned by rolls reaches into each plane, (n,)."""
    c, s = np.cos(rolls)[:, None], np.sin(rolls)[:, None]
    y, z = c * corners[:, 0] - s * corners[:, 1], s * corners[:, 0] + c * corners[:, 1]
    return [-(p.normal[1] * y + p.normal[2] * z).min(axis=1) for p in job.scene.half_spaces]
