"""A run's drops, made in chunks by any executor and handed over in their order."""

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import CancelledError, Executor, Future
from typing import Protocol

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.engine import drop_chunk
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.release import CHUNK
from resting_aspects_ros.drops.run import RunDescription

# Workers that die are replaced, until so many died without a chunk handed over between.
MOST_DEATHS = 3


class Workers(Protocol):
    """Who makes drops: an executor, and another one when it breaks."""

    @property
    def executor(self) -> Executor:
        """The one that takes chunks now."""

    def lookahead(self) -> int:
        """Chunks to have under way now, so that nobody waits for work."""

    def deaths(self, error: Exception) -> int:
        """How many workers died, if the error says that; else 0."""

    def replace(self, broken: Executor) -> None:
        """See to it that there are workers again; who comes second finds them there."""


def submit_drops(
    job: DropJob, first_drop: int, drops: int, executor: Executor, lookahead: Callable[[], int]
) -> Generator['Future[RestingPoses]', None, None]:
    """Futures of consecutive chunks of drops, in order, ``lookahead()`` of them under way.

    Any executor of concurrent.futures will do. Threads give the same poses as processes, but no
    speed: Bullet's binding never lets go of Python's lock, so one of them drops at a time.

    Memory does not grow with the number of drops: a chunk is submitted only when an earlier one
    is taken. Closing the iterator cancels what has not begun.
    """
    pending: deque[Future[RestingPoses]] = deque()
    first, end = first_drop, first_drop + drops
    try:
        while first < end or pending:
            most = lookahead()
            if most < 1:
                raise ValueError(f'lookahead is {most}, allowed is 1 or more')
            while first < end and len(pending) < most:
                stop = min(end, (first // CHUNK + 1) * CHUNK)
                pending.append(executor.submit(drop_chunk, job, first, stop))
                first = stop
            yield pending.popleft()
    finally:
        for future in pending:
            future.cancel()


def drop_chunks(
    job: DropJob, asked: RunDescription, workers: Workers, warn: Callable[[str], None]
) -> Generator['Future[RestingPoses] | RestingPoses', None, None]:
    """The chunks of a run in their order, each after its future, which is there to be waited for.

    How to wait is left to who iterates, a command or a node in its loop; who does not wait is
    held up until the chunk is there. When workers die, the chunks that were not handed over are
    dropped again, by others: since the poses depend on the job and the index alone, nothing tells
    such a run from an undisturbed one, but what is told to ``warn``.

    Raises
    ------
    EngineError
        If a worker fails, or so many die one after the other that it must be due to the drops or
        the machine. The chunks before are good.
    """
    first, deaths = asked.first_drop, 0
    while first < asked.end:
        executor = workers.executor
        futures = submit_drops(job, first, asked.end - first, executor, workers.lookahead)
        try:
            for future in futures:
                yield future
                chunk = future.result()
                first, deaths = chunk.end, 0
                yield chunk
        except EngineError:
            raise
        except CancelledError:
            raise EngineError(f'the workers went away {_near(first, asked)}') from None
        except Exception as error:
            died = workers.deaths(error)
            if died == 0:
                raise EngineError(f'a worker failed {_near(first, asked)}: {error!r}') from error
            deaths += died
            if deaths >= MOST_DEATHS:
                raise EngineError(
                    f'{deaths} worker processes died in a row {_near(first, asked)}'
                ) from None
            warn(f'a worker died {_near(first, asked)}: its drops are made again')
            workers.replace(executor)
        finally:
            futures.close()


def _near(drop: int, asked: RunDescription) -> str:
    return f'near drop {drop} of {asked.part}'
