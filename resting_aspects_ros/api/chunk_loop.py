"""The loop that makes the chunks of a run, until they are all made or no more are needed."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, wait
from contextlib import closing, contextmanager

from resting_aspects_ros.errors import warn
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.workers import (
    LocalWorkers,
    Workers,
    default_workers,
    drop_chunks,
)
from resting_aspects_ros.statistics.poses import RestingPoses

# How often progress is reported while a chunk is simulated, s.
PROGRESS_PERIOD = 0.1


def count_chunks(
    job: DropJob,
    run: RunDescription,
    ranges: Iterable[tuple[int, int]],
    workers: Workers,
    count: Callable[[RestingPoses], None],
    complete: Callable[[], bool],
    progress: Callable[[], None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Make the drops [first, end) of each range, and pass each chunk to ``count``, in order.

    Ends early if ``stopped`` or, after a chunk, ``complete`` returns True. ``progress`` is called
    often. Raises EngineError.
    """
    for first, end in ranges:
        requested = dataclasses.replace(run, first_drop=first, drops=end - first)
        with closing(drop_chunks(job, requested, workers, warn)) as steps:
            for step in steps:
                if isinstance(step, Future):
                    while not stopped() and not wait([step], PROGRESS_PERIOD).done:
                        progress()
                else:
                    count(step)
                    progress()
                if stopped() or complete():
                    return


@contextmanager
def given_workers(given: int | Workers | None) -> Iterator[Workers]:
    """Yield the given workers, or new ones of this machine, which are stopped at the end.

    A number is that of the workers; None: one for each core.
    """
    if given is not None and not isinstance(given, int):
        yield given
        return
    workers = LocalWorkers(default_workers() if given is None else given)
    try:
        yield workers
    finally:
        workers.stop()
