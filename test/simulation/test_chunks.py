"""Chunks: order, number of pending chunks, and workers that die."""

import dataclasses
from concurrent.futures import BrokenExecutor, CancelledError, Future
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.chunks import MAX_DEATHS, drop_chunks, submit_drops
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.plan import make_job, plan_run
from resting_aspects_ros.simulation.process_workers import ProcessWorkers


class Recorder:
    """Workers that keep what is submitted; futures are finished by the test."""

    def __init__(self, lookahead):
        self.lookahead = lookahead
        self.asked = []
        self.futures = []

    def submit(self, *task):
        self.asked.append(task)
        self.futures.append(Future())
        return self.futures[-1]


class Mortal:
    """Workers whose chunks end as specified beforehand.

    ends : list
        Of each chunk that is taken in turn: None, or what is raised; all others are dropped.
    """

    def __init__(self, *ends):
        self.ends = list(ends)
        self.asked = []

    def submit(self, job, first, stop):
        end = self.ends.pop(0) if self.ends else None
        if isinstance(end, BrokenOnSubmit):
            raise end
        self.asked.append(first)
        future = Future()
        if end is None:
            future.set_result(some_poses(first, stop))
        elif isinstance(end, CancelledError):
            future.cancel()
        else:
            future.set_exception(end)
        return future

    def result(self, future):
        return future.result()

    def lookahead(self):
        return 1

    def deaths(self, error):
        return getattr(error, 'deaths', int(isinstance(error, BrokenExecutor)))


class BrokenOnSubmit(BrokenExecutor):
    """As a pool does, whose worker died while it had nothing to do."""


class ManyDeathsError(Exception):
    deaths = MAX_DEATHS + 1


DEATH = BrokenExecutor('a child process terminated abruptly')


def some_poses(first, stop):
    empty = RestingPoses.none(first)
    arrays = [getattr(empty, field.name) for field in dataclasses.fields(RestingPoses)[1:]]
    return RestingPoses(first, *(np.zeros((stop - first, *a.shape[1:]), a.dtype) for a in arrays))


@pytest.fixture
def campaign(part, surfaces):
    """Drop three chunks and a bit with workers; gives the chunks and what was warned of."""
    _, asked = plan_run(
        part('tetrahedron'),
        surfaces.get(),
        seed=5,
        drops=3 * CHUNK,
        first_drop=10,
        run_id='',
        started=0,
    )

    def drop(workers):
        warnings = []
        steps = drop_chunks('job', asked, workers, warnings.append)
        chunks = []
        try:
            for step in steps:
                if isinstance(step, Future):
                    assert step.done()
                else:
                    chunks.append(step)
        except EngineError as error:
            return chunks, warnings, str(error)
        assert RestingPoses.join(chunks).end == asked.end
        return chunks, warnings, None

    return drop


@contextmanager
def closing_workers(count):
    workers = ProcessWorkers(count)
    try:
        yield workers
    finally:
        workers.stop()


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
def test_drops_are_split_at_chunk_boundaries(first, drops, chunks):
    workers = Recorder(lambda: 2)
    futures = list(submit_drops('job', first, drops, workers))
    assert workers.asked == [('job', low, high) for low, high in chunks]
    assert futures == workers.futures


@pytest.mark.parametrize('lookahead', [1, 2, 5])
def test_at_most_lookahead_chunks_are_pending(lookahead):
    workers = Recorder(lambda: lookahead)
    chunks = submit_drops('job', 0, 10 * CHUNK, workers)
    assert workers.asked == []  # nothing before the first is asked for
    for taken, future in enumerate(chunks, start=1):
        # Handed over in order, not by which is done first.
        assert future is workers.futures[taken - 1]
        assert len(workers.futures) == min(10, taken - 1 + lookahead)
    assert len(workers.futures) == 10


def test_closing_cancels_only_chunks_not_started():
    workers = Recorder(lambda: 4)
    chunks = submit_drops('job', 0, 10 * CHUNK, workers)
    next(chunks)
    workers.futures[1].set_running_or_notify_cancel()
    chunks.close()
    assert [f.cancelled() for f in workers.futures] == [False, False, True, True]
    assert len(workers.asked) == 4


