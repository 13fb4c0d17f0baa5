"""Bodies that are placed in surroundings, for comparisons with mechanics."""

import placed_bodies
import pytest


@pytest.fixture(scope='session')
def mat(surfaces):
    return surfaces.get('rubber_mat').changed(restitution=0.0, rolling_friction=0.0)


@pytest.fixture(scope='session')
def job_in(mat):
    """Make the job of a part in a kind of surroundings, without bounces."""

    def make(part, kind, bodies=None, release=None, engine='', **changes):
        conditions = mat.changed(**changes)
        return placed_bodies.job_in(part, conditions, kind, bodies, release, engine=engine)

    return make
