"""Bodies that are placed in surroundings, for comparisons with mechanics."""

import placed_bodies
import pytest

from resting_aspects_ros.simulation.engine import drop_range


@pytest.fixture(scope='session')
def mat(surfaces):
    return surfaces.get('rubber_mat').changed(restitution=0.0, rolling_friction=0.0)


@pytest.fixture(scope='session')
def job_in(mat):
    """Make the job of a part in a kind of surroundings, without bounces."""

    def make(part, kind, bodies=None, release=None, refinement=1, **changes):
        conditions = mat.changed(**changes)
        return placed_bodies.job_in(part, conditions, kind, bodies, release, refinement=refinement)

    return make


@pytest.fixture(scope='session')
def flat_on():
    """Place bodies with their part frames turned by some angles about z on the plane z = 0."""
    return placed_bodies.flat_on


@pytest.fixture(scope='session')
def drops():
    """Return the first drops of a job."""

    def make(job, n):
        return drop_range(job, 0, n)

    return make
