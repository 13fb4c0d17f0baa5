"""Chunks: bounds, order, number of pending chunks, and workers that die."""

import dataclasses
from concurrent.futures import CancelledError, Future

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation.conditions import KERNEL, MAX_SEED
from resting_aspects_ros.simulation.job import CHUNKS, plan_run
from resting_aspects_ros.simulation.workers import (
    MAX_DEATHS,
    WorkerDiedError,
    chunk_bounds,
    drop_chunks,
    submit_drops,
)
from resting_aspects_ros.statistics.intervals import checkpoints
from resting_aspects_ros.statistics.poses import RestingPoses

CHUNK = CHUNKS[KERNEL]


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
        self.asked.append(first)
        future = Future()
        if end is None:
            future.set_result(some_poses(first, stop))
        elif isinstance(end, CancelledError):
            future.cancel()
        else:
            future.set_exception(end)
        return future

    def lookahead(self):
        return 1


DEATH = WorkerDiedError('a worker process died')


def some_poses(first, stop):
    empty = RestingPoses.none(first)
    arrays = [getattr(empty, field.name) for field in dataclasses.fields(RestingPoses)[1:]]
    return RestingPoses(first, *(np.zeros((stop - first, *a.shape[1:]), a.dtype) for a in arrays))


@pytest.fixture(scope='module')
def planned(part, surfaces):
    """The job and the description of a run of three chunks and a bit."""
    return plan_run(
        part('tetrahedron'),
        surfaces.get(),
        seed=5,
        drops=3 * CHUNK,
        first_drop=10,
        run_id='',
        started=0,
    )


@pytest.fixture(scope='module')
def job(planned):
    return planned[0]


@pytest.fixture
def campaign(planned):
    """Make the drops of a run with workers; gives the chunks and what was warned of."""
    job, asked = planned

    def drop(workers):
        warnings = []
        steps = drop_chunks(job, asked, workers, warnings.append)
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


@given(
    st.one_of(st.integers(0, 3000), st.integers(MAX_SEED - 9000, MAX_SEED - 6000)),
    st.integers(0, 5000),
    st.lists(st.integers(1, 8000), max_size=5),
)
def test_chunks_cover_a_range_and_end_only_at_multiples_and_cuts(job, first, drops, cuts):
    end, shifted = first + drops, [first + cut for cut in cuts]
    found = list(chunk_bounds(job, first, end, shifted))
    inner = {k for k in range(first + 1, end) if k % CHUNK == 0 or k in shifted}
    starts, ends = [first, *sorted(inner)], [*sorted(inner), end]
    assert found == (list(zip(starts, ends, strict=True)) if drops else [])


def test_chunks_end_where_a_precision_is_tested(part, surfaces):
    job, asked = plan_run(
        part('tetrahedron'),
        surfaces.get(),
        seed=5,
        drops=3 * CHUNK,
        precision=0.02,
        run_id='',
        started=0,
    )
    steps = drop_chunks(job, asked, Mortal(), pytest.fail)
    ends = [step.end for step in steps if not isinstance(step, Future)]
    assert ends == sorted({*checkpoints(3 * CHUNK), CHUNK, 2 * CHUNK, 3 * CHUNK})
    assert ends[0] == 250


@pytest.mark.parametrize('lookahead', [1, 5])
def test_at_most_lookahead_chunks_are_pending(job, lookahead):
    workers = Recorder(lambda: lookahead)
    chunks = submit_drops(job, 0, 10 * CHUNK, workers)
    assert workers.asked == []  # nothing before the first is asked for
    for taken, future in enumerate(chunks, start=1):
        # Handed over in order, not by which is done first.
        assert future is workers.futures[taken - 1]
        assert len(workers.futures) == min(10, taken - 1 + lookahead)
    assert len(workers.futures) == 10


def test_all_chunks_are_made_when_workers_are_lost(job):
    left = iter([5, 5, 1, 0])
    workers = Recorder(lambda: next(left, 1))
    assert len(list(submit_drops(job, 0, 10 * CHUNK, workers))) == 10


def test_closing_cancels_only_chunks_not_started(job):
    workers = Recorder(lambda: 4)
    chunks = submit_drops(job, 0, 10 * CHUNK, workers)
    next(chunks)
    workers.futures[1].set_running_or_notify_cancel()
    chunks.close()
    assert [f.cancelled() for f in workers.futures] == [False, False, True, True]
    assert len(workers.asked) == 4


def test_chunks_of_dead_workers_are_repeated(campaign):
    workers = Mortal(None, DEATH)
    chunks, warnings, error = campaign(workers)
    assert [chunk.first_drop for chunk in chunks] == [10, CHUNK, 2 * CHUNK, 3 * CHUNK]
    assert workers.asked == [10, CHUNK, CHUNK, 2 * CHUNK, 3 * CHUNK]
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


@pytest.mark.parametrize(
    ('end', 'expected'),
    [
        (
            KeyError('hull'),
            f"a worker failed near drop {CHUNK} of tetrahedron: KeyError('hull')",
        ),
        (EngineError('Bullet has no room'), 'Bullet has no room'),
        (
            CancelledError(),
            f'the workers became unavailable near drop {CHUNK} of tetrahedron',
        ),
    ],
)
def test_chunks_of_failed_workers_are_not_repeated(campaign, end, expected):
    workers = Mortal(None, end)
    chunks, _, error = campaign(workers)
    assert error == expected
    assert len(chunks) == 1
    assert workers.asked == [10, CHUNK]


def test_stopping_early_cancels_chunks_not_started(planned):
    workers = Recorder(lambda: 3)
    steps = drop_chunks(*planned, workers, pytest.fail)
    assert next(steps) is workers.futures[0]
    steps.close()
    assert [future.cancelled() for future in workers.futures] == [False, True, True]
