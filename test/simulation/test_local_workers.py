"""The workers of this machine: threads for the kernel, and processes for Bullet."""

import os
import select
import signal
import subprocess
import sys
import threading
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from pathlib import Path

import pytest
import trimesh

from resting_aspects_ros.errors import EngineError, InvalidValueError
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import CHUNKS, make_job, plan_run
from resting_aspects_ros.simulation.workers import (
    MAX_WORKERS,
    LocalWorkers,
    WorkerDiedError,
    call_each,
    drop_chunks,
    drop_range,
    submit_drops,
)
from resting_aspects_ros.statistics.poses import RestingPoses

DEADLINE = 600.0  # s; finds what hangs


@pytest.fixture
def make_workers():
    """Make workers that are stopped at the end of the test."""
    made = []

    def make(count):
        made.append(LocalWorkers(count))
        return made[-1]

    yield make
    for workers in made:
        stop(workers)


def stop(workers):
    """Stop workers; fails if that hangs."""
    thread = threading.Thread(target=workers.stop, daemon=True)
    thread.start()
    thread.join(DEADLINE)
    assert not thread.is_alive()


@pytest.fixture(scope='module')
def job_of(part, surfaces):
    return lambda engine: make_job(part('l_bracket'), surfaces.get(), 5, engine=engine)


@pytest.mark.parametrize('workers', [0, MAX_WORKERS + 1])
def test_number_of_workers_out_of_bounds_is_refused(workers):
    with pytest.raises(InvalidValueError, match=f'invalid workers {workers}: expected 1 to 1024'):
        LocalWorkers(workers)


def test_poses_do_not_depend_on_the_threads(job_of, make_workers, assert_same_poses):
    # Neither the first chunk nor the last is a whole one.
    job, size = job_of(KERNEL), CHUNKS[KERNEL]
    first, drops = size - 30, 8 * size + 50
    chunks = [f.result() for f in submit_drops(job, first, drops, make_workers(7))]
    assert len(chunks) > 7
    assert_same_poses(RestingPoses.join(chunks), drop_range(job, first, first + drops))


# -- Real worker processes, which make drops in Bullet: how they start, end, and are replaced -----


FIRST = CHUNKS[BULLET] - 15


@pytest.fixture(scope='module')
def planned(surfaces, solid):
    """The job and the description of a run of two short chunks.

    The job is larger than what a connection holds: one once blocked the end of a run for ever.
    """
    return plan_run(
        solid(trimesh.creation.cylinder(radius=10, height=4, sections=130)),
        surfaces.get(),
        seed=5,
        drops=30,
        first_drop=FIRST,
        run_id='',
        started=0,
        engine=BULLET,
    )


def children(parent=None):
    """The ids of the processes that this one, or another, has started."""
    parent = os.getpid() if parent is None else parent
    found = set()
    for stat in Path('/proc').glob('[0-9]*/stat'):
        with suppress(FileNotFoundError, ProcessLookupError):
            if int(stat.read_text().rpartition(')')[2].split()[1]) == parent:
                found.add(int(stat.parent.name))
    return found


def ended(pid):
    """Wait for the end of a process that another one reaps."""
    with suppress(ProcessLookupError):
        end = os.pidfd_open(pid)
        try:
            # It can be read when the process has ended.
            assert select.select([end], [], [], DEADLINE)[0] == [end]
        finally:
            os.close(end)


@pytest.mark.slow
def test_an_error_in_a_process_states_where(make_workers):
    with pytest.raises(EngineError, match=r'at x: .*invalid literal'):
        call_each(make_workers(1), int, [('1',), ('x',)], 'at x', print)


@pytest.mark.slow
def test_stuck_workers_are_stopped(planned, make_workers):
    # A thread waits to send the job, which is more than the connection holds if it is large.
    workers = make_workers(1)
    worker = workers.call(os.getpid).result()
    os.kill(worker, signal.SIGSTOP)
    futures = [workers.submit(planned[0], 0, 30) for _ in range(4)]
    stop(workers)
    for future in futures:
        with pytest.raises((CancelledError, WorkerDiedError)):
            future.result(timeout=DEADLINE)
    assert worker not in children()


@pytest.mark.slow
def test_runs_are_complete_when_workers_are_killed(planned, make_workers, assert_same_poses, wait):
    """An idle one, of which the run hears nothing, and the one that replaces it."""
    job, asked = planned
    before = children()
    workers = make_workers(2)
    for started in [workers.call(os.getpid) for _ in range(2)]:
        started.result()
    first = children() - before
    assert len(first) == 2
    idle = min(first)
    os.kill(idle, signal.SIGKILL)
    ended(idle)
    run = drop_chunks(job, asked, workers)
    next(run)  # its drops are running
    (new,) = wait(lambda: children() - before - first, 'a process instead of that')
    os.kill(new, signal.SIGKILL)
    poses = [step for step in run if not isinstance(step, Future)]
    assert_same_poses(RestingPoses.join(poses), drop_range(job, FIRST, FIRST + 30))
    assert workers.replaced == 2


PARENT = """
import sys
import resting_aspects_ros as ra
from resting_aspects_ros.simulation.conditions import all_surfaces
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import LocalWorkers

# At the top of the script: workers do not run it again.
job = make_job(ra.load_part('tetrahedron'), all_surfaces().get(), 1, engine='bullet')
workers = LocalWorkers(1)
drops = len(workers.submit(job, 0, 10).result())
pending = workers.submit(job, 0, 125)
print(drops, flush=True)
"""


def parent(then):
    """Start a process that drops with a worker, and then runs the given code."""
    return subprocess.Popen(
        [sys.executable, '-c', PARENT + then],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_a_script_ends_and_its_workers_print_nothing():
    with parent(then='') as process:
        out, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, out, errors) == (0, '10\n', '')


@pytest.mark.slow
def test_workers_end_when_their_parent_is_killed():
    with parent(then='sys.stdin.read()') as process:
        assert process.stdout.readline() == '10\n'
        (worker,) = children(process.pid)
        process.kill()
        ended(worker)
