"""Chunks: bounds, order, number of pending chunks, and chunks that fail."""

import dataclasses
import re
from concurrent.futures import Future

import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation.conditions import KERNEL, MAX_SEED
from resting_aspects_ros.simulation.job import CHUNKS, plan_run
from resting_aspects_ros.simulation.workers import (
    WorkerDiedError,
    chunk_bounds,
    drop_chunks,
    submit_drops,
)
from resting_aspects_ros.statistics.intervals import checkpoints

CHUNK = CHUNKS[KERNEL]


class Recorder:
    """Workers that keep what is submitted; the test finishes the futures."""

    def __init__(self, lookahead=1):
        self.lookahead = lambda: lookahead
        self.futures = []

    def submit(self, *_):
        self.futures.append(Future())
        return self.futures[-1]


class Finished(Recorder):
    """Workers whose chunks are done at once: the numbers of their drops stand for poses."""

    def submit(self, job, first, stop):
        future = super().submit()
        future.set_result(range(first, stop))
        return future


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


@given(
    st.one_of(st.integers(0, 3000), st.integers(MAX_SEED - 9000, MAX_SEED - 6000)),
    st.integers(0, 5000),
    st.lists(st.integers(1, 8000), max_size=5),
)
def test_chunks_cover_a_range_and_end_only_at_multiples_and_cuts(planned, first, drops, cuts):
    end, shifted = first + drops, [first + cut for cut in cuts]
    found = list(chunk_bounds(planned[0], first, end, shifted))
    inner = {k for k in range(first + 1, end) if k % CHUNK == 0 or k in shifted}
    starts, ends = [first, *sorted(inner)], [*sorted(inner), end]
    assert found == (list(zip(starts, ends, strict=True)) if drops else [])


def test_chunks_end_where_a_precision_is_tested(planned):
    job, asked = planned
    precise = dataclasses.replace(asked, precision=0.02, first_drop=0)
    steps = drop_chunks(job, precise, Finished())
    ends = [step.stop for step in steps if isinstance(step, range)]
    assert ends == sorted({*checkpoints(3 * CHUNK), CHUNK, 2 * CHUNK, 3 * CHUNK})
    assert ends[0] == 250


@pytest.mark.parametrize('lookahead', [1, 5])
def test_at_most_lookahead_chunks_are_pending(planned, lookahead):
    workers = Recorder(lookahead)
    chunks = submit_drops(planned[0], 0, 10 * CHUNK, workers)
    assert workers.futures == []  # nothing before the first is asked for
    for taken, future in enumerate(chunks, start=1):
        # Handed over in order, not by which is done first.
        assert future is workers.futures[taken - 1]
        assert len(workers.futures) == min(10, taken - 1 + lookahead)
    assert len(workers.futures) == 10


def test_stopping_early_cancels_chunks_not_started(planned):
    workers = Recorder(3)
    steps = drop_chunks(*planned, workers)
    assert next(steps) is workers.futures[0]
    workers.futures[1].set_running_or_notify_cancel()
    steps.close()
    assert [future.cancelled() for future in workers.futures] == [False, False, True]


NEAR = 'near drop 10 of tetrahedron'


@pytest.mark.parametrize(
    ('end', 'error'),
    [
        (WorkerDiedError('3 processes died'), f'3 processes died {NEAR}'),
        (KeyError('hull'), f"a worker failed {NEAR}: KeyError('hull')"),
    ],
)
def test_chunks_that_fail_are_an_error(planned, end, error):
    workers = Recorder()
    steps = drop_chunks(*planned, workers)
    next(steps).set_exception(end)
    with pytest.raises(EngineError, match=f'^{re.escape(error)}$'):
        next(steps)
    assert len(workers.futures) == 1
