"""The drops of a run: simulated in chunks by any workers, returned in ascending order."""

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import CancelledError, Future
from typing import Any, Protocol

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.run_description import RunDescription

# A run fails when this many workers died without a chunk being returned in between.
MAX_DEATHS = 3


class Workers(Protocol):
    """Workers that simulate chunks: processes of this machine, or a cluster."""

    def lookahead(self) -> int:
        """Return how many chunks should be pending, so that no worker is idle."""

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[Any]':
        """Start the simulation of the drops ``first`` to ``end - 1``, all of one chunk."""

    def result(self, future: 'Future[Any]') -> RestingPoses:
        """Return the poses of a submitted chunk, or raise the error of its worker."""

    def deaths(self, error: Exception) -> int:
        """Return how many workers died if the error reports it, otherwise 0."""


def submit_drops(
    job: DropJob, first_drop: int, drops: int, workers: Workers
) -> Generator['Future[Any]', None, None]:
    """Yield futures of consecutive chunks in order, with ``lookahead()`` chunks pending.

    Memory does not grow with the number of drops: a chunk is submitted only after an earlier one
    was yielded. Closing the iterator cancels the chunks that were not started.
    """
    pending: deque[Future[Any]] = deque()
    first, end = first_drop, first_drop + drops
    try:
        while first < end or pending:
            while first < end and len(pending) < max(1, workers.lookahead()):
                stop = min(end, (first // CHUNK + 1) * CHUNK)
                pending.append(workers.submit(job, first, stop))
                first = stop
            yield pending.popleft()
    finally:
        for future in pending:
            future.cancel()


def drop_chunks(
    job: DropJob, run: RunDescription, workers: Workers, warn: Callable[[str], None]
) -> Generator['Future[RestingPoses] | RestingPoses', None, None]:
    """Yield the chunks of a run in ascending order, each after its future.

    The caller can wait for the future in its own way, for example in the event loop of a node. A
    caller that does not wait is blocked until the chunk is done. When a worker dies, the chunks
    that were not yielded are simulated again and ``warn`` is called with a message. The result is
    the same as without the failure, because poses depend only on the job and the index.

    Raises
    ------
    EngineError
        If a worker fails, or if MAX_DEATHS workers die in a row, which indicates a problem with
        the drops or the machine. The chunks yielded before remain valid.
    """
    first, deaths = run.first_drop, 0
    while first < run.end:
        futures = submit_drops(job, first, run.end - first, workers)
        try:
            for future in futures:
                yield future
                chunk = workers.result(future)
                first, deaths = chunk.end, 0
                yield chunk
        except CancelledError:
            raise EngineError(f'the workers became unavailable {_near(first, run)}') from None
        except Exception as error:
            died = workers.deaths(error)
            if died == 0:
                if isinstance(error, EngineError):
                    raise
                raise EngineError(f'a worker failed {_near(first, run)}: {error!r}') from error
            deaths += died
            if deaths >= MAX_DEATHS:
                raise EngineError(
                    f'{deaths} worker processes died in a row {_near(first, run)}'
                ) from None
            warn(f'a worker died {_near(first, run)}: its drops are repeated')
        finally:
            futures.close()


def _near(drop: int, run: RunDescription) -> str:
    return f'near drop {drop} of {run.part}'
