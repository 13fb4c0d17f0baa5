"""Bodies that are placed in surroundings, for comparisons with mechanics."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.bullet_engine import drop_chunk
from resting_aspects_ros.simulation.bullet_scene import SceneWorld
from resting_aspects_ros.simulation.initial_state import CHUNK, InitialState
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.release import depth_along
from resting_aspects_ros.simulation.surroundings.scene_settling import SceneSettling

# Distance, R, at which Bullet lets a hull rest.
MARGIN = 0.001


class Placed:
    """Bodies in the surroundings of a job, from given states: scene frame, R and T."""

    def __init__(self, job, position, orientation, velocity=(0, 0, 0)):
        shape = (len(position), 3)
        self.frame = job.frame_velocity
        self.job, self.world = job, SceneWorld(job, job.scene)
        start = InitialState(
            np.array(position, dtype=float),
            np.array(orientation, dtype=float),
            np.array(np.broadcast_to(velocity, shape) - self.frame),
            np.zeros(shape),
            elapsed=np.zeros(len(position)),
        )
        self.slots = np.arange(len(position))
        self.origins = self.world._origins(self.slots)
        self.bodies = self.world._add(start, self.slots, self.origins)
        self.settling = SceneSettling(job, start, self.slots)

    def step(self, time):
        self.world._advance(0, round(time * self.job.steps_per_t))
        return self.states

    def settle(self):
        """Step until all have ended; returns their statuses."""
        self.world._settled(self.bodies, self.origins, self.settling)
        return self.settling.status

    @property
    def states(self):
        found = self.world._states(self.bodies, self.origins, self.slots)
        return dataclasses.replace(found, velocity=found.velocity + self.frame)


@pytest.fixture(scope='session')
def mat(surfaces):
    return surfaces.get('rubber_mat').changed(restitution=0.0, rolling_friction=0.0)


@pytest.fixture(scope='session')
def job_in(mat):
    """Make the job of a part in a kind of surroundings, without bounces."""

    def make(part, kind, bodies=None, release=None, **changes):
        found = Surroundings(kind, bodies=bodies or {}, release=release or {})
        conditions = dataclasses.replace(mat.changed(**changes), surroundings=found.key)
        return make_job(part, conditions, 1)

    return make


@pytest.fixture(scope='session')
def flat_on():
    """Place bodies with their part frames turned by some angles about z on the plane z = 0."""

    def make(job, yaws, velocity=(0, 0, 0), x=0.0, y=0.0, lift=MARGIN):
        turned = Rotation.from_euler('z', np.reshape(yaws, (-1, 1)))
        orientation = (turned * Rotation.from_quat(job.axes)).as_quat()
        height = depth_along(orientation, np.array([0.0, 0.0, -1.0]), job.hull) + lift
        position = np.stack([0 * height + x, 0 * height + y, height], axis=1)
        return Placed(job, position, orientation, velocity)

    return make


@pytest.fixture(scope='session')
def drops():
    """Return the first drops of a job."""

    def make(job, n):
        return RestingPoses.join(
            [drop_chunk(job, k, min(k + CHUNK, n)) for k in range(0, n, CHUNK)]
        )

    return make
