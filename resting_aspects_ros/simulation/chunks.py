"""A run's drops, made in chunks by any workers and handed over in their order."""

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import CancelledError, Future
from typing import Any, Protocol

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.run_description import RunDescription

# So many workers may die, each with no chunk handed over since the one before.
MAX_DEATHS = 3


class Workers(Protocol):
    """What drops chunks: processes of this machine, or a cluster."""

    def lookahead(self) -> int:
        """Chunks to have submitted now, so that no worker waits for work."""

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[Any]':
        """Begin to drop the drops ``first`` to ``end - 1``, all of one chunk."""

    def result(self, future: 'Future[Any]') -> RestingPoses:
        """The poses of a submitted chunk; raises what went wrong."""

    def deaths(self, error: Exception) -> int:
        """How many workers died, if the error says that; else 0."""


def submit_drops(
    job: DropJob, first_drop: int, drops: int, workers: Workers
) -> Generator['Future[Any]', None, None]:
    """Futures of consecutive chunks of drops, in order, ``lookahead()`` of them under way.

    Memory does not grow with the number of drops: a chunk is submitted only when an earlier one
    is taken. Closing the iterator cancels what has not begun.
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
    job: DropJob, asked: RunDescription, workers: Workers, warn: Callable[[str], None]
) -> Generator['Future[RestingPoses] | RestingPoses', None, None]:
    """The chunks of a run in their order, each after its future.

    The caller waits for the future in its own way, as a command or in the loop of a node; one
    that does not wait is blocked until the chunk is done. When workers die, the chunks that were
    not handed over are dropped again. Since the poses depend on the job and the index alone, such
    a run equals an undisturbed one; ``warn`` is told.

    Raises
    ------
    EngineError
        If a worker fails, or so many die one after the other that it must be due to the drops or
        the machine. The chunks before are good.
    """
    first, deaths = asked.first_drop, 0
    while first < asked.end:
        futures = submit_drops(job, first, asked.end - first, workers)
        try:
            for future in futures:
                yield future
                chunk = workers.result(future)
                first, deaths = chunk.end, 0
                yield chunk
        except CancelledError:
            raise EngineError(f'the workers became unavailable {_near(first, asked)}') from None
        except Exception as error:
            died = workers.deaths(error)
            if died == 0:
                if isinstance(error, EngineError):
                    raise
                raise EngineError(f'a worker failed {_near(first, asked)}: {error!r}') from error
            deaths += died
            if deaths >= MAX_DEATHS:
                raise EngineError(
                    f'{deaths} worker processes died in a row {_near(first, asked)}'
                ) from None
            warn(f'a worker died {_near(first, asked)}: its drops are repeated')
        finally:
            futures.close()


def _near(drop: int, asked: RunDescription) -> str:
    return f'near drop {drop} of {asked.part}'