def test_the_lookahead_may_grow_and_shrink():
    lookahead = [1]
    workers = Recorder(lambda: lookahead[0])
    under_way = []
    chunks = submit_drops('job', 0, 6 * CHUNK, workers)
    for taken, _ in enumerate(chunks):
        under_way.append(len(workers.futures) - taken)
        lookahead[0] = [3, 2, 2, 2, 2, 2][taken]
    assert under_way == [1, 3, 2, 2, 2, 1]


@pytest.mark.parametrize('count', [1, 2])
def test_poses_do_not_depend_on_the_workers(count, part, surfaces, assert_same_poses):
    job = make_job(part('tetrahedron'), surfaces.get(), seed=5)
    # The last chunk is not full; the first does not begin at its first slot.
    first, drops = CHUNK - 30, 30 + 20
    here = RestingPoses.join(
        [drop_range(job, first, CHUNK), drop_range(job, CHUNK, first + drops)]
    )
    assert (here.first_drop, len(here)) == (first, drops)
    with closing_workers(count) as workers:
        chunks = submit_drops(job, first, drops, workers)
        assert_same_poses(RestingPoses.join([f.result() for f in chunks]), here)


def test_chunks_are_ordered_and_follow_their_futures(campaign):
    workers = Mortal()
    chunks, warnings, error = campaign(workers)
    assert [chunk.first_drop for chunk in chunks] == [10, CHUNK, 2 * CHUNK, 3 * CHUNK]
    assert workers.asked == [10, CHUNK, 2 * CHUNK, 3 * CHUNK]
    assert (warnings, error) == ([], None)


@pytest.mark.parametrize('death', [DEATH, BrokenOnSubmit()], ids=['result', 'submit'])
def test_chunks_of_dead_workers_are_repeated(campaign, death):
    workers = Mortal(None, death)
    chunks, warnings, error = campaign(workers)
    assert [chunk.first_drop for chunk in chunks] == [10, CHUNK, 2 * CHUNK, 3 * CHUNK]
    assert warnings == [f'a worker died near drop {CHUNK} of tetrahedron: its drops are repeated']
    assert error is None


def test_repeated_worker_deaths_raise_an_error(campaign):
    workers = Mortal(None, *[DEATH] * MAX_DEATHS)
    chunks, warnings, error = campaign(workers)
    assert [chunk.first_drop for chunk in chunks] == [10]
    near = f'near drop {CHUNK} of tetrahedron'
    assert warnings == [f'a worker died {near}: its drops are repeated'] * (MAX_DEATHS - 1)
    assert error == f'{MAX_DEATHS} worker processes died in a row {near}'


def test_a_returned_chunk_resets_the_death_count(campaign):
    deaths = [DEATH] * (MAX_DEATHS - 1)
    workers = Mortal(*deaths, None, *deaths, None, *deaths)
    assert campaign(workers)[2] is None


def test_one_error_can_report_several_deaths(campaign):
    _, warnings, error = campaign(Mortal(ManyDeathsError()))
    assert error == f'{MAX_DEATHS + 1} worker processes died in a row near drop 10 of tetrahedron'
    assert warnings == []


@pytest.mark.parametrize(
    ('end', 'expected'),
    [
        (KeyError('hull'), "a worker failed near drop 125 of tetrahedron: KeyError('hull')"),
        (EngineError('Bullet has no room'), 'Bullet has no room'),
        (CancelledError(), 'the workers became unavailable near drop 125 of tetrahedron'),
    ],
)
def test_chunks_of_failed_workers_are_not_repeated(campaign, end, expected):
    workers = Mortal(None, end)
    chunks, _, error = campaign(workers)
    assert error == expected
    assert len(chunks) == 1
    assert workers.asked == [10, CHUNK]


def test_stopping_early_cancels_chunks_not_started():
    workers = Recorder(lambda: 3)
    asked = SimpleNamespace(first_drop=0, end=10 * CHUNK)
    steps = drop_chunks('job', asked, workers, pytest.fail)
    assert next(steps) is workers.futures[0]
    steps.close()
    assert [future.cancelled() for future in workers.futures] == [False, True, True]
