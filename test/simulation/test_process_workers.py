"""Real worker processes, which make drops in Bullet: how they start, end, and are replaced."""

import dataclasses
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

from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation import workers as process_workers
from resting_aspects_ros.simulation.job import BULLET, CHUNKS, make_job, plan_run
from resting_aspects_ros.simulation.workers import (
    MAX_DEATHS,
    LocalWorkers,
    WorkerDiedError,
    drop_chunks,
    drop_range,
)
from resting_aspects_ros.statistics.poses import RestingPoses

CHUNK = CHUNKS[BULLET]
DEADLINE = 600.0  # s; finds what hangs
# What a pipe holds: a job of more than this once blocked the end of a run for ever.
PIPE = 64 * 1024
LARGE = 'solid'  # a part with such a job
FIRST = CHUNK - 15
DEATH = f'a worker died near drop {FIRST} of {{}}: its drops are repeated'


@pytest.fixture(scope='module', params=['tetrahedron', LARGE])
def planned(request, part, surfaces, solid):
    """The job and the description of a run of two short chunks, of a small and a large job."""
    shape = part('tetrahedron') if request.param == 'tetrahedron' else disc(solid)
    return plan_run(
        shape,
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
def make_workers(job):
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


def poses_of(steps):
    return RestingPoses.join([step for step in steps if not isinstance(step, Future)])


def dropped_here(job):
    return drop_range(job, FIRST, FIRST + 30)


def test_error_in_a_worker_reaches_the_caller(job, make_workers):
    workers = make_workers(1)
    with pytest.raises(ValueError, match='counter must be positive'):
        workers.submit(job, -1, 1).result()
    assert len(workers.submit(job, 0, 1).result()) == 1  # and the worker goes on


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_for_the_parent_do_not_end_a_worker(number, job, make_workers, assert_same_poses):
    before = children()
    workers = make_workers(1)
    (worker,) = processes(1, besides=before)
    starting = workers.submit(job, 0, 3)
    os.kill(worker, number)
    first = starting.result()
    running = workers.submit(job, 0, 3)
    os.kill(worker, number)
    assert_same_poses(running.result(), first)
    # They are held off while a worker is started, and not after that.
    assert number not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_processes_start_with_the_first_job_of_bullet(part, surfaces, job):
    before = children()
    workers = LocalWorkers(2)
    try:
        workers.submit(make_job(part('tetrahedron'), surfaces.get(), 5), 0, 600).result()
        processes(0, besides=before)
        workers.submit(job, 0, 3).result()
        processes(1, besides=before)
    finally:
        stop(workers)
    processes(0, besides=before)


@pytest.mark.quick_cases(1)
def test_jobs_take_turns(job, planned, make_workers, assert_same_poses):
    workers = make_workers(1)
    other = planned[0]
    for each in (job, other, other, job):
        assert_same_poses(workers.submit(each, 3, 9).result(), drop_range(each, 3, 9))


def test_workers_stop_while_they_work(planned, make_workers):
    job, _ = planned
    before = children()
    workers, others = make_workers(2), make_workers(1)
    futures = [workers.submit(job, 0, CHUNK) for _ in range(20)]
    stop(workers)
    for future in futures[-10:]:
        with pytest.raises((CancelledError, WorkerDiedError)):
            future.result(timeout=DEADLINE)
    processes(1, besides=before)
    assert len(others.submit(job, 0, 3).result()) == 3
    stop(workers)  # nothing is left to stop


@pytest.mark.parametrize('hold', [signal.SIGSTOP, signal.SIGKILL])
def test_stuck_workers_are_stopped(planned, make_workers, hold):
    # A thread waits to send the job, which is more than the connection holds if it is large.
    job, _ = planned
    before = children()
    workers = make_workers(2)
    for worker in processes(2, besides=before):
        os.kill(worker, hold)
    futures = [workers.submit(job, 0, CHUNK) for _ in range(8)]
    stop(workers)
    for future in futures:
        with pytest.raises((CancelledError, WorkerDiedError)):
            future.result(timeout=DEADLINE)
    processes(0, besides=before)


@pytest.mark.quick_cases(1)
def test_runs_are_complete_when_workers_are_killed(planned, make_workers, assert_same_poses):
    job, asked = planned
    here = dropped_here(job)
    before = children()
    workers = make_workers(2)
    warnings = []
    runs = [drop_chunks(job, asked, workers, warnings.append) for _ in range(2)]
    for run in runs:
        next(run)  # its drops are running
    for worker in processes(2, besides=before):
        os.kill(worker, signal.SIGKILL)
    for run in runs:
        assert_same_poses(poses_of(run), here)
    assert 1 <= len(warnings) <= 2
    assert {re.sub(r'drop \d+', f'drop {FIRST}', each) for each in warnings} == {
        DEATH.format(asked.part)
    }
    processes(2, besides=before)
    assert workers.lookahead() == 2 * workers.count == 4


@pytest.mark.quick_cases(1)
def test_idle_workers_that_died_do_not_end_a_run(planned, make_workers, assert_same_poses):
    job, asked = planned
    before = children()
    workers = make_workers(MAX_DEATHS + 1)
    for worker in processes(MAX_DEATHS + 1, besides=before):
        os.kill(worker, signal.SIGKILL)
        ended(worker)
    short = dataclasses.replace(asked, drops=CHUNK - FIRST)  # one chunk at a time
    poses = poses_of(drop_chunks(job, short, workers, pytest.fail))
    assert_same_poses(poses, drop_range(job, FIRST, CHUNK))
    processes(1, besides=before)
    assert workers.replaced == MAX_DEATHS + 1


def test_run_ends_after_repeated_deaths_and_keeps_its_chunks(
    planned, make_workers, assert_same_poses, wait
):
    # As by drops of one chunk that always end the process that simulates them.
    job, asked = planned
    asked = dataclasses.replace(asked, first_drop=0, drops=2 * CHUNK)
    before = children()
    workers = make_workers(1)
    steps = drop_chunks(job, asked, workers, lambda _: None)
    kept = [step for step in (next(steps), next(steps)) if not isinstance(step, Future)]
    for _ in range(MAX_DEATHS):
        assert isinstance(next(steps), Future)
        started = wait(lambda: children() - before, 'a process for the repeated chunk')
        os.kill(*started, signal.SIGKILL)
    with pytest.raises(EngineError, match=f'^{MAX_DEATHS} worker processes died in a row'):
        next(steps)
    assert workers.replaced == MAX_DEATHS
    assert_same_poses(*kept, drop_range(job, 0, CHUNK))
    assert len(workers.submit(job, 0, 3).result()) == 3


def test_failure_to_start_a_process_is_an_error(job, monkeypatch):
    def popen(*_, **__):
        raise BlockingIOError(11, 'Resource temporarily unavailable')

    monkeypatch.setattr(process_workers, 'Popen', popen)
    workers = LocalWorkers(2)
    expected = '^cannot start a worker process: Resource temporarily unavailable$'
    with pytest.raises(EngineError, match=expected):
        workers.submit(job, 0, 1).result()
    stop(workers)


def disc(solid):
    """A part with 260 corners."""
    import trimesh

    return solid(trimesh.creation.cylinder(radius=10, height=4, sections=130))


PARENT = """
import sys
from pathlib import Path
from resting_aspects_ros.simulation.workers import submit_drops
from resting_aspects_ros.simulation.workers import LocalWorkers
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.conditions import Surfaces

# At the top of the script: workers do not run it again.
config = Path(sys.argv[1])
part = PartLibrary(config / 'parts').load('tetrahedron')
job = make_job(part, Surfaces.read(config / 'surfaces.yaml').get(), 1, engine='bullet')
workers = LocalWorkers(2)
drops = sum(len(f.result()) for f in submit_drops(job, 120, 10, workers))
pending = workers.submit(job, 0, 125)
print(drops, flush=True)
"""


def parent(then, *flags):
    """Start a process that drops with two workers, and then runs the given code."""
    config = Path(__file__).resolve().parents[2] / 'config'
    return subprocess.Popen(
        [sys.executable, *flags, '-c', PARENT + then, config],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_workers_print_nothing_and_a_script_without_a_stop_ends():
    with parent(then='') as process:
        out, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, out, errors) == (0, '10\n', '')


def test_stopped_workers_leave_no_resources_behind():
    with parent('workers.stop()', '-W', 'error') as process:
        out, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, out, errors) == (0, '10\n', '')


def test_workers_end_when_their_parent_is_killed():
    with parent(then='sys.stdin.read()') as process:
        assert process.stdout.readline() == '10\n'
        workers = children(process.pid)
        assert len(workers) == 2
        process.kill()
        for worker in workers:
            ended(worker)
