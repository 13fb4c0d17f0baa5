"""A Dask cluster gives the same poses as this machine."""

import dataclasses
import math
import os
import signal
import socket
import sys
from concurrent.futures import Future

import pytest

from resting_aspects_ros.errors import EngineError, InvalidValueError
from resting_aspects_ros.simulation import workers as chunks
from resting_aspects_ros.simulation.conditions import KERNEL
from resting_aspects_ros.simulation.job import CHUNKS, plan_run
from resting_aspects_ros.simulation.workers import TIMEOUT, ClusterWorkers, drop_range
from resting_aspects_ros.statistics.poses import RestingPoses

CHUNK = CHUNKS[KERNEL]


@pytest.fixture(scope='module')
def planned(part, surfaces):
    """The job and the description of a run of a bit more than three chunks."""
    return plan_run(
        part('tetrahedron'), surfaces.get(), seed=5, drops=3 * CHUNK + 7, run_id='', started=0
    )


@pytest.fixture
def workers(cluster):
    workers = ClusterWorkers(cluster.scheduler_address)
    yield workers
    workers.stop()


def chunks_of(job, asked, workers):
    steps = chunks.drop_chunks(job, asked, workers)
    return [step for step in steps if not isinstance(step, Future)]


@pytest.mark.slow
def test_poses_are_bit_identical_to_local_ones(planned, workers, assert_same_poses):
    job, asked = planned
    there = chunks_of(job, asked, workers)
    assert len(there) == 4
    assert_same_poses(RestingPoses.join(there), drop_range(job, 0, asked.end))
    assert workers.call(math.hypot, 3, 4).result() == 5


@pytest.mark.slow
def test_chunk_that_kills_its_workers_is_an_error(cluster, planned, workers, monkeypatch):
    monkeypatch.setattr(cluster.scheduler, 'allowed_failures', 2)
    monkeypatch.setattr(chunks, '_drop', lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    job, asked = planned
    expected = r'^a worker failed near drop 0 of tetrahedron: KilledWorker'
    with pytest.raises(EngineError, match=expected):
        chunks_of(job, dataclasses.replace(asked, drops=1), workers)


@pytest.mark.slow
def test_worker_with_other_versions_is_rejected(planned, workers, monkeypatch):
    versions = chunks.worker_versions()
    assert versions.keys() == {'resting_aspects_ros', 'numba', 'pybullet', 'numpy'}
    monkeypatch.setattr(chunks, 'worker_versions', lambda: versions | {'numpy': '1.2.3'})
    with pytest.raises(EngineError, match=r'^invalid worker tcp://\S+: expected numpy 1\.2\.3'):
        chunks_of(*planned, workers)


@pytest.mark.slow
def test_lost_cluster_is_an_error(make_cluster, planned, monkeypatch):
    with make_cluster(1) as cluster:
        workers = ClusterWorkers(cluster.scheduler_address)
        steps = chunks.drop_chunks(*planned, workers)
        next(steps)
    try:
        with pytest.raises(EngineError, match='became unavailable near drop'):
            list(steps)
    finally:
        workers.stop()


@pytest.mark.slow
def test_address_without_a_scheduler_is_rejected(cluster):
    (worker, *_) = cluster.scheduler_info['workers']
    with socket.create_server(('127.0.0.1', 0)) as silent:
        for address, reason in (
            (worker, 'this is a worker'),
            (f'127.0.0.1:{silent.getsockname()[1]}', f'no answer within {TIMEOUT:g} s'),
            ('nonsense://127.0.0.1:1', 'unknown address'),
        ):
            with pytest.raises(InvalidValueError, match=f'address of a Dask scheduler; {reason}'):
                ClusterWorkers(address)


@pytest.mark.slow
def test_scheduler_without_workers_is_rejected(make_cluster):
    with make_cluster(0) as cluster, pytest.raises(InvalidValueError, match='has workers; none'):
        ClusterWorkers(cluster.scheduler_address)


def test_missing_dask_is_reported_with_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(InvalidValueError, match='needs Dask'):
        ClusterWorkers('there:1')
