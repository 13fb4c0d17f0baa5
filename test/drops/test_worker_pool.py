"""Real worker processes: how they start, end, and are replaced."""

import itertools
import os
import re
import select
import signal
import subprocess
import sys
import threading
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import active_children

import pytest

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.campaign import drop_chunks
from resting_aspects_ros.drops.engine import drop_chunk
from resting_aspects_ros.drops.plan import plan_run
from resting_aspects_ros.drops.release import CHUNK
from resting_aspects_ros.drops.worker_pool import (
    MOST_WORKERS,
    NICENESS,
    ProcessWorkers,
    default_workers,
    make_pool,
    stop_pool,
)

DEATH = 'a worker died near drop 0 of tetrahedron: its drops are made again'


@pytest.fixture(scope='module')
def planned(part, surfaces):
    """The job and the description of a run of three chunks."""
    return plan_run(
        part('tetrahedron'), surfaces.get(), seed=5, drops=3 * CHUNK, run_id='', started=0
    )


@pytest.fixture(scope='module')
def job(planned):
    return planned[0]


@pytest.fixture(scope='module')
def pool():
    with make_pool(2) as pool:
        yield pool


@pytest.fixture
def workers():
    workers = ProcessWorkers(2)
    yield workers
    workers.stop()


def kill_one(pool):
    """Kill a worker of a pool, and wait until the pool is broken."""
    next(iter(pool._processes.values())).kill()
    with suppress(BrokenProcessPool):
        while True:
            pool.submit(os.getpid).result(timeout=60)


def test_a_mistake_in_a_worker_reaches_the_one_who_waits(pool):
    # Not of one chunk: the engine refuses it, in the worker.
    with pytest.raises(ValueError, match=rf'^drops 0 to {CHUNK} are not of one chunk of {CHUNK}$'):
        pool.submit(drop_chunk, None, 0, CHUNK + 1).result()


@pytest.mark.parametrize('workers', [0, -1, MOST_WORKERS + 1])
def test_a_number_of_workers_out_of_bounds_is_refused_in_words(workers):
    words = f'workers is {workers}, allowed is 1 to {MOST_WORKERS}'
    with pytest.raises(InvalidValueError, match=f'^{re.escape(words)}$'):
        make_pool(workers)


def test_by_default_there_is_a_worker_for_each_core_that_may_be_used():
    allowed = os.sched_getaffinity(0)
    assert default_workers() <= os.cpu_count()
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert default_workers() == 1
    finally:
        os.sched_setaffinity(0, allowed)


def test_ctrl_c_does_not_end_a_worker_while_it_starts_nor_while_it_drops(job, assert_same_poses):
    mine = {child.pid for child in active_children()}
    with make_pool(1) as pool:
        starting = pool.submit(drop_chunk, job, 0, 3)
        (worker,) = [child for child in active_children() if child.pid not in mine]
        os.kill(worker.pid, signal.SIGINT)
        first = starting.result()
        running = pool.submit(drop_chunk, job, 0, 3)
        os.kill(worker.pid, signal.SIGINT)
        assert_same_poses(running.result(), first)
        assert worker.is_alive()


def test_workers_give_way_to_others(pool):
    assert pool.submit(os.nice, 0).result() == os.nice(0) + NICENESS


def test_ctrl_c_reaches_the_one_who_submits(job):
    # It is held off while a worker is begun, and not lost.
    with ThreadPoolExecutor(1) as threads, make_pool(1) as pool:
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
        pool.submit(os.getpid).result()
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
        # The same from another thread, as a node does it.
        assert threads.submit(lambda: pool.submit(os.getpid).result() > 0).result()


def test_a_pool_can_be_stopped_while_it_works_and_others_go_on(pool):
    assert pool.submit(os.getpid).result()
    mine = {child.pid for child in active_children()}
    stopped = make_pool(1)
    endless = [stopped.submit(signal.pause) for _ in range(5)]
    (worker,) = [child for child in active_children() if child.pid not in mine]
    end = os.pidfd_open(worker.pid)
    try:
        stop_pool(stopped)
        assert select.select([end], [], [], 60)[0] == [end]
    finally:
        os.close(end)
    with pytest.raises((CancelledError, BrokenProcessPool)):
        endless[-1].result(timeout=60)  # who waits for it hears of it
    assert pool.submit(os.getpid).result() in mine
    stop_pool(stopped)  # nothing is left to stop


