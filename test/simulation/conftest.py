"""Drops of example parts, for the tests of the engine."""

import pytest

from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.plan import make_job


@pytest.fixture(scope='module')
def mat(surfaces):
    return surfaces.get('rubber_mat')


@pytest.fixture(scope='module')
def drop(mat):
    """Drop a part, the first n times on the rubber mat with changes; equal questions once."""
    known = {}

    def make(part, n, seed=1, **changes):
        key = (part.part_sha256, n, seed, *sorted(changes.items()))
        if key not in known:
            job = make_job(part, mat.changed(**changes), seed)
            known[key] = drop_range(job, 0, n)
        return known[key]

    return make
