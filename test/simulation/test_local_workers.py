"""The workers of this machine: threads for the kernel, and processes for Bullet."""

import os
import re
from concurrent.futures import CancelledError

import pytest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.job import BULLET, KERNEL, make_job
from resting_aspects_ros.simulation.workers import (
    MAX_WORKERS,
    LocalWorkers,
    default_workers,
    drop_range,
    submit_drops,
)
from resting_aspects_ros.statistics.poses import RestingPoses


@pytest.fixture
def make_workers():
    """Make workers that are stopped at the end of the test."""
    made = []

    def make(count):
        made.append(LocalWorkers(count))
        return made[-1]

    yield make
    for workers in made:
        workers.stop()


@pytest.fixture(scope='module')
def job_of(part, surfaces):
    return lambda engine: make_job(part('l_bracket'), surfaces.get(), 5, engine=engine)


@pytest.mark.parametrize('workers', [0, -1, MAX_WORKERS + 1])
def test_number_of_workers_out_of_bounds_is_refused(workers):
    expected = f'invalid workers {workers}: expected 1 to {MAX_WORKERS}'
    with pytest.raises(InvalidValueError, match=f'^{re.escape(expected)}$'):
        LocalWorkers(workers)


def test_default_is_a_worker_per_allowed_core():
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert default_workers() == 1
    finally:
        os.sched_setaffinity(0, allowed)


@pytest.mark.parametrize(
    ('engine', 'count'),
    [(KERNEL, 1), (KERNEL, 7), (BULLET, 2)],
)
def test_poses_do_not_depend_on_the_workers(
    job_of, make_workers, assert_same_poses, engine, count
):
    # Neither the first chunk nor the last is a whole one.
    job = job_of(engine)
    first, drops = job.chunk - 30, 30 + 20 + (8 * job.chunk if engine == KERNEL else 0)
    workers = make_workers(count)
    chunks = [f.result() for f in submit_drops(job, first, drops, workers)]
    assert len(chunks) > count or engine == BULLET
    assert_same_poses(RestingPoses.join(chunks), drop_range(job, first, first + drops))


def test_runs_of_both_engines_share_the_workers(job_of, make_workers, assert_same_poses):
    workers = make_workers(2)
    asked = [(job_of(engine), k, k + 3) for k in (0, 40) for engine in (KERNEL, BULLET)]
    futures = [workers.submit(*each) for each in asked]
    for future, each in zip(futures, asked, strict=True):
        assert_same_poses(future.result(), drop_range(*each))


def test_error_in_a_thread_reaches_the_caller(job_of, make_workers):
    workers = make_workers(1)
    with pytest.raises(ValueError, match=r'^invalid drops 5 to 4: expected one or more from 0$'):
        workers.submit(job_of(KERNEL), 5, 5).result()
    assert len(workers.submit(job_of(KERNEL), 0, 1).result()) == 1


def test_stopping_discards_chunks_that_were_not_started(job_of, make_workers):
    workers, job = make_workers(1), job_of(KERNEL)
    futures = [workers.submit(job, 0, 5000) for _ in range(10)]
    workers.stop()
    # The thread may have finished a few of them.
    with pytest.raises(CancelledError):
        futures[-1].result()
    assert all(future.done() for future in futures)