def test_cancelled_work_keeps_no_other_waiting_when_a_worker_dies(monkeypatch):
    raised = []
    monkeypatch.setattr(threading, 'excepthook', raised.append)
    pool = make_pool(1)
    worker = pool.submit(os.getpid).result()
    futures = [pool.submit(signal.pause) for _ in range(9)]
    for future in futures[5::2]:
        assert future.cancel()
    os.kill(worker, signal.SIGKILL)
    for future in futures:
        with pytest.raises((CancelledError, BrokenProcessPool)):
            future.result(timeout=60)
    stop_pool(pool)
    assert raised == []


def test_a_pool_that_breaks_is_replaced_once_by_whoever_comes_first(workers):
    broken = workers.executor
    kill_one(broken)
    workers.replace(broken)
    new = workers.executor
    assert new is not broken
    assert new.submit(os.getpid).result() > 0
    workers.replace(broken)
    assert workers.executor is new
    assert workers.lookahead() == 2 * workers.count == 4


def test_runs_that_share_a_pool_lose_nothing_when_a_worker_is_killed(
    planned, workers, assert_same_poses
):
    job, asked = planned
    here = RestingPoses.join(
        [drop_chunk(job, first, first + CHUNK) for first in range(0, 3 * CHUNK, CHUNK)]
    )
    warnings = []
    runs = [drop_chunks(job, asked, workers, warnings.append) for _ in range(2)]
    for run in runs:
        next(run)  # its drops are under way
    kill_one(workers.executor)
    for run in runs:
        assert_same_poses(RestingPoses.join([s for s in run if not isinstance(s, Future)]), here)
    assert warnings == [DEATH] * 2


def test_a_worker_that_dies_while_it_is_begun_is_replaced(planned, workers, monkeypatch):
    job, asked = planned
    submit, calls = ProcessPoolExecutor.submit, itertools.count()

    def broken_pipe_first(*args):
        if next(calls) == 0:
            raise BrokenPipeError  # as multiprocessing does: what it tells the worker goes nowhere
        return submit(*args)

    monkeypatch.setattr(ProcessPoolExecutor, 'submit', broken_pipe_first)
    warnings = []
    steps = drop_chunks(job, asked, workers, warnings.append)
    poses = RestingPoses.join([step for step in steps if not isinstance(step, Future)])
    assert (len(poses), warnings) == (3 * CHUNK, [DEATH])


def parent(*, then):
    """Start a process that drops with two workers, tells their ids, and goes on as it is told."""
    script = f"""
import sys
from multiprocessing import active_children
from pathlib import Path
from resting_aspects_ros.drops.campaign import submit_drops
from resting_aspects_ros.drops.job import make_job
from resting_aspects_ros.drops.part_library import PartLibrary
from resting_aspects_ros.drops.surfaces import Surfaces
from resting_aspects_ros.drops.worker_pool import make_pool

def main():
    config = Path(sys.argv[1])
    part = PartLibrary(config / 'parts').load('tetrahedron')
    job = make_job(part, Surfaces.read(config / 'surfaces.yaml').get(), 1)
    with make_pool(2) as pool:
        futures = list(submit_drops(job, 120, 10, pool, lambda: 2))
        drops = sum(len(f.result()) for f in futures)
        print(drops, *(child.pid for child in active_children()), flush=True)
        {then}

if __name__ == '__main__':
    main()
"""
    config = os.fspath(__file__).rsplit('/test/', 1)[0] + '/config'
    return subprocess.Popen(
        [sys.executable, '-c', script, config],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_workers_write_nothing_to_the_standard_output_of_their_parent():
    with parent(then='pass') as process:
        out, _ = process.communicate()
    assert process.returncode == 0
    assert re.fullmatch(r'10 \d+ \d+\n', out)


def test_workers_end_when_their_parent_is_killed():
    with parent(then='sys.stdin.read()') as process:
        drops, *workers = process.stdout.readline().split()
        assert drops == '10'
        assert len(workers) == 2
        ends = [os.pidfd_open(int(pid)) for pid in workers]
        try:
            process.kill()
            process.wait()
            for end in ends:
                # A pidfd can be read when its process has ended.
                assert select.select([end], [], [], 60)[0] == [end]
        finally:
            for end in ends:
                os.close(end)
