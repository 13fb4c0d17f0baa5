"""Drops of example parts, for the tests of the engine."""

import pytest

from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.bullet_engine import drop_chunk
from resting_aspects_ros.simulation.initial_state import CHUNK
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
            chunks = [drop_chunk(job, k, min(k + CHUNK, n)) for k in range(0, n, CHUNK)]
            known[key] = RestingPoses.join(chunks)
        return known[key]

    return make
