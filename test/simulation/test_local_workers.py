"""The workers of this machine: threads for the kernel, and processes for Bullet."""

import os
import re
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
from resting_aspects_ros.simulation import workers as process_workers
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


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('engine', 'count'),
    [(KERNEL, 1), (KERNEL, 7), (BULLET, 2)],
)
def test_poses_do_not_depend_on_the_workers(
    job_of, make_workers, assert_same_poses, engine, count
):
    # Neither the first chunk nor the last is a whole one.
    job, size = job_of(engine), CHUNKS[engine]
    first, drops = size - 30, 30 + 20 + (8 * size if engine == KERNEL else 0)
    workers = make_workers(count)
    chunks = [f.result() for f in submit_drops(job, first, drops, workers)]
    assert len(chunks) > count or engine == BULLET
    assert_same_poses(RestingPoses.join(chunks), drop_range(job, first, first + drops))


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


# -- Real worker processes, which make drops in Bullet: how they start, end, and are replaced -----


CHUNK = CHUNKS[BULLET]
DEADLINE = 600.0  # s; finds what hangs
FIRST = CHUNK - 15


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


@pytest.fixture(scope='module')
def job(part, surfaces):
    return make_job(part('tetrahedron'), surfaces.get(), 5, engine=BULLET)


@pytest.fixture
def make_processes(job):
    """Make workers, which have started their processes, and are stopped at the end of the test."""
    made = []

    def make(count):
        made.append(LocalWorkers(count))
        for future in [made[-1].submit(job, 0, 1) for _ in range(count)]:
            future.result()
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


def children(parent=None):
    """The ids of the processes that this one, or another, has started."""
    parent = os.getpid() if parent is None else parent
    found = set()
    for stat in Path('/proc').glob('[0-9]*/stat'):
        with suppress(FileNotFoundError, ProcessLookupError):
            if int(stat.read_text().rpartition(')')[2].split()[1]) == parent:
                found.add(int(stat.parent.name))
    return found


def processes(count, *, besides):
    """The ids of the worker processes, as many as there must be."""
    found = children() - besides
    assert len(found) == count
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
def test_calls_are_repeated_if_their_worker_dies(make_processes, tmp_path):
    # The first call with each file makes it, and ends its process.
    once = 'import os\nif not os.path.exists({0!r}):\n open({0!r}, "w")\n os._exit(1)'
    programs = [(once.format(str(tmp_path / name)),) for name in ('a', 'b')]
    done = []
    assert call_each(make_processes(2), exec, programs, '', done.append) == [None, None]
    assert done[-1] == 2
    with pytest.raises(EngineError, match=r'at x: .*invalid literal'):
        call_each(make_processes(1), int, [('1',), ('x',)], 'at x', done.append)


@pytest.mark.slow
def test_error_in_a_worker_reaches_the_caller(job, make_processes):
    workers = make_processes(1)
    with pytest.raises(ValueError, match='counter must be positive'):
        workers.submit(job, -1, 1).result()
    assert len(workers.submit(job, 0, 1).result()) == 1  # and the worker goes on


@pytest.mark.slow
def test_signals_for_the_parent_do_not_end_a_worker(job, make_processes, assert_same_poses):
    number, before = signal.SIGINT, children()
    workers = make_processes(1)
    (worker,) = processes(1, besides=before)
    starting = workers.submit(job, 0, 3)
    os.kill(worker, number)
    first = starting.result()
    running = workers.submit(job, 0, 3)
    os.kill(worker, number)
    assert_same_poses(running.result(), first)
    # They are held off while a worker is started, and not after that.
    assert number not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.slow
def test_stuck_workers_are_stopped(planned, make_processes):
    # A thread waits to send the job, which is more than the connection holds if it is large.
    job, _ = planned
    before = children()
    workers = make_processes(2)
    for worker in processes(2, besides=before):
        os.kill(worker, signal.SIGSTOP)
    futures = [workers.submit(job, 0, CHUNK) for _ in range(8)]
    stop(workers)
    for future in futures:
        with pytest.raises((CancelledError, WorkerDiedError)):
            future.result(timeout=DEADLINE)
    processes(0, besides=before)


@pytest.mark.slow
def test_runs_are_complete_when_workers_are_killed(
    planned, make_processes, assert_same_poses, wait
):
    """Idle ones, of which a run hears nothing, and those that work."""
    job, asked = planned
    here = drop_range(job, FIRST, FIRST + 30)
    before = children()
    workers = make_processes(2)
    for worker in processes(2, besides=before):
        os.kill(worker, signal.SIGKILL)
        ended(worker)
    warnings = []
    runs = [drop_chunks(job, asked, workers, warnings.append) for _ in range(2)]
    for run in runs:
        next(run)  # its drops are running
    wait(lambda: len(children() - before) == 2, 'two processes instead of those')
    assert warnings == []
    for worker in processes(2, besides=before):
        os.kill(worker, signal.SIGKILL)
    for run in runs:
        poses = [step for step in run if not isinstance(step, Future)]
        assert_same_poses(RestingPoses.join(poses), here)
    assert 1 <= len(warnings) <= 2
    assert {each.partition(' near')[0] for each in warnings} == {'a worker died'}
    processes(2, besides=before)
    assert workers.replaced == 4


def test_failure_to_start_a_process_is_an_error(job, monkeypatch):
    def popen(*_, **__):
        raise BlockingIOError(11, 'Resource temporarily unavailable')

    monkeypatch.setattr(process_workers, 'Popen', popen)
    workers = LocalWorkers(2)
    expected = '^cannot start a worker process: Resource temporarily unavailable$'
    with pytest.raises(EngineError, match=expected):
        workers.submit(job, 0, 1).result()
    stop(workers)


PARENT = """
import sys
import resting_aspects_ros as ra
from resting_aspects_ros.simulation.conditions import all_surfaces
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import LocalWorkers, submit_drops

# At the top of the script: workers do not run it again.
job = make_job(ra.load_part('tetrahedron'), all_surfaces().get(), 1, engine='bullet')
workers = LocalWorkers(2)
drops = sum(len(f.result()) for f in submit_drops(job, 120, 10, workers))
pending = workers.submit(job, 0, 125)
print(drops, flush=True)
"""


def parent(then):
    """Start a process that drops with two workers, and then runs the given code."""
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
        workers = children(process.pid)
        assert len(workers) == 2
        process.kill()
        for worker in workers:
            ended(worker)
