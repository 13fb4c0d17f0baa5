"""Drops on a Dask cluster: the one file that imports distributed, which need not be installed."""

import asyncio
import logging
from concurrent.futures import Future
from importlib.metadata import version
from typing import Any, TypeVar

from resting_aspects_ros import __version__
from resting_aspects_ros.core.errors import EngineError, InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.drop_job import DropJob

# For the scheduler to answer, and then for a worker to be there, s.
PATIENCE = 4.0

T = TypeVar('T')


class ClusterWorkers:
    """The workers of a Dask cluster, as many as there are at any time: Workers of a campaign.

    The scheduler gives the chunks of a worker that dies to others. If none is left, the drops
    wait for new ones.

    scheduler : str
        Its address, such as ``tcp://10.0.0.5:8786``.

    Raises
    ------
    InvalidValueError
        If distributed is not installed, or if there is no scheduler with workers.
    """

    def __init__(self, scheduler: str) -> None:
        self._client = _connect(scheduler)
        self._count = self._counted_for = 0
        # Not pure: a failure for another client is no answer.
        self._executor = self._client.get_executor(pure=False)
        self._job: DropJob | None = None
        self._job_there: Any = None

    def lookahead(self) -> int:
        """Two chunks for each worker that is there now."""
        # To count takes a round trip to the scheduler, which not every chunk must wait for.
        if self._counted_for == 0:
            self._count = self._counted_for = max(1, len(self._client.nthreads()))
        self._counted_for -= 1
        return 2 * self._count

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[Any]':
        """Drop a chunk on a worker."""
        if job is not self._job:
            # A task of its own, so that each worker gets it once. Unlike scattered data it is
            # made again when the workers that hold it die.
            self._job, self._job_there = job, self._client.submit(_same, job, pure=False)
        future: Future[Any] = self._executor.submit(_drop, self._job_there, first, end)
        return future

    def result(self, future: 'Future[Any]') -> RestingPoses:
        """The poses of a chunk; EngineError if the worker's versions are not those here."""
        poses, worker, versions = future.result()
        for name, here in _versions().items():
            if versions[name] != here:
                raise EngineError(
                    f'invalid worker {worker}: expected {name} {here}, not {versions[name]}'
                )
        chunk: RestingPoses = poses
        return chunk

    def deaths(self, error: Exception) -> int:
        """Workers that died with the same chunk one after the other, until Dask gave it up."""
        from distributed.scheduler import KilledWorker

        return error.allowed_failures + 1 if isinstance(error, KilledWorker) else 0

    def stop(self) -> None:
        """Leave the cluster, which cancels what has not begun."""
        self._client.close(timeout=PATIENCE)


def _same(job: T) -> T:
    return job


def _drop(job: DropJob, first: int, end: int) -> tuple[RestingPoses, str, dict[str, str]]:
    """The poses of a chunk, and what they depend on beside the job."""
    from distributed import get_worker

    from resting_aspects_ros.simulation.bullet_engine import drop_chunk

    return drop_chunk(job, first, end), get_worker().address, _versions()


def _versions() -> dict[str, str]:
    """Versions of which others need not give the same poses."""
    return {
        'resting_aspects_ros': __version__,
        'pybullet': version('pybullet'),
        'numpy': version('numpy'),
    }


def _connect(scheduler: str) -> Any:
    """A client of a scheduler that has workers; raises InvalidValueError."""
    try:
        from distributed import Client
    except ImportError:
        raise InvalidValueError(
            f'scheduler {scheduler!r} needs Dask, which is not installed: pip install distributed'
        ) from None
    # What goes wrong is said in our words.
    for name in ('distributed', 'distributed.client', 'tornado.application'):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        # A client that fails to connect to what is no scheduler leaves a traceback; this does not.
        role = asyncio.run(asyncio.wait_for(_role(scheduler), PATIENCE))
        if role != 'Scheduler':
            raise InvalidValueError(f'this is a {role.lower()}')
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # noqa: BLE001 - it may be a web server, or nobody, that answers
        reason = str(error) or f'no answer within {PATIENCE:g} s'
        raise InvalidValueError(
            f'invalid scheduler {scheduler!r}: expected the address of a Dask scheduler; {reason}'
        ) from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except asyncio.TimeoutError:
        client.close(timeout=PATIENCE)
        raise InvalidValueError(
            f'invalid scheduler {scheduler!r}: expected a scheduler that has workers; none '
            f'connected within {PATIENCE:g} s'
        ) from None
    return client


async def _role(address: str) -> str:
    """What answers at an address: Scheduler, Worker or Nanny."""
    from distributed import Security, rpc

    credentials = Security().get_connection_args('client')
    async with rpc(address, connection_args=credentials) as server:
        return str((await server.identity())['type'])
