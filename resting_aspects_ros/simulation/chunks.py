"""The drops of a run: simulated in chunks by any workers, returned in ascending order."""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from itertools import islice
from typing import Any, Protocol

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.stopping import checkpoints
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.run_description import RunDescription

# A run fails when this many workers died without a chunk being returned in between.
MAX_DEATHS = 3


class Workers(Protocol):
    """Workers that simulate chunks: those of this machine, or a cluster."""

    def lookahead(self) -> int:
        """Return how many chunks should be pending, so that no worker is idle."""

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[Any]':
        """Start the simulation of the drops ``first`` to ``end - 1``."""

    def result(self, future: 'Future[Any]') -> RestingPoses:
        """Return the poses of a submitted chunk, or raise the error of its worker."""

    def deaths(self, error: Exception) -> int:
        """Return how many workers died if the error reports it, otherwise 0."""


class DeathCount:
    """Deaths of workers in a row: what died is repeated, until there are too many of them."""

    def __init__(self) -> None:
        self._count = 0

    def reset(self) -> None:
        """A chunk was returned."""
        self._count = 0

    def repeat(self, workers: Workers, error: Exception, where: str) -> str:
        """Return a warning if the error means that a worker died, so that a chunk is repeated.

        Raises EngineError if the error has another reason, or if MAX_DEATHS workers died in a
        row. ``where`` completes the messages, such as 'near drop 250 of l_bracket'.
        """
        if isinstance(error, CancelledError):
            raise EngineError(f'the workers became unavailable {where}') from None
        died = workers.deaths(error)
        self._count += died
        if died == 0:
            if isinstance(error, EngineError):
                raise error
            raise EngineError(f'a worker failed {where}: {error!r}') from error
        if self._count >= MAX_DEATHS:
            raise EngineError(f'{self._count} worker processes died in a row {where}') from None
        return f'a worker died {where}: its drops are repeated'


def chunk_bounds(
    job: DropJob, first: int, end: int, cuts: Sequence[int] = ()
) -> Iterator[tuple[int, int]]:
    """Yield the chunks [first, end) of a range of drops: as many as a worker makes at once.

    They begin at multiples of that number, and at the ``cuts``.
    """
    while first < end:
        ends = [end, (first // job.chunk + 1) * job.chunk, *(cut for cut in cuts if cut > first)]
        stop = min(ends)
        yield first, stop
        first = stop


def submit_drops(
    job: DropJob, first_drop: int, drops: int, workers: Workers, cuts: Sequence[int] = ()
) -> Generator['Future[Any]', None, None]:
    """Yield futures of consecutive chunks in order, with ``lookahead()`` chunks pending.

    Memory does not grow with the number of drops: a chunk is submitted only after an earlier one
    was yielded. Closing the iterator cancels the chunks that were not started.
    """
    pending: deque[Future[Any]] = deque()
    chunks = chunk_bounds(job, first_drop, first_drop + drops, cuts)
    try:
        while True:
            for chunk in islice(chunks, max(1, workers.lookahead()) - len(pending)):
                pending.append(workers.submit(job, *chunk))
            if not pending:
                return
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
    first, deaths = run.first_drop, DeathCount()
    # A run ends at one of them, so no drop is made in vain.
    cuts = checkpoints(run.drops) if run.precision else []
    while first < run.end:
        futures = submit_drops(job, first, run.end - first, workers, cuts)
        try:
            for future in futures:
                yield future
                chunk = workers.result(future)
                first = chunk.end
                deaths.reset()
                yield chunk
        except Exception as error:  # noqa: BLE001 - raised again unless a worker died
            warn(deaths.repeat(workers, error, _near(first, run)))
        finally:
            futures.close()


def _near(drop: int, run: RunDescription) -> str:
    return f'near drop {drop} of {run.part}'
