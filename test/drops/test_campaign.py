"""Campaigns: order and bounds of what is under way, and real worker processes."""

import dataclasses
import os
import re
import select
import signal
import subprocess
import sys
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children

import numpy as np
import pytest

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.campaign import (
    MOST_WORKERS,
    default_workers,
    make_pool,
    stop_pool,
    submit_drops,
)
from resting_aspects_ros.drops.engine import drop_chunk
from resting_aspects_ros.drops.job import make_job
from resting_aspects_ros.drops.release import CHUNK


class Recorder(Executor):
    """Keeps what is submitted; futures are finished by the test."""

    def __init__(self):
        self.asked = []
        self.futures = []

    def submit(self, fn, /, *args, **kwargs):
        assert (fn, kwargs) == (drop_chunk, {})
        self.asked.append(args)
        self.futures.append(Future())
        return self.futures[-1]


@pytest.fixture(scope='module')
def job(part, surfaces):
    return make_job(part('tetrahedron'), surfaces.get(), seed=5)


@pytest.fixture(scope='module')
def pool():
    with make_pool(2) as pool:
        yield pool


def assert_same(a, b):
    for field in dataclasses.fields(RestingPoses):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


@pytest.mark.parametrize(
    ('first', 'drops', 'chunks'),
    [
        (0, 1, [(0, 1)]),
        (0, CHUNK, [(0, CHUNK)]),
        (0, CHUNK + 1, [(0, CHUNK), (CHUNK, CHUNK + 1)]),
        (CHUNK - 2, 4, [(CHUNK - 2, CHUNK), (CHUNK, CHUNK + 2)]),
        (7, 3, [(7, 10)]),
        (0, 0, []),
        (
            2**64 - 1 - CHUNK,
            CHUNK,
            [(2**64 - 1 - CHUNK, (a := 2**64 // CHUNK * CHUNK)), (a, 2**64 - 1)],
        ),
    ],
)
def test_drops_are_cut_at_the_chunks_of_the_engine(first, drops, chunks):
    executor = Recorder()
    futures = list(submit_drops('job', first, drops, executor, 2))
    assert executor.asked == [('job', low, high) for low, high in chunks]
    assert futures == executor.futures


@pytest.mark.parametrize('lookahead', [1, 2, 5])
def test_no_more_than_the_lookahead_are_under_way(lookahead):
    executor = Recorder()
    chunks = submit_drops('job', 0, 10 * CHUNK, executor, lookahead)
    assert executor.asked == []  # nothing before the first is asked for
    for taken, future in enumerate(chunks, start=1):
        # Handed over in order, not by which is done first.
        assert future is executor.futures[taken - 1]
        assert len(executor.futures) == min(10, taken - 1 + lookahead)
    assert len(executor.futures) == 10


def test_without_a_lookahead_nothing_could_be_done():
    with pytest.raises(ValueError, match=r'^lookahead is 0, allowed is 1 or more$'):
        next(submit_drops('job', 0, 1, Recorder(), 0))


def test_closing_cancels_what_has_not_begun_and_nothing_else():
    executor = Recorder()
    chunks = submit_drops('job', 0, 10 * CHUNK, executor, 4)
    next(chunks)
    executor.futures[1].set_running_or_notify_cancel()
    chunks.close()
    assert [f.cancelled() for f in executor.futures] == [False, False, True, True]
    assert len(executor.asked) == 4


def test_a_mistake_in_a_worker_reaches_the_one_who_waits(pool):
    # Not of one chunk: the engine refuses it, in the worker.
    with pytest.raises(ValueError, match=rf'^drops 0 to {CHUNK} are not of one chunk of {CHUNK}$'):
        pool.submit(drop_chunk, None, 0, CHUNK + 1).result()


def test_poses_are_the_same_bit_for_bit_whatever_makes_them(job, pool):
    # The last chunk is not full; the first does not begin at its first slot.
    first, drops = CHUNK - 30, 30 + 20
    here = RestingPoses.join(
        [drop_chunk(job, first, CHUNK), drop_chunk(job, CHUNK, first + drops)]
    )
    assert (here.first_drop, len(here)) == (first, drops)
    with make_pool(1) as one, ThreadPoolExecutor(2) as threads:
        for executor in (pool, one, threads):
            chunks = submit_drops(job, first, drops, executor, 3)
            assert_same(RestingPoses.join([f.result() for f in chunks]), here)


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


def test_ctrl_c_does_not_end_a_worker_while_it_starts_nor_while_it_drops(job):
    mine = {child.pid for child in active_children()}
    with make_pool(1) as pool:
        starting = pool.submit(drop_chunk, job, 0, 3)
        (worker,) = [child for child in active_children() if child.pid not in mine]
        os.kill(worker.pid, signal.SIGINT)
        first = starting.result()
        running = pool.submit(drop_chunk, job, 0, 3)
        os.kill(worker.pid, signal.SIGINT)
        assert_same(running.result(), first)
        assert worker.is_alive()


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


def parent(*, then):
    """Start a process that drops with two workers, tells their ids, and goes on as it is told."""
    script = f"""
import sys
from multiprocessing import active_children
from pathlib import Path
from resting_aspects_ros.drops.campaign import make_pool, submit_drops
from resting_aspects_ros.drops.job import make_job
from resting_aspects_ros.drops.part_library import PartLibrary
from resting_aspects_ros.drops.surfaces import Surfaces

def main():
    config = Path(sys.argv[1])
    part = PartLibrary(config / 'parts').load('tetrahedron')
    job = make_job(part, Surfaces.read(config / 'surfaces.yaml').get(), 1)
    with make_pool(2) as pool:
        futures = list(submit_drops(job, 120, 10, pool, 2))
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
